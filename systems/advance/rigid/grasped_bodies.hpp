#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Free rigid bodies between the jaws of instruments (ToolGrasp). Two pads hold a point and the orientation of the body by
// springs, critically damped for the mass of the body, whose values at the end of a substep act (a soft constraint): stable
// for any step, mass and stiffness, equal and opposite on body and hand. By Coulomb they bear 2 mu N and, two uniformly pressed
// discs, 4/3 mu N r; beyond the body slides: the held point and orientation follow it.

// Stiffness of the pads for turns, N m/rad: that of an elastic layer over a disc about its normal, k r^2 / 2, for all axes.
inline double turn_stiffness_of(const ToolAction& action) { return 0.5 * action.stiffness * action.pad * action.pad; }
inline double most_force(const ToolAction& action) { return 2 * action.friction * action.press_force; }
inline double most_torque(const ToolAction& action) { return 2.0 / 3.0 * most_force(action) * action.pad; }

// The grasps of bodies of the island, before its first substep.
void gather_grasps(const AdvanceCall& call, AdvanceIsland& island, const AdvanceState& state);
// Their impulses, after all other kicks of a substep but the constraints'.
void pull_grasped_bodies(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools, AdvanceResult& result);
// Their work, once the velocities of the substep are known: the hand's on the pads, less what the body and the pads took is
// lost in them (work_contact).
void account_grasps(const AdvanceCall& call, const AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
