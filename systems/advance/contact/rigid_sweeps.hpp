#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "systems/advance/island/constraints.hpp"
#include "systems/advance/island/island.hpp"
#include "systems/advance/island/swept.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Whether sweeps over compact copies can solve a constraint: each side is a free body that is neither held, driven nor guided, or
// stands still.
bool is_swept(const AdvanceIsland& island, const PreparedConstraint& constraint);

void load_bodies(const AdvanceIsland& island, std::vector<SweptBody>& bodies);
// Writes the velocities back of the bodies that the constraints touch.
void store_bodies(std::span<const SweptConstraint> constraints, std::span<const SweptBody> bodies, AdvanceIsland& island);
SweptConstraint compact(const AdvanceIsland& island, std::span<const SweptBody> bodies, PreparedConstraint& constraint);
void store_impulses(std::span<const SweptConstraint> constraints);

// As solve_angular_constraint and the conjugate directions of nncg.cpp, for all constraints of a list in order.
SweepChange sweep(std::span<SweptConstraint> constraints, std::span<SweptBody> bodies);
void move_on(double share, std::span<SweptConstraint> constraints, std::span<SweptBody> bodies);

}  // namespace trocar
#pragma GCC diagnostic pop
