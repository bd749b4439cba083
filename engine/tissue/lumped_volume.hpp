#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Volume (m^3) lumped to each node of a tetrahedral mesh: a quarter of every tetrahedron around it.
std::vector<double> quarter_volumes(std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra);

// The same, evened. Where the boundary cuts tetrahedra small, one node of little volume between stiff
// neighbours would set the stable step of the whole body. Mass may be lumped in any way that conserves its
// sum (Hinton, Rock and Zienkiewicz, "A note on mass lumping and related processes in the finite element
// method", 1976), so such nodes take volume from neighbours with a surplus. The need of a node is its sum of
// V |g|^2, g the gradient of its shape function, divided by kEvenRate times the body's mean of that per
// volume: so hardly any omega^2 of a node exceeds kEvenRate times the mean. The sum is conserved, every
// volume stays positive, and no volume moves farther than kEvenRounds edges.
inline constexpr double kEvenRate = 2.5;
inline constexpr int kEvenRounds = 12;
std::vector<double> lumped_volume(std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra);

}  // namespace trocar
