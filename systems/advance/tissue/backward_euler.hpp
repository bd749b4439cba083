#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One step of backward Euler of a shell or sheet, and its energy accounting: the displacement u that minimises
// |u - h v|^2_M / 2 h^2 + energy(x + u), with springs, anchors, bending, pressure and gravity at the end of the step.
// Every iteration adds A^-1 force, A the constant matrix of engine/tissue/implicit_factor.hpp, pressure by the
// Sherman-Morrison formula beside it. Anderson's acceleration in A's norm ("Iterative procedures for nonlinear integral
// equations", J. ACM 12(4), 1965; for projective dynamics Peng et al., ACM TOG 37(4), 2018) combines the last
// iterates. The first is h v: at rest it is the solution, so that equilibria do not depend on the iterations.
// The step takes energy from motion, mostly from modes faster than it, never from rest.
void step_backward_euler(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state,
                         AdvanceBody& b, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
