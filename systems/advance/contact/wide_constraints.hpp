#pragma once
#include "systems/advance/contact/position_correction.hpp"
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Wide constraints. Long lists of constraints between deformable bodies are solved four at a time, and those
// with static bodies too if there are several groups; each function is the SIMD version of its scalar
// namesake. Constraints with a node that may be pressed from opposite sides stay scalar.

// Forms wide constraints from sorting.order, and prepares the rest as scalar ones.
void prepare_wide_constraints(const AdvanceCall& call, ContactSorting& sorting, ContactSolver& solver, AdvanceIsland& island,
                              const AdvanceState& state);
void release_wide_constraints(const AdvanceCall& call, const ContactSolver& solver, ContactConstraints& constraints, AdvanceResult& result);
// reach: m, infinite unless all velocities are finite.
void activate_wide_constraints(const AdvanceCall& call, const AdvanceState& state, const ContactNodeSet& nodes, double reach,
                               ContactSolver& solver, ConstraintGroup& group);
void warm_start_wide_constraints(const ConstraintGroup& group, ContactSolver& solver, ContactNodeSet& nodes);  // see warm_start_constraints
void solve_wide_constraints(const ConstraintGroup& group, ContactSolver& solver, ContactNodeSet& nodes);
void add_wide_impulses(const ConstraintGroup& group, ContactSolver& solver);
// Returns whether any constraint was corrected.
bool correct_wide_constraints(const AdvanceCall& call, const ContactConstraints& constraints, const CorrectionSweep& sweep,
                              const ConstraintGroup& group, ContactSolver& solver, ContactNodeSet& nodes);
// Deepest overlap of the active constraints after the corrections, m.
double deepest_in_wide(const ContactNodeSet& nodes, const ConstraintGroup& group, ContactSolver& solver);

}  // namespace trocar
#pragma GCC diagnostic pop
