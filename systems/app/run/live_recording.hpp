#pragma once
#include <filesystem>
#include <vector>

#include "engine/world/world.hpp"
#include "systems/app/view/view_command.hpp"
#include "systems/haptics/live_haptics.hpp"
namespace trocar {

// All inputs of a run from clocks, other threads and viewers: with the scene, enough to repeat it in lockstep.
struct LiveRecording {
    bool lockstep = false;    // a run with a view, not against the clock: no ticks, `tools` is 0
    bool viewed = false;      // viewers could hold bodies: see ViewerActions::make_room
    uint64_t start_hash = 0;  // scene_hash of the world before the first pass
    uint64_t state_hash = 0;  // of the world after the last pass
    uint32_t tools = 0;
    std::vector<double> slip;          // s, per pass: delay of simulated time relative to the ticks
    std::vector<uint64_t> taken;       // passes x tools: ToolState::ticks of the state that the pass started from
    std::vector<LiveTick> tick;        // in execution order
    std::vector<ViewCommand> command;  // ascending by pass
};

// Hash of the constants and the state of a world: equal for the same scene, settings and time.
uint64_t scene_hash(const World& world);

// Binary, 8-byte little-endian words: "trocarLR", version, tools, passes, ticks, start_hash, state_hash, flags (1 lockstep, 2 viewed),
// words of the commands; slip and taken of each pass; the ticks; the commands as lines of text, padded with spaces; a hash of all
// preceding words. Completely or not. Throws InputError.
void write_live_recording(const std::filesystem::path& path, const LiveRecording& recording);

// Reads this version and the one before, which had neither flags nor commands. Throws InputError "file: reason" if the file is not a
// recording, is truncated, damaged or inconsistent.
LiveRecording read_live_recording(const std::filesystem::path& path);

}  // namespace trocar
