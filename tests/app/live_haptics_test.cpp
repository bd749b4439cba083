#include "systems/haptics/live_haptics.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include "systems/haptics/tool.hpp"
#include "tests/reference/local_patches.hpp"
namespace trocar {
namespace {

// Preallocated memory for the inputs of the haptic thread, which fills it; read (except the count) after the
// thread has ended.
struct Recording {
    std::vector<LiveTick> tick;
    std::atomic<size_t> count = 0;
    static void record(void* user, const LiveTick& tick) {
        Recording& r = *static_cast<Recording*>(user);
        if (r.count < r.tick.size()) r.tick[r.count++] = tick;
    }
};

HandTool plain_tool() {
    HandTool tool;
    tool.tip_radius = 3e-3;
    return tool;
}

LocalContactModel rising_plane(uint64_t sequence, double time) {
    LocalContactModel model = reference::make_patch(reference::make_plane());
    model.sequence = sequence;
    model.time = time;
    model.velocity.assign(model.position.size(), Vec3d(0, 0, 0.01));
    for (Vec3d& p : model.position) p.z() += 0.01 * time;
    group_triangles(model);
    return model;
}

// Two tools tick while another thread publishes surfaces: ticks arrive, states come back, and ticking the
// recorded inputs again without threads gives bit-identical forces. Breaks when a tick reads anything but its
// mailbox values, or a torn value.
TEST(LiveHaptics, RecordedValuesReplayToTheSameForces) {
    const HapticParams params;
    const std::vector<Keyframe> path = {{0.0, {0, 0, 0.01}, {}, 0}, {0.1, {0, 0, 0.001}, {}, 0}, {0.3, {0.01, 0, 0.0}, {}, 0}};
    const std::vector<HandTool> tools(2, plain_tool());
    std::vector<Device> devices(2);
    devices[0].path = devices[1].path = path;
    devices[1].tremor.amplitude = 1e-4;
    Recording recording;
    recording.tick.resize(20'000);
    LiveHaptics live(params, tools, devices, {&Recording::record, &recording});
    PeriodicOptions options;
    options.real_time = false;  // the test shares its cores
    const int64_t start = monotonic_ns();
    std::vector<LocalContactModel> published;
    Haptics haptics;
    haptics.tool = tools;
    haptics.state.resize(2);
    haptics.state[0].contact_impulse = {1, 2, 3};
    EXPECT_FALSE(live.take_states(haptics));
    live.start(options, start);
    bool taken = false;
    for (uint64_t pass = 0; pass < 20; ++pass) {
        const double time = static_cast<double>(monotonic_ns() - start) * 1e-9;
        published.push_back(rising_plane(pass + 1, time));
        for (uint32_t k = 0; k < 2; ++k) {
            live.model_to_fill(k) = published.back();
            live.publish_model(k);
        }
        sleep_until_ns(monotonic_ns() + 16'000'000);
        taken = live.take_states(haptics) || taken;
    }
    live.stop();
    live.take_states(haptics);
    EXPECT_TRUE(taken);
    EXPECT_EQ(haptics.state[0].contact_impulse, Vec3d(1, 2, 3));  // kept from the simulation
    EXPECT_GT(haptics.state[0].command.force.z(), 0.5);
    EXPECT_GT(haptics.ticks, 100u);
    EXPECT_EQ(haptics.ticks, recording.count);
    EXPECT_EQ(haptics.max_force, live.figures().max_force);
    EXPECT_EQ(live.timing().compute.count * 2, recording.count);
    EXPECT_GT(live.figures().contact_age.count, 100u);

    std::vector<ToolState> state(2);
    HapticScratch scratch;
    const LocalContactModel nothing;
    std::vector<uint64_t> last_sequence(2, 0);
    for (size_t k = 0; k < recording.count; ++k) {
        const LiveTick& t = recording.tick[k];
        ASSERT_GE(t.model_sequence, last_sequence[t.tool]);
        last_sequence[t.tool] = t.model_sequence;
        const LocalContactModel& model = t.model_sequence > 0 ? published[t.model_sequence - 1] : nothing;
        const double time = static_cast<double>(t.tick) * static_cast<double>(options.period) * 1e-9;
        tick_tool(params, model, time, tools[t.tool], {}, t.sample, scratch, state[t.tool]);
        ASSERT_EQ(state[t.tool].output.force, t.force) << k;
    }
    EXPECT_EQ(state[0].proxy, haptics.state[0].proxy);
}

// Both tools get new surfaces at the same time: they take them in different ticks, and neither misses one
// that waits for four ticks. Breaks when a tick takes all waiting surfaces.
TEST(LiveHaptics, OneToolATickTakesANewSurface) {
    const std::vector<HandTool> tools(2, plain_tool());
    std::vector<Device> devices(2);
    const std::vector<Keyframe> path = {{0.0, {0, 0, 0.01}, {}, 0}, {0.1, {0, 0, 0.001}, {}, 0}};
    devices[0].path = devices[1].path = path;
    Recording recording;
    recording.tick.resize(20'000);
    LiveHaptics live({}, tools, devices, {&Recording::record, &recording});
    PeriodicOptions options;
    options.real_time = false;
    const int64_t start = monotonic_ns();
    live.start(options, start);
    constexpr uint64_t kPasses = 20;
    for (uint64_t pass = 0; pass < kPasses; ++pass) {
        for (uint32_t k = 0; k < 2; ++k) {
            live.model_to_fill(k) = rising_plane(pass + 1, static_cast<double>(monotonic_ns() - start) * 1e-9);
            live.publish_model(k);
        }
        for (const size_t enough = recording.count + 8; recording.count < enough;) sleep_until_ns(monotonic_ns() + 1'000'000);
    }
    live.stop();
    std::array<std::vector<uint64_t>, 2> taken_at;  // ticks, per tool
    std::array<uint64_t, 2> sequence{};
    for (size_t k = 0; k < recording.count; ++k) {
        const LiveTick& t = recording.tick[k];
        if (t.model_sequence > sequence[t.tool]) taken_at[t.tool].push_back(t.tick);
        sequence[t.tool] = t.model_sequence;
    }
    EXPECT_EQ(taken_at[0].size(), kPasses);
    EXPECT_EQ(taken_at[1].size(), kPasses);
    for (const uint64_t tick : taken_at[0]) EXPECT_EQ(std::count(taken_at[1].begin(), taken_at[1].end(), tick), 0) << tick;
}

// The simulation computes the link forces on a tool: the state from a tick must not overwrite them before
// they are published.
TEST(LiveHaptics, TheSimulationsOwnForcesStay) {
    ToolState newest, state;
    newest.ticks = 7;
    state.link_force = {1, 2, 3}, state.link_force_before = {4, 5, 6}, state.contact_impulse = {7, 8, 9};
    take_tool_state(newest, state);
    EXPECT_EQ(state.ticks, 7u);
    EXPECT_EQ(state.link_force, Vec3d(1, 2, 3));
    EXPECT_EQ(state.link_force_before, Vec3d(4, 5, 6));
    EXPECT_EQ(state.contact_impulse, Vec3d(7, 8, 9));
}

// A simulation that fell behind by more than the watchdog allows publishes models with their true age. Breaks
// when the slip is not added to the models' time.
TEST(LiveHaptics, ModelsOfALateSimulationAreFresh) {
    const std::vector<Keyframe> path = {{0.0, {0, 0, 0.01}, {}, 0}, {0.05, {0, 0, 0.001}, {}, 0}};
    const std::vector<HandTool> tools(1, plain_tool());
    std::vector<Device> devices(1);
    devices[0].path = path;
    LiveHaptics live({}, tools, devices);
    PeriodicOptions options;
    options.real_time = false;
    const int64_t start = monotonic_ns();
    live.set_slip(0.5);
    live.start(options, start - 500'000'000);  // the haptic clock is half a second ahead
    for (int pass = 0; pass < 20; ++pass) {
        live.model_to_fill(0) = reference::make_patch(reference::make_plane());
        live.model_to_fill(0).time = static_cast<double>(monotonic_ns() - start) * 1e-9;
        live.publish_model(0);
        sleep_until_ns(monotonic_ns() + 16'000'000);
    }
    live.stop();
    Haptics haptics;
    haptics.state.resize(1);
    live.take_states(haptics);
    EXPECT_TRUE(haptics.state[0].device_valid);
    EXPECT_LT(haptics.state[0].model_age, 0.4);
    EXPECT_GT(live.figures().contact_age.count, 0u);
    EXPECT_LT(live.figures().contact_age.percentile(0.5), 400'000'000);
}

// Watchdog: the simulation stops publishing while the hand presses. 20 ms of simulated time after the surface
// becomes too old there is no force. The limit is 0.1 s unless the tool sets one.
class StalledSimulation : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(LiveHaptics, StalledSimulation, testing::Values(0.0, 0.06));
TEST_P(StalledSimulation, LetsTheForceGo) {
    const HapticParams params;
    const double oldest = GetParam() > 0 ? GetParam() : params.model_timeout;
    const std::vector<Keyframe> path = {{0.0, {0, 0, 0.01}, {}, 0}, {0.05, {0, 0, 0.001}, {}, 0}};
    std::vector<HandTool> tools(1, plain_tool());
    tools[0].limits.surface_age = GetParam();
    std::vector<Device> devices(1);
    devices[0].path = path;
    Recording recording;
    recording.tick.resize(20'000);
    LiveHaptics live(params, tools, devices, {&Recording::record, &recording});
    PeriodicOptions options;
    options.real_time = false;
    live.model_to_fill(0) = reference::make_patch(reference::make_plane());
    live.publish_model(0);
    live.start(options, monotonic_ns());
    sleep_until_ns(monotonic_ns() + 300'000'000);
    live.stop();
    bool pressed = false;
    for (size_t k = 0; k < recording.count; ++k) {
        const double age = static_cast<double>(recording.tick[k].tick) * 1e-3;  // the model has time 0
        pressed = pressed || recording.tick[k].force.norm() > 0.5;
        // (a missed tick leaves its part of the ramp to the next one)
        if (age > oldest + 0.02) {
            EXPECT_EQ(recording.tick[k].force.norm(), 0) << age;
        }
    }
    EXPECT_TRUE(pressed);
    EXPECT_GT(recording.count, 0u);
}

}  // namespace
}  // namespace trocar
