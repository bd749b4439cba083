#pragma once
#include <array>
#include <span>
#include <vector>

#include "engine/world/world.hpp"
namespace trocar {

// Where a program told the hand of one tool to go: evenly from one pose to another between two ticks (ms), then at rest.
struct ToolMotion {
    bool on = false;  // false: the tool follows the scene's script
    uint64_t begin = 0, end = 0;
    DeviceState from, to;
    uint32_t script = kNone;  // HandTool::trace of the scene
    uint32_t trace = kNone;   // row of Haptics::trace that write_traces fills; kNone until the first target
};

// Pose of the hand at a tick.
DeviceState pose_at(const ToolMotion& motion, uint64_t tick);

// Where the hand of a tool is at a tick: by its motion, or by the scene's script.
DeviceState hand_at(const ToolMotion& motion, uint32_t tool, uint64_t tick, World& world);

// Gives the devices of all tools that are on their samples of the coming pass, one a millisecond, through recorded traces; those
// not on follow their scripts again. `keep`, for a capture: samples of passes before stay in front, and scripted paths are written
// too.
void write_traces(std::span<ToolMotion> motions, bool keep, World& world);

// A motion as numbers, and the reverse: part of a saved state.
using MotionNumbers = std::array<double, 29>;
MotionNumbers to_numbers(const ToolMotion& motion);
void from_numbers(const MotionNumbers& numbers, ToolMotion& motion);

}  // namespace trocar
