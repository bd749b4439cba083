#pragma once
#include <span>

#include "components/math.hpp"
namespace trocar {

// A point of a shell near a surface, which is approximated by a plane during one tick.
struct ShellPlane {
    uint32_t point = 0;
    uint32_t body = kNone;
    double distance = 0;             // m, signed, of the point before the step; negative inside
    Vec3d normal = Vec3d::Zero();    // unit, out of the surface
    Vec3d arm = Vec3d::Zero();       // m, world axes, from the tip
    Vec3d carried = Vec3d::Zero();   // m, displacement of the surface since the last tick
    Vec3d slip = Vec3d::Zero();      // m, stretch of the friction spring at the last tick
    double held = 0;                 // N, normal force for the friction limit
    double friction = 0;             // coefficient
    double side = 1;                 // as SurfaceSide::side
    double gap = 0;                  // m, offset of the surface along its normal
    uint32_t tree = 0, index = 0;    // of the surface, and the point's index in the shell's scratch
    bool sliding = false;            // it slid in the last tick
    Vec3d velocity = Vec3d::Zero();  // m/s, of the surface
};

// A small motion of the tool: displacement of its tip, and rotation about it.
struct ShellStep {
    Vec3d shift = Vec3d::Zero();  // m
    Vec3d turn = Vec3d::Zero();   // rad, rotation vector, world axes
};

// The springs between device, tool and surfaces.
struct ShellSprings {
    double stiffness = 0;          // N/m, coupling
    double turn_stiffness = 0;     // N m/rad, coupling
    double surface_stiffness = 0;  // N/m, of each point, along the normal and for friction along the surface
    ShellStep to_device;           // from the tool to the device
};

// Separation (m) of a plane's point after a step.
double separation_after(const ShellPlane& plane, const ShellStep& step);

// Contact force of a plane on its point after a step.
struct ShellForce {
    double normal = 0;            // N
    Vec3d force = Vec3d::Zero();  // N, on the tool
    Vec3d slip = Vec3d::Zero();   // m, along the plane, shortened to the friction limit
    bool yields = false;          // it was
};
ShellForce shell_force(const ShellSprings& springs, const ShellPlane& plane, const ShellStep& step);

// The step that balances coupling and planes: the minimum of the convex energy k/2 |shift - d.shift|^2 + K/2
// |turn - d.turn|^2 + sum of k_s/2 min(0, distance + n . (shift + turn x arm))^2 and of friction springs that
// yield at the plane's friction * held, d = to_device, by Newton's method with step halving. Exact to rounding for
// every start; no allocation.
// The tool has no mass, after the static virtual coupling of Barbic & James (IEEE Trans. Haptics 1(1), 2008,
// section 5): the device never feels more stiffness than the coupling's, however many the points.
ShellStep solve_shell(const ShellSprings& springs, std::span<const ShellPlane> planes, const ShellStep& start = {});

}  // namespace trocar
