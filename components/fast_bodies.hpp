#pragma once
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Motion of a rigid body in another body's frame: the point `pivot` of its own frame is at `position` and
// moves with `velocity`; the body rotates about it with `spin` (rad/s, axes of the other's frame).
struct RigidSweep {
    Vec3d pivot = Vec3d::Zero();     // m, frame of the mover
    Vec3d position = Vec3d::Zero();  // m
    Vec3d velocity = Vec3d::Zero();  // m/s
    Quat orientation;
    Vec3d spin = Vec3d::Zero();
    TROCAR_FIELDS(pivot, "m", position, "m", velocity, "m/s", orientation, spin, "rad/s");
};

// A rigid body that moves farther in a pass than its speculative margin, and its motion in world axes.
struct CcdBody {
    uint32_t body = kNone;
    RigidSweep sweep;
    TROCAR_FIELDS(body, "index of bodies", sweep);
};

}  // namespace trocar
