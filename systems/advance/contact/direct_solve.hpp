#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Whether the constraints of a component are between few enough free bodies, in chains rather than heaps, to be solved directly;
// numbers the bodies for it.
bool prepare_direct(const AdvanceIsland& island, ContactComponents& components, std::span<PreparedConstraint* const> constraints,
                    DirectSolve& d);
// Solves the loaded constraints as equations: normal impulses may pull, and friction of sticking ones has no
// limit. A sweep must follow, which removes the excess (the subspace step of Silcowitz, Niebe, Erleben 2010,
// "Projected Gauss-Seidel subspace minimization method for interactive rigid body dynamics"). False if the
// matrix has no factor.
bool solve_directly(const ContactComponents& components, AdvanceIsland& island, std::span<PreparedConstraint* const> constraints,
                    DirectSolve& d);
// Undoes the last solution and the changes by sweeps since then.
void undo_solution(const DirectSolve& d, AdvanceIsland& island, std::span<PreparedConstraint* const> constraints);
// The objective that the impulses minimise, J: kinetic energy, less the energy added by constraints with a
// separating target velocity.
double potential(const AdvanceIsland& island, const DirectSolve& d, std::span<PreparedConstraint* const> constraints);

}  // namespace trocar
#pragma GCC diagnostic pop
