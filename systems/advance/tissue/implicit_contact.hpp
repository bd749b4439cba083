#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

struct ImplicitStep;

// Constraints within an implicit step: between a body stepped by midpoint and a static or scripted one.
// Without them tissue pressed in the preceding step would spring back; impulses after the step stop its
// surface only, and at steps beyond the explicit limit the inside passes through it. So a closing constraint
// applies, within the step, the impulse -c (n . v - least) along its normal n, v the velocity of its point
// relative to its plane at the end of the step, and -c times the tangential velocity, with c lowered until
// that is within the friction limit. Both are linear in v, hence part of the matrix. (Baraff and Witkin,
// "Large steps in cloth simulation", 1998, constrain points by filtering instead, which constraints of
// several nodes cannot.) c is kHeldStiffness times the resistance of the point's nodes in the matrix.
// Constraints that would pull are released, those that close in the step are added, and the system is solved
// again. apply_impulses removes the remaining error of 1/kHeldStiffness.

// Finds them at the start of a substep.
void find_implicit_contacts(const AdvanceCall& call, const ContactConstraints& constraints, ContactSolver& solver, AdvanceIsland& island);
// Prepares those of a body for its step, whose diagonal blocks must exist. Returns whether there are any.
bool bind_implicit_contacts(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch,
                            ContactSolver& solver);
// Before each solve: adds them to the right-hand side and the blocks. Returns residual . (block * residual).
double start_implicit_contacts(const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch, ContactSolver& solver,
                               ImplicitStep& step);
// In each iteration: adds their share of matrix * direction to `applied`. Returns their part of direction .
// applied.
double apply_implicit_contacts(const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch, ContactSolver& solver);
// After each solve: releases constraints that pull, and adds those that close if `may_add`. Returns whether
// the system has changed.
bool update_implicit_contacts(const AdvanceCall& call, const TissueScratch& scratch, const AdvanceIsland& island, const AdvanceBody& b,
                              bool may_add, ContactSolver& solver);
// At the end: returns their work on the body, J.
double finish_implicit_contacts(const AdvanceIsland& island, const AdvanceBody& b, ContactSolver& solver);

}  // namespace trocar
#pragma GCC diagnostic pop
