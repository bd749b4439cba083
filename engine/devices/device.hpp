#pragma once
#include <filesystem>
#include <span>
#include <string>

#include "components/device.hpp"
#include "components/haptic_effect.hpp"
#include "components/haptics.hpp"
#include "components/paths.hpp"
#include "components/tool.hpp"
namespace trocar {

// Tremor of a hand: each axis oscillates with `amplitude` at its own frequency near `frequency`. 0 = off.
struct Tremor {
    double amplitude = 0;  // m
    double frequency = 9;  // Hz
};

// Source of hand states: a recording, or without one a script. Views data that outlive it.
struct Device {
    std::span<const Keyframe> path;
    Tremor tremor;
    std::span<const DeviceState> trace;
};

// The device of a tool: its trace if it has one, else its path.
Device device_of(const Haptics& haptics, const Paths& paths, const HandTool& tool);

// Its range of Haptics::effect.
std::span<const HapticEffect> effects_of(const Haptics& haptics, const HandTool& tool);

// Newest state at a time (s). Scripted: smooth through the keys as in sample_path, discontinuous where a key
// jumps. Recorded: the last sample not after `time`, unchanged (its own time included); before the first
// sample, the first. Deterministic.
DeviceState read_device(const Device& device, double time);

// Reads a recording: a header line "time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons" (and ",grip", rad), then one
// sample per line, s and m, time ascending. An invalid line throws InputError "file:line:column: reason".
DeviceTrace read_device_trace(const std::filesystem::path& path);

// Writes a recording that reads back bitwise; completely or not at all. Throws InputError.
void write_device_trace(const std::filesystem::path& path, std::span<const DeviceState> samples);

}  // namespace trocar
