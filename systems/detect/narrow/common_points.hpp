#pragma once
#include <array>
#include <span>

#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Whether the bodies a and b of a broad-phase pair, closed sets, have a common point: exact for the corners where they are
// placed, whichever features meet. `candidates`: the pair's range of CandidateTriangles::triangle. `depth`: of the pair, m, or 0;
// a body inside the other is far deeper than rounding.
bool share_a_point(const Surfaces& surfaces, uint32_t a, uint32_t b, std::span<const std::array<uint32_t, 2>> candidates, double depth);

}  // namespace trocar
