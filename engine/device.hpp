#pragma once
#include <filesystem>
#include <span>
#include <string>

#include "components/haptics.hpp"
#include "components/paths.hpp"
namespace trocar {

enum class DeviceKind : uint8_t {
    kScripted,  // follows keys
    kTrace,     // plays a recording
};

// Trembling of a hand: each axis swings by `amplitude` at its own frequency near `frequency`. Off at amplitude 0.
struct Tremor {
    double amplitude = 0;  // m
    double frequency = 9;  // Hz
};

// Where hand states come from. Views data that outlive it; new kinds get a case in read_device.
struct Device {
    DeviceKind kind = DeviceKind::kScripted;
    std::span<const Keyframe> path;      // kScripted
    Tremor tremor;                       // kScripted
    std::span<const DeviceState> trace;  // kTrace, not empty
};

// The device that holds a tool: its trace if it has one, else its path.
Device device_of(const Haptics& haptics, const Paths& paths, const HandTool& tool);

// Its rows of Haptics::effect.
std::span<const HapticEffect> effects_of(const Haptics& haptics, const HandTool& tool);

// Newest state at a time (s). Scripted: smooth through the keys as sample_path does, at once where a key jumps.
// Recorded: the last sample not after `time` exactly as it was recorded (its own time included), the first one before
// that. Depends on its arguments alone.
DeviceState read_device(const Device& device, double time);

// Reads a recording: a header line "time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons" (and ",grip", rad), then one sample a line,
// s and m, time ascending. A bad line throws InputError "file:line:column: reason".
DeviceTrace read_device_trace(const std::filesystem::path& path);

// Writes a recording that reads back bit for bit; whole or not at all. Throws InputError.
void write_device_trace(const std::filesystem::path& path, std::span<const DeviceState> samples);

}  // namespace trocar
