#pragma once
#include <array>

#include "components/math.hpp"
namespace trocar::reference {

// A body with six faces, trilinear between its corners (m; corner i at xi = i & 1, eta = i / 2 & 1, zeta = i / 4), held at
// zeta = 0, under an even traction (Pa) on zeta = 1, in linear elasticity: mean displacement (m) of that face along the traction, by
// elements[k] elements with 27 nodes each along xi, eta, zeta (Zienkiewicz, Taylor, "The finite element method", vol. 1, chapter 8). Shares
// nothing with the solids of the engine.
double push_hexahedron(const std::array<Vec3d, 8>& corner, const std::array<int, 3>& elements, double youngs_modulus, double poisson,
                       const Vec3d& traction);

}  // namespace trocar::reference
