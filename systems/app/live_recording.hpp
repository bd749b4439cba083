#pragma once
#include <filesystem>
#include <vector>

#include "engine/world.hpp"
#include "systems/app/live_haptics.hpp"
namespace trocar {

// Everything a live run took from clocks and other threads: with the scene, enough to repeat it in lockstep.
struct LiveRecording {
    uint64_t start_hash = 0;  // scene_hash of the world before the first pass
    uint64_t state_hash = 0;  // of the world after the last pass
    uint32_t tools = 0;
    std::vector<double> slip;     // s, one per pass: how far simulated time was behind the ticks
    std::vector<uint64_t> taken;  // passes x tools: the tool's state that the pass started from, by ToolState::ticks
    std::vector<LiveTick> tick;   // in the order they ran
};

// Hash of the constants and the state of a world: equal for the same scene, settings and moment.
uint64_t scene_hash(const World& world);

// Binary, 8-byte words in the machine's byte order (little endian): "trocarLR", version, tools, passes, ticks,
// start_hash, state_hash; slip and taken of each pass; the ticks; a hash of all words before. Whole or not at all.
// Throws InputError.
void write_live_recording(const std::filesystem::path& path, const LiveRecording& recording);

// Throws InputError "file: reason" for what is no recording, is cut short, is damaged or contradicts itself.
LiveRecording read_live_recording(const std::filesystem::path& path);

}  // namespace trocar
