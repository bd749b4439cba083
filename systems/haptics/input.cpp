#include "systems/haptics/input.hpp"

#include <array>

#include "engine/geometry/quaternion.hpp"
#include "systems/haptics/contact/device_motion.hpp"
#include "systems/haptics/contact/push_out.hpp"
#include "systems/haptics/tool.hpp"
namespace trocar {
namespace {

uint64_t begin_of_pass(const Clock& clock) { return pass_tick(clock.pass, clock.contact_rate); }

// Not between the rounds of a pass: they are its own.
void begin_pass(const Clock& clock, Haptics& haptics) {
    if (clock.tick != begin_of_pass(clock)) return;
    for (ToolState& state : haptics.state) state.contact_impulse = state.contact_moment = Vec3d::Zero(), state.grip_moment = 0;
}

// Live: position of a device a pass from now. Without this the simulation lags behind the hand by a pass: 1.3 mm and
// 0.8 N at 40 mm/s and 30 Hz. A hand that stops is overshot by at most kMostExtrapolated.
Vec3d extrapolate(const DeviceState& device, double seconds) {
    constexpr double kMostExtrapolated = 2e-3;  // m
    const Vec3d displacement = seconds * device.velocity;
    const double length = displacement.norm();
    return device.position + (length > kMostExtrapolated ? kMostExtrapolated / length : 1.0) * displacement;
}

}  // namespace

void read_devices(std::span<const Device> devices, uint64_t first_tick, uint32_t ticks, std::vector<DeviceState>& sample) {
    const size_t per_device = size_t{ticks} + 1;
    sample.resize(devices.size() * per_device);
    for (size_t d = 0; d < devices.size(); ++d)
        for (size_t k = 0; k < per_device; ++k)
            sample[d * per_device + k] = read_device(devices[d], static_cast<double>(first_tick + k) * 1e-3);
}

void sample_devices(const Clock& clock, const Paths& paths, Haptics& haptics, DeviceSamples& samples) {
    begin_pass(clock, haptics);
    const size_t tools = haptics.tool.size(), per_tool = clock.period + 1;
    std::array<Device, kMaxTools> device;
    for (size_t t = 0; t < tools; ++t) device[t] = device_of(haptics, paths, haptics.tool[t]);
    read_devices(std::span(device).first(tools), clock.tick, clock.period, samples.intended);
    samples.per_tool = static_cast<uint32_t>(per_tool);
    samples.placed.resize(samples.intended.size());
    for (size_t t = 0; t < tools; ++t) {
        predict_tool(haptics.tool[t], HapticParams{}.dt, haptics.state[t], std::span(samples.intended).subspan(t * per_tool, per_tool),
                     std::span(samples.placed).subspan(t * per_tool, per_tool));
        // before the first tick nothing was accepted yet
        if (!haptics.state[t].device_valid) haptics.state[t].device = samples.start(t);
    }
}

void follow_devices(const Clock& clock, Haptics& haptics, std::vector<DeviceState>& last, DeviceSamples& samples) {
    begin_pass(clock, haptics);
    const size_t tools = haptics.tool.size(), per_tool = clock.period + 1;
    const double pass = 1.0 / clock.contact_rate;
    const bool known = last.size() == tools;
    last.resize(tools);
    samples.per_tool = static_cast<uint32_t>(per_tool);
    samples.placed.resize(tools * per_tool);
    for (size_t t = 0; t < tools; ++t) {
        const DeviceState to = foretold(haptics.state[t]);
        const DeviceState from = known ? last[t] : to;
        const Vec3d start = extrapolate(from, pass), displacement = extrapolate(to, pass) - start;
        const Vec3d turn = rotation_vector(from.orientation, to.orientation);
        for (size_t ms = 0; ms < per_tool; ++ms) {
            DeviceState& device = samples.placed[t * per_tool + ms];
            const double share = static_cast<double>(ms) / static_cast<double>(per_tool - 1);
            device = to;
            device.position = start + share * displacement +
                              pushed_after(haptics.state[t].pushed, haptics.state[t].exit.goal, static_cast<double>(ms) * 1e-3);
            device.grip = from.grip + share * (to.grip - from.grip);
            device.orientation = normalized(multiply(from_rotation_vector(share * turn), from.orientation));
        }
        last[t] = to;
    }
}

void end_hand_pass(const Clock& clock, bool ticked, Haptics& haptics) {
    const double seconds = 1e-3 * static_cast<double>(clock.tick + clock.period - begin_of_pass(clock));
    for (ToolState& state : haptics.state) state.grip_torque = state.grip_moment / seconds;
    if (ticked) sum_tool_counters(haptics);
}

}  // namespace trocar
