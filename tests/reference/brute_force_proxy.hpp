#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar::reference {

// End position of a ball of `radius` that starts at `start` (clear of the surface) and is pulled towards
// `goal` in tiny steps, is pushed straight out of the surface after each, and then tries ever smaller random
// steps while they reduce the distance: a local minimum of the distance to the goal. Simple and slow; shares
// no code with the product.
Vec3d brute_force_proxy(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& start, const Vec3d& goal,
                        double radius, double step);

}  // namespace trocar::reference
