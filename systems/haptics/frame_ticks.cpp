#include "systems/haptics/frame_ticks.hpp"

#include <algorithm>

#include "engine/devices/device.hpp"
#include "engine/jobs/trace.hpp"
namespace trocar {

void run_frame_ticks(void* user, std::span<const uint32_t> bodies, uint32_t ms) {
    const FrameTicks& in = *static_cast<FrameTicks*>(user);
    const HapticParams params = haptic_params(in.clock.contact_rate);
    const auto sample_of = [&](std::vector<DeviceState>& samples, size_t tool, size_t at) {
        return std::span(samples).subspan(tool * in.devices.per_tool + at, 1);
    };
    for (size_t t = 0; t < in.haptics.tool.size(); ++t) {
        const HandTool& tool = in.haptics.tool[t];
        if (std::ranges::find(bodies, tool.body) == bodies.end()) continue;
        const uint64_t start = now_ns();
        ToolState& state = in.haptics.state[t];
        const DeviceState sample = hand_sample(tool, sample_of(in.devices.intended, t, ms)[0], params.dt, state.output, state.hand);
        tick_tool(params, in.model[t], static_cast<double>(in.clock.tick + ms) * 1e-3, tool, effects_of(in.haptics, tool), sample,
                  in.scratch[t], state);
        if (tool.hand.mass > 0)
            predict_tool(tool, params.dt, state, sample_of(in.devices.intended, t, ms + 1), sample_of(in.devices.placed, t, ms + 1));
        in.tick_force[t * in.clock.period + ms] = state.output.force.norm();
        in.tick_ns[t * in.clock.period + ms] = now_ns() - start;
    }
}

}  // namespace trocar
