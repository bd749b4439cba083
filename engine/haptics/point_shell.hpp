#pragma once
#include <span>
#include <vector>

#include "components/tool.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// Point shell of a mesh (McNeely, Puterbaugh & Troy, SIGGRAPH 1999): about `count` points, evenly spread
// (Poisson discs, Cook 1986), starting with those along convex edges sharper than `sharp_angle` (rad, between
// the normals) and at their corners. Arms from `tip` (m, frame of the mesh); normals into the solid, of the
// face or the mean of those around. Sorted along a space-filling curve. Deterministic. Never fewer points
// than the corners of sharp edges; empty for a mesh of zero area.
std::vector<ShellPoint> make_point_shell(const MeshView& mesh, const Vec3d& tip, uint32_t count, double sharp_angle = 0.6);

// Distance of the farthest point from the tip. m
double shell_radius(const std::vector<ShellPoint>& point_shell);

// The points of a tool whose grip (rad) opens its jaws: arms from the tip, all in axes of the instrument. A
// tool without jaws returns its own points; else they are written to `placed`.
std::span<const ShellPoint> points_at_grip(const HandTool& tool, double grip, std::vector<ShellPoint>& placed);

// Largest displacement (m) of a jaw point per radian of grip.
double jaw_reach(const HandTool& tool);

}  // namespace trocar
