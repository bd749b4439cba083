#pragma once
#include <span>

#include "systems/haptic_tick.hpp"
namespace trocar {

// One whole tick of one tool: where it is (place_tool), contact (haptic_tick, or shell_tick for a tool with a shell),
// effects, passivity, limits, events. Of an instrument that is not in the hand (model.in_hand) the place alone, without
// buttons and forces. `device` is what the device reported, in its own frame. state.command is the force of contact,
// state.output what the device is told, in its frame. The same code in lockstep and live; depends on its arguments alone; no
// allocation once warm.
void tick_tool(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
               std::span<const HapticEffect> effects, const DeviceState& device, HapticScratch& scratch, ToolState& state);

// Goes through the contact of the next tick on a model that is new to a tool, its device where it is, and forgets the answer.
// Then the model lies in the caches and that tick takes half as long. Called when the force of a tick is out; no later answer
// depends on it. A tool with a shell has nothing to rehearse.
void rehearse_tick(const HapticParams& params, const LocalContactModel& model, const HandTool& tool, const ToolState& state,
                   HapticScratch& scratch);

// What the device under a tool reports when its hand means to be at `intended`: that, or where forces pushed a hand that
// gives way (tool.hand, moved on by a tick under the last output).
DeviceState hand_sample(const HandTool& tool, const DeviceState& intended, double dt, const DeviceCommand& output, HandModelState& hand);

// Where a tool will be at the coming ticks, `intended` being one sample a tick: exact for a hand that no force moves,
// else for forces that stay as they are. Changes no state.
void predict_tool(const HandTool& tool, double dt, const ToolState& state, std::span<const DeviceState> intended,
                  std::span<DeviceState> placed);

}  // namespace trocar
