#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Adds to `work` (J) the change of the energy of measured bodies, and of external forces on them, since the
// last measurement: by contact impulses, or by position corrections (`corrected`).
void account_measured(const AdvanceCall& call, bool corrected, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                      double& work);

// Energy of a measured body before its step: springs, anchors, gravity and motion, J.
double energy_before(const AdvanceCall& call, const AdvanceBody& b, TissueScratch& scratch, const AdvanceState& state);
// Work of the applied external forces over the step's displacement, J.
double work_of_others(const SpringStep& step, uint32_t particles);
// Numerical work of the step, J: the change of the energy from `before`, less the known work of damping,
// other forces and constraints.
double own_work(const AdvanceCall& call, double before, double known, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b);

}  // namespace trocar
#pragma GCC diagnostic pop
