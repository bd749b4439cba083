#pragma once
#include <span>

#include "components/clock.hpp"
#include "components/haptics.hpp"
#include "systems/haptics/tool.hpp"
namespace trocar {

// What the ticks that run inside a pass work on.
struct FrameTicks {
    const Clock& clock;
    std::span<const LocalContactModel> model;  // per tool
    std::span<HapticScratch> scratch;          // per tool
    Haptics& haptics;
    DeviceSamples& devices;
    std::span<uint64_t> tick_ns;   // compute time of every tick of the pass, tool by tool
    std::span<double> tick_force;  // N, on the hand within limits, of the same ticks
};

// One millisecond of force rendering for the tools among `bodies`; `user` is a FrameTicks. The computed force moves
// the hand until the next tick.
void run_frame_ticks(void* user, std::span<const uint32_t> bodies, uint32_t ms);

}  // namespace trocar
