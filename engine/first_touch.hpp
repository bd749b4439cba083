#pragma once
#include "components/math.hpp"
#include "engine/closest_point.hpp"
namespace trocar {

// Motion of a rigid body seen from another body's frame: a point `pivot` of its own frame is at `place` and goes with
// `velocity`, the body turns about it with `spin` (rad/s, axes of the other's frame).
struct RigidSweep {
    Vec3d pivot = Vec3d::Zero();     // m, frame of the mover
    Vec3d place = Vec3d::Zero();     // m
    Vec3d velocity = Vec3d::Zero();  // m/s
    Quat orientation;
    Vec3d spin = Vec3d::Zero();
};

// First time (s, in [0, seconds]) at which the surfaces of a moving and a resting body are nearer than `tolerance` (m), or
// infinity. Never later than the touch itself; earlier by no more than it takes to come two tolerances nearer. Surfaces
// first touch with a vertex or with two edges, so the mover's edges are taken to the other's surface and the other's
// vertices to the mover's: conservative advancement (Mirtich 1996; Zhang et al. 2006) by the distance of the middle of
// a piece of edge less its half length, which is 1-Lipschitz; pieces are halved when they are near. Thread-safe.
double first_touch(const MeshView& mover, const ClosestPointTree& mover_tree, const MeshView& other, const ClosestPointTree& other_tree,
                   const RigidSweep& sweep, double seconds, double tolerance);

}  // namespace trocar
