#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar {

// How often a closed surface winds around p, by the signed crossings of the ray towards +z, every sign exact: 113-bit
// arithmetic with a bound, whole numbers where it cannot tell. False when p lies on a face. Shares nothing with the
// engine's predicates.
bool exact_windings(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p, int& windings);

}  // namespace trocar
