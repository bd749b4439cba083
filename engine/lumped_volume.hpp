#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Volume (m^3) that each node of a tetrahedral mesh stands for: a quarter of every tetrahedron around it. Nodes in none get 0.
std::vector<double> quarter_volumes(std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra);

// The same evened. Where the boundary cuts tetrahedra small, one node of little volume between stiff neighbours would set
// the stable step of the whole body. Mass may be lumped in any way that keeps its sum (Hinton, Rock and Zienkiewicz, "A note
// on mass lumping and related processes in the finite element method", 1976), so such nodes take volume from neighbours that
// have more than they need. What a node needs is its sum of V |g|^2, g the gradient of its shape function, over kEvenRate
// times what the body has of that per volume: so hardly any omega^2 of a node is larger than kEvenRate times the mean. The
// sum is kept, every volume stays positive, none goes farther than kEvenRounds edges.
inline constexpr double kEvenRate = 2.5;
inline constexpr int kEvenRounds = 12;
std::vector<double> lumped_volume(std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra);

}  // namespace trocar
