#pragma once
#include <span>
#include <vector>

#include "components/haptics.hpp"
#include "engine/mesh_view.hpp"
namespace trocar {

// The surface of a mesh as points that feel (McNeely, Puterbaugh & Troy, SIGGRAPH 1999): about `count` of them, evenly
// spread (no two much nearer than the rest: Poisson discs, Cook 1986), those along convex edges sharper than
// `sharp_angle` (rad, between the normals) and at their corners first. Arms from `tip` (m, frame of the mesh); normals
// into the solid, of the face or the mean of those around. Sorted along a space-filling curve. Depends on its arguments
// alone. Never fewer than the corners of sharp edges; empty for a mesh without area.
std::vector<ShellPoint> make_point_shell(const MeshView& mesh, const Vec3d& tip, uint32_t count, double sharp_angle = 0.6);

// Distance of the farthest point from the tip. m
double shell_radius(const std::vector<ShellPoint>& shell);

// The points of a tool where a grip (rad) puts its jaws: arms from the tip, all in axes of the instrument. Those of a tool
// without jaws are its own; else they are written to `placed`.
std::span<const ShellPoint> points_at_grip(const HandTool& tool, double grip, std::vector<ShellPoint>& placed);

// How far (m) a point of the jaws goes at most when the grip changes by one radian.
double jaw_reach(const HandTool& tool);

}  // namespace trocar
