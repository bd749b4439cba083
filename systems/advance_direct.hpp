#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Whether the constraints of a component are between few enough free bodies, in chains rather than heaps, to be solved directly;
// numbers the bodies for it.
bool prepare_direct(const AdvanceIsland& island, ContactComponents& components, std::span<PreparedConstraint* const> rows, DirectSolve& d);
// Solves the constraints that carry load as equations: normals may pull, and friction of those that stick has no limit. A sweep must
// follow, which takes back what is too much (the subspace step of Silcowitz, Niebe, Erleben 2010, "Projected Gauss-Seidel subspace
// minimization method for interactive rigid body dynamics"). False if the matrix has no factor.
bool solve_directly(const ContactComponents& components, AdvanceIsland& island, std::span<PreparedConstraint* const> rows, DirectSolve& d);
// Takes the last solution back, and what sweeps have changed since.
void undo_solution(const DirectSolve& d, AdvanceIsland& island, std::span<PreparedConstraint* const> rows);
// What the impulses minimise, J: kinetic energy, minus what constraints that ask bodies to move apart put in.
double potential(const AdvanceIsland& island, const DirectSolve& d, std::span<PreparedConstraint* const> rows);

}  // namespace trocar
#pragma GCC diagnostic pop
