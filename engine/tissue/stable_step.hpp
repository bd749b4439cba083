#pragma once
#include <cstdint>
#include <span>

#include "components/math.hpp"
namespace trocar {

// Springs of one body as input of the bound: SELL-16 columns of its prototype, one stiffness, and all other
// stiffness on each particle, in N/m.
struct StiffnessGraph {
    std::span<const uint32_t> slice_column;  // slices + 1
    const uint32_t* neighbour = nullptr;     // 16 per column; a lane's own index is padding
    const float* factor = nullptr;           // 16 per column: of spring_stiffness; null = 1
    double spring_stiffness = 0;
    std::span<const double> diagonal;  // of anchors and of everything else with a Hessian of at most diagonal[i] I
    std::span<const Float4> particle;  // w = inverse mass; 0 = fixed
};

// Upper bound, except for the 4 % covered by kStableShare (engine/tissue/deformable_setup.hpp), on omega^2 (1/s^2)
// of the stiffest mode over all shapes the body may take. The Hessian of a spring is at most k I for every
// length (its energy is 1/2 k d^2 - k L d + const, and the second term is concave), so that of the body is at
// most (k Laplacian + diagonal) x I3: a scalar matrix that no motion changes.
// Its largest eigenvalue with respect to the masses is found by 60 Lanczos steps from a fixed random vector:
// after j steps the value found is less than (1 - e) of the true one with a probability below 1.65 sqrt(n)
// exp(-sqrt(e) (2 j - 1)) (Kuczynski, Wozniakowski, SIAM J. Matrix Anal. Appl. 13(4), 1992, theorem 4.2), for
// e = 0.04 and 100,000 particles 3e-8. Never more than the bound of Gershgorin, 2 sum k + diagonal over the
// mass. Double, one thread, fixed order: the same bits everywhere. 0 without free particles or stiffness.
double stiffest_mode(const StiffnessGraph& graph);

}  // namespace trocar
