#pragma once
#include <span>

#include "systems/haptics/tick.hpp"
namespace trocar {

// One complete tick of one tool: pose (place_tool), contact (haptic_tick, or point_shell_tick for a tool with a
// point shell), effects, passivity, limits, events. An instrument that is not in the hand (model.in_hand)
// only gets its pose, without buttons and forces. `device` is the sample in the device's own frame.
// state.command is the contact force, state.output the device command in its frame. Same code in lockstep and
// live; depends on its arguments alone; no allocation once warm.
void tick_tool(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
               std::span<const HapticEffect> effects, const DeviceState& device, HapticScratch& scratch, ToolState& state);

// Runs the contact of the next tick on a model that is new to a tool, with its device where it is, and
// discards the result. This loads the model into the caches and halves the time of that tick. Called after
// the force of a tick is sent; no later result depends on it. Does nothing for a tool with a point shell.
void rehearse_tick(const HapticParams& params, const LocalContactModel& model, const HandTool& tool, const ToolState& state,
                   HapticScratch& scratch);

// Device sample of a tool whose hand intends to be at `intended`: that position, or for a hand that yields
// (tool.hand) the one to which forces moved it in a tick under the last output.
DeviceState hand_sample(const HandTool& tool, const DeviceState& intended, double dt, const DeviceCommand& output, HandModelState& hand);

// Poses of a simulated tool at the coming ticks, moved out of a body if it is inside one; `intended` has one sample per tick. Exact for a
// hand that forces do not move, else under the assumption of constant forces. Changes no state.
void predict_tool(const HandTool& tool, double dt, const ToolState& state, std::span<const DeviceState> intended,
                  std::span<DeviceState> placed);

}  // namespace trocar
