#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

struct ImplicitStep;

// Constraints within an implicit step: those between a body stepped by midpoint and one whose motion is given (static or scripted).
// A step that knew nothing of them would let tissue that was pressed in the step before spring back; impulses after it stop its surface
// only, and at steps beyond the explicit limit the inside runs through it. So a constraint that closes gives, within the step, the
// impulse -c (n . v - least) along its normal n, v the velocity of its point relative to its plane at the end of the step, and across
// it -c times the velocity there, with c lowered until that is within the friction limit. Both are linear in v, hence part of the
// matrix. (Baraff and Witkin, "Large steps in cloth simulation", 1998, hold points by filtering instead, which constraints of several
// nodes cannot.) c is kHeldStiffness times the resistance of the point's nodes in the matrix.
// Constraints that would pull are let go, those that the step closes join, and the system is solved again. What is left,
// 1/kHeldStiffness of it, apply_impulses takes.

// Finds them at the start of a substep (advance_contact.cpp).
void find_held_rows(const AdvanceCall& call, const ContactRows& rows, ContactSolver& solver, AdvanceIsland& island);
// Makes those of a body ready for its step; its blocks must be there. Returns whether there are any.
bool bind_held_rows(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch,
                    ContactSolver& solver);
// Before each solve: adds their share of the right-hand side and of the blocks. Returns residual . (block * residual).
double start_held_rows(const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch, ContactSolver& solver,
                       ImplicitStep& step);
// In each iteration: adds their share of matrix * direction to `applied`. Returns their part of direction . applied.
double apply_held_rows(const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch, ContactSolver& solver);
// After each solve: lets constraints go that pull, and adds those that close if `may_add`. Returns whether the system has changed.
bool judge_held_rows(const AdvanceCall& call, const TissueScratch& scratch, const AdvanceIsland& island, const AdvanceBody& b, bool may_add,
                     ContactSolver& solver);
// At the end: returns their work on the body, J.
double settle_held_rows(const AdvanceIsland& island, const AdvanceBody& b, ContactSolver& solver);

}  // namespace trocar
#pragma GCC diagnostic pop
