#pragma once
#include <filesystem>
#include <vector>

#include "engine/world/world.hpp"
#include "systems/haptics/live_haptics.hpp"
namespace trocar {

// All inputs of a live run from clocks and other threads: with the scene, enough to repeat it in lockstep.
struct LiveRecording {
    uint64_t start_hash = 0;  // scene_hash of the world before the first pass
    uint64_t state_hash = 0;  // of the world after the last pass
    uint32_t tools = 0;
    std::vector<double> slip;     // s, per pass: delay of simulated time relative to the ticks
    std::vector<uint64_t> taken;  // passes x tools: ToolState::ticks of the state that the pass started from
    std::vector<LiveTick> tick;   // in execution order
};

// Hash of the constants and the state of a world: equal for the same scene, settings and time.
uint64_t scene_hash(const World& world);

// Binary, 8-byte little-endian words: "trocarLR", version, tools, passes, ticks, start_hash, state_hash; slip
// and taken of each pass; the ticks; a hash of all preceding words. Completely or not. Throws InputError.
void write_live_recording(const std::filesystem::path& path, const LiveRecording& recording);

// Throws InputError "file: reason" if the file is not a recording, is truncated, damaged or inconsistent.
LiveRecording read_live_recording(const std::filesystem::path& path);

}  // namespace trocar
