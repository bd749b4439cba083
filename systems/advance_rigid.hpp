#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Row of scratch.rigid of a rigid body, added when it is new.
uint32_t rigid_slot(const AdvanceCall& call, uint32_t body, AdvanceIsland& island, const AdvanceState& state);
// Places the rigid bodies at both ends of a substep: scripted ones and jaws; hands turn with the device, free ones stay.
void place_rigid_bodies(const AdvanceCall& call, AdvanceIsland& island);
// Lets the couplings pull the hands, before the rows.
void pull_hands(const AdvanceCall& call, AdvanceIsland& island);
// Puts the hands where their velocities took them, after the rows.
void move_hands(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools);
// Velocities of a tool's points, and of its jaws', from its spin now.
void note_spin(const AdvanceFree& f, AdvanceIsland& island);
// Puts the jaws of tools that turn where these and the grip have them at the start of a substep, as the end of the one before.
void carry_jaws(const AdvanceCall& call, uint32_t substep, AdvanceIsland& island);
// Adds to ToolState what an impulse (N s) at a place (m, world) on a jaw does to the grip; nothing for other bodies.
void add_grip_moment(const AdvanceCall& call, const AdvanceIsland& island, uint32_t rigid_row, Vec4d at, Vec4d impulse,
                     std::span<ToolState> tools);
// Where the body frame of a tool would be if it were in the hand, at the start of a substep.
struct HandPose {
    Vec3d origin;  // m, world
    Quat orientation;
    double grip = 0;  // rad
};
HandPose hand_pose(const AdvanceCall& call, uint32_t tool, uint32_t substep);

}  // namespace trocar
#pragma GCC diagnostic pop
