#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Index in island.rigid of a rigid body, which is added if it is new.
uint32_t rigid_slot(const AdvanceCall& call, uint32_t body, AdvanceIsland& island, const AdvanceState& state);
// Sets the poses of rigid bodies at both ends of a substep: of scripted ones and jaws; hands rotate with the
// device, free bodies stay.
void place_rigid_bodies(const AdvanceCall& call, AdvanceIsland& island);
// Applies the couplings' forces to the hands, before the constraints.
void pull_hands(const AdvanceCall& call, AdvanceIsland& island);
// Moves the hands by their velocities, after the constraints.
void move_hands(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools);
// Sets the velocities of a tool's points, and of its jaws', from its present spin.
void note_spin(const AdvanceFree& f, AdvanceIsland& island);
// Sets the poses of jaws of tools that rotate, from tool and grip, at the start of a substep, which is the
// end of the preceding one.
void carry_jaws(const AdvanceCall& call, uint32_t substep, AdvanceIsland& island);
// Adds to ToolState the grip moment of an impulse (N s) at a position (m, world) on a jaw; no effect for
// other bodies.
void add_grip_moment(const AdvanceCall& call, const AdvanceIsland& island, uint32_t rigid_index, Vec4d at, Vec4d impulse,
                     std::span<ToolState> tools);
// Pose of a tool's body frame in the hand, at the start of a substep.
struct HandPose {
    Vec3d origin;  // m, world
    Quat orientation;
    double grip = 0;  // rad
};
HandPose hand_pose(const AdvanceCall& call, uint32_t tool, uint32_t substep);

}  // namespace trocar
#pragma GCC diagnostic pop
