#pragma once
#include "components/fast_bodies.hpp"
#include "engine/distance/closest_point.hpp"
namespace trocar {

// First time (s, in [0, seconds]) at which the surfaces of a moving and a resting body are nearer than
// `tolerance` (m), or infinity. Never later than the time of impact itself; earlier by at most the time in
// which they approach by two tolerances.
// Surfaces first touch at a vertex or at two edges, so the mover's edges are tested against the other's
// surface and the other's vertices against the mover's: conservative advancement (Mirtich 1996; Zhang et al.
// 2006) by the distance of the centre of a piece of edge minus its half length, which is 1-Lipschitz; pieces
// that are near are halved. Thread-safe.
double first_touch(const MeshView& mover, const ClosestPointTree& mover_tree, const MeshView& other, const ClosestPointTree& other_tree,
                   const RigidSweep& sweep, double seconds, double tolerance);

}  // namespace trocar
