#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Whether contact constraints touch a body that is stepped implicitly.
bool has_touched_implicit(const AdvanceIsland& island);
// Starts the steps of the touched implicit bodies.
void begin_touched_steps(const AdvanceCall& call, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                         AdvanceResult& result);
// Solves the active constraints together with the steps of the touched implicit bodies, whose energy it accounts for. Velocities of
// all other nodes are those after the kick. For apply_impulses.
void solve_with_implicit(const AdvanceCall& call, TissueScratch& scratch, ContactSolver& solver, AdvanceIsland& island,
                         const AdvanceState& state, AdvanceResult& result);
// Books the position corrections of touched implicit bodies.
void account_implicit_corrections(const AdvanceCall& call, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                                  AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
