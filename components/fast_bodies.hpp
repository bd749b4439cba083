#pragma once
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Motion of a rigid body seen from another body's frame: a point `pivot` of its own frame is at `place` and goes with
// `velocity`, the body turns about it with `spin` (rad/s, axes of the other's frame).
struct RigidSweep {
    Vec3d pivot = Vec3d::Zero();     // m, frame of the mover
    Vec3d place = Vec3d::Zero();     // m
    Vec3d velocity = Vec3d::Zero();  // m/s
    Quat orientation;
    Vec3d spin = Vec3d::Zero();
    TROCAR_FIELDS(pivot, "m", place, "m", velocity, "m/s", orientation, spin, "rad/s");
};

// A rigid body that moves farther in a pass than contact rows look ahead, and its motion in world axes.
struct FastBody {
    uint32_t body = kNone;
    RigidSweep sweep;
    TROCAR_FIELDS(body, "row of bodies", sweep);
};

}  // namespace trocar
