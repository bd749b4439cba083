#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Makes the row of scratch.free and the node of one.
void add_free_body(const AdvanceCall& call, uint32_t rigid_row, AdvanceIsland& island, const AdvanceState& state);
// Gravity and damping, before the rows.
void kick_free_bodies(const AdvanceCall& call, AdvanceIsland& island, AdvanceResult& result);
// Place and orientation at the end of the substep, after the rows.
void move_free_bodies(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools);
// Writes their state back into the poses. A body that is not finite keeps the one from the start of the call, at rest, counted.
void finish_free_bodies(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result);
// Puts the end of the substep where the node of a free body is at `centre` (m, world) under an orientation.
void place_end(AdvanceRigid& rigid, const AdvanceFree& f, Vec4d centre, const Quat& orientation);

// Work of the rows on free bodies, J.
double contact_work_on_free(const AdvanceIsland& island);
// Gives an active row its free sides, where the impulse acts at `at` (m, world), and what they add to inv_sum.
void add_turning_sides(const AdvanceIsland& island, Vec4d at, PreparedConstraint& c);
// As solve_row for a row with a free side.
double solve_turning_row(AdvanceIsland& island, PreparedConstraint& c);
// Gives a row with a free side an impulse, N s.
void give_impulse(const PreparedConstraint& c, Vec4d impulse, AdvanceIsland& island);
// Velocity of the point relative to the plane, m/s, of a row with a free side.
Vec4d turning_velocity(const AdvanceIsland& island, const PreparedConstraint& c);
// Moves the points of a row's free sides by their share of a push, which like an impulse is shared by inverse masses: kg m.
void push_free_sides(const PreparedConstraint& c, Vec4d push, AdvanceIsland& island);
// Then the bodies follow: all pushes of one at once, none farther than `most` (m).
void finish_free_pushes(const AdvanceCall& call, double most, AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
