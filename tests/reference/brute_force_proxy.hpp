#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar::reference {

// Where a ball of `radius` that starts at `start` (clear of the surface) ends when it is pulled towards `goal` with tiny
// steps and pushed straight out of the surface after each, then shaken by ever smaller random steps while that brings
// it nearer: a local minimum of the distance to the goal. Obvious and slow; no code shared with the product.
Vec3d brute_force_proxy(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& start, const Vec3d& goal,
                        double radius, double step);

}  // namespace trocar::reference
