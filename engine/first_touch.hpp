#pragma once
#include "components/fast_bodies.hpp"
#include "engine/closest_point.hpp"
namespace trocar {

// First time (s, in [0, seconds]) at which the surfaces of a moving and a resting body are nearer than `tolerance` (m), or
// infinity. Never later than the touch itself; earlier by no more than it takes to come two tolerances nearer. Surfaces
// first touch with a vertex or with two edges, so the mover's edges are taken to the other's surface and the other's
// vertices to the mover's: conservative advancement (Mirtich 1996; Zhang et al. 2006) by the distance of the middle of
// a piece of edge less its half length, which is 1-Lipschitz; pieces are halved when they are near. Thread-safe.
double first_touch(const MeshView& mover, const ClosestPointTree& mover_tree, const MeshView& other, const ClosestPointTree& other_tree,
                   const RigidSweep& sweep, double seconds, double tolerance);

}  // namespace trocar
