#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar {

// Winding number of a closed surface around p, by the signed crossings of the ray towards +z with exact
// signs: 113-bit arithmetic with an error bound, and integers where the bound does not decide. False if p is
// on a face. Shares nothing with the engine's predicates.
bool exact_windings(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p, int& windings);

}  // namespace trocar
