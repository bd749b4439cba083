#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Adds to `work` (J) what the energy of measured bodies, and of what pulls at them from outside, has changed by since it was
// measured last: by the rows' impulses, or by pushes (`pushed`).
void book_measured(const AdvanceCall& call, bool pushed, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                   double& work);

// Energy of a measured body where it is now, before its step of the books: springs, anchors, gravity and motion, J.
double energy_before(const AdvanceCall& call, const AdvanceBody& b, TissueScratch& scratch, const AdvanceState& state);
// Work of the forces that others put in, along the way of the step, J.
double work_of_others(const SpringStep& step, uint32_t particles);
// The step's own work, J: what the energy changed by from `before` but for what is known: damping, other forces, constraints.
double own_work(const AdvanceCall& call, double before, double known, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b);

}  // namespace trocar
#pragma GCC diagnostic pop
