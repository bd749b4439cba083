#pragma once
#include <span>

#include "components/haptics.hpp"
namespace trocar {

// A point of a shell near a surface that is taken for a plane during one tick.
struct ShellPlane {
    uint32_t point = 0;
    uint32_t body = kNone;
    double distance = 0;             // m, of the point before the step; negative inside
    Vec3d normal = Vec3d::Zero();    // unit, out of the surface
    Vec3d arm = Vec3d::Zero();       // m, world axes, from the tip
    Vec3d carried = Vec3d::Zero();   // m, how far the surface went since the tick before
    Vec3d slip = Vec3d::Zero();      // m, how far friction was stretched then
    double held = 0;                 // N, normal force that friction may count on
    double friction = 0;             // coefficient
    double side = 1;                 // as SurfaceSide::side
    double gap = 0;                  // m, that the surface stands off by
    uint32_t tree = 0, row = 0;      // of the surface, and what the shell's scratch knows of the point there
    bool sliding = false;            // it slid in the tick before
    Vec3d velocity = Vec3d::Zero();  // m/s, of the surface
};

// A small motion of the tool: of its tip, and a turn about it.
struct ShellStep {
    Vec3d shift = Vec3d::Zero();  // m
    Vec3d turn = Vec3d::Zero();   // rad, rotation vector, world axes
};

// The springs between device, tool and surfaces.
struct ShellSprings {
    double stiffness = 0;          // N/m, coupling
    double turn_stiffness = 0;     // N m/rad, coupling
    double surface_stiffness = 0;  // N/m, of each point, along the normal and for friction along the surface
    ShellStep way;                 // from the tool to the device
};

// Distance (m) of a plane's point after a step.
double gap_after(const ShellPlane& plane, const ShellStep& step);

// What a plane does to its point after a step.
struct ShellForce {
    double normal = 0;            // N
    Vec3d force = Vec3d::Zero();  // N, on the tool
    Vec3d slip = Vec3d::Zero();   // m, along the plane, shortened to what friction holds
    bool yields = false;          // it was
};
ShellForce shell_force(const ShellSprings& springs, const ShellPlane& plane, const ShellStep& step);

// The step after which coupling and planes balance: the least of the convex energy
//   k/2 |shift - way|^2 + K/2 |turn - way|^2 + sum of k_s/2 min(0, distance + n . (shift + turn x arm))^2
// and of friction springs that yield at the plane's friction * held, by Newton's method with halved steps. Exact to rounding,
// whatever step it starts from; no allocation. A tool without mass, after the static virtual coupling of Barbic & James (IEEE Trans.
// Haptics 1(1), 2008, section 5): what the device feels is never stiffer than the coupling, however stiff and many the points are.
ShellStep solve_shell(const ShellSprings& springs, std::span<const ShellPlane> planes, const ShellStep& start = {});

}  // namespace trocar
