#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_push.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Wide constraints. Long lists of constraints between deformable bodies are solved four at a time, and where there are several groups
// those with static bodies too; each function does what its namesake for one constraint does. A constraint any of whose nodes may be
// pressed from both sides is in no block.

// Makes blocks of the constraints in sorting.dealt, and prepares those that are in none.
void plan_blocks(const AdvanceCall& call, ContactSorting& sorting, ContactSolver& solver, AdvanceIsland& island, const AdvanceState& state);
void forget_blocks(const AdvanceCall& call, const ContactSolver& solver, ContactRows& rows, AdvanceResult& result);
// reach: m, infinite unless all velocities are finite.
void activate_blocks(const AdvanceCall& call, const ContactNodeSet& nodes, double reach, ContactSolver& solver, RowGroup& group);
void start_blocks(const RowGroup& group, ContactSolver& solver, ContactNodeSet& nodes);  // see start_rows
void solve_blocks(const RowGroup& group, ContactSolver& solver, ContactNodeSet& nodes);
void add_block_impulses(const RowGroup& group, ContactSolver& solver);
// Returns whether any constraint was pushed.
bool push_blocks(const AdvanceCall& call, const ContactRows& rows, const PushSweep& sweep, const RowGroup& group, ContactSolver& solver,
                 ContactNodeSet& nodes);
// Deepest overlap of the active rows after the pushes, m.
double deepest_in_blocks(const ContactNodeSet& nodes, const RowGroup& group, ContactSolver& solver);

}  // namespace trocar
#pragma GCC diagnostic pop
