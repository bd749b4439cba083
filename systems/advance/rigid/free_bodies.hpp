#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Adds an element of island.free and its node.
void add_free_body(const AdvanceCall& call, uint32_t rigid_index, AdvanceIsland& island, const AdvanceState& state);
// Applies gravity and damping, before the constraints.
void kick_free_bodies(const AdvanceCall& call, AdvanceIsland& island, AdvanceResult& result);
// Sets position and orientation at the end of the substep, after the constraints.
void move_free_bodies(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools);
// Writes their state to the poses. A non-finite body is restored to the start of the call, at rest, and
// counted.
void finish_free_bodies(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result);
// Sets the pose at the end of the substep from the position of the centre of mass (m, world) and an
// orientation.
void place_end(AdvanceRigid& rigid, const AdvanceFree& f, Vec4d centre, const Quat& orientation);

// Work of the constraints on free bodies, J.
double contact_work_on_free(const AdvanceIsland& island);
// Gives an active constraint its free sides, for impulses at `at` (m, world), and adds their response to
// effective_mass.
void add_angular_parts(const AdvanceIsland& island, Vec4d at, PreparedConstraint& c);
// As solve_constraint, for a constraint with a free side.
double solve_angular_constraint(AdvanceIsland& island, PreparedConstraint& c);
// Applies an impulse (N s) of a constraint with a free side.
void give_impulse(const PreparedConstraint& c, Vec4d impulse, AdvanceIsland& island);
// Velocity of the point relative to the plane, m/s, for a constraint with a free side.
Vec4d free_point_velocity(const AdvanceIsland& island, const PreparedConstraint& c);
// Adds a position correction to a constraint's free sides, shared by inverse masses as an impulse is: kg m.
void correct_free_sides(const PreparedConstraint& c, Vec4d push, AdvanceIsland& island);
// Then moves each body by the sum of its corrections, at most `most` (m).
void finish_free_corrections(const AdvanceCall& call, double most, AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
