#include <gtest/gtest.h>

#include <functional>

#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "systems/haptics/contact/device_motion.hpp"
#include "tests/frame/scenes_under_test.hpp"

// Data that one stage leaves for another is a resource of World: a run whose scratch is discarded between
// every two stages has the same resources after every pass. Breaks when a stage reads data that another one
// left in its scratch, in this pass or before, or when a cache changes a result.
namespace {
using namespace trocar;

// Called with both frames before a pass; may be empty.
using BeforePass = std::function<void(Frame&, uint32_t pass)>;

// Data compared besides the state. Counters of cache use may differ.
bool is_compared(Resource r) { return r != Resource::kReport; }

void expect_same(const std::function<BuiltScene()>& build, uint32_t passes, FrameOptions options = {}, const BeforePass& before = {},
                 bool (*compared)(Resource) = is_compared) {
    ThreadPool pool(1);
    pool.run([&] {
        options.serial = true;
        FrameOptions clearing = options;
        clearing.clear_scratch = true;
        Frame keeps(std::move(build().world), options), clears(std::move(build().world), clearing);
        for (uint32_t pass = 0; pass < passes; ++pass) {
            for (Frame* frame : {&keeps, &clears}) {
                if (before) before(*frame, pass);
                frame->step();
            }
            ASSERT_EQ(state_hash(keeps.world()), state_hash(clears.world())) << "pass " << pass;
            for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
                const Resource resource = static_cast<Resource>(r);
                if (!compared(resource)) continue;
                ASSERT_EQ(resource_hash(keeps.world(), resource), resource_hash(clears.world(), resource))
                    << resource_name(resource) << " in pass " << pass;
            }
        }
    });
}

BuiltScene built(const std::string& file, const std::vector<Override>& overrides) {
    const auto path = source_folder() / "content/scenes" / (file + ".toml");
    return build_scene(read_scene_file(path, overrides), Looks::kPlain);
}

class ClearScratch : public testing::TestWithParam<std::string> {};

TEST_P(ClearScratch, BetweenAnyTwoStages) {
    expect_same([] { return small_scene(GetParam()); }, 60);
}

INSTANTIATE_TEST_SUITE_P(Scenes, ClearScratch, testing::ValuesIn(scene_names()), [](const auto& info) { return info.param; });

INSTANTIATE_TEST_SUITE_P(Wet, ClearScratch, testing::Values("bleed_and_suck", "smoke"), [](const auto& info) { return info.param; });

// A mesh stepped implicitly falls on a wall.
TEST(ClearScratchMore, ImplicitContact) {
    expect_same([] { return built("mesh_on_wall", {{"mesh.integrator", "implicit"}, {"mesh.triangles", "200"}, {"wall.triangles", "1000"}}); },
                20);
}

// Bodies that are spawned, fall asleep, are removed asleep, and are spawned again.
TEST(ClearScratchMore, Pools) {
    expect_same(
        [] {
            return built(
                "stress_come_and_go",
                {{"count", "6"}, {"rate", "25"}, {"life", "1.5"}, {"resolution", "80"}, {"sleep_speed", "0.5"}, {"sleep_after", "0.1"}});
        },
        60 * 3);
}

TEST(ClearScratchMore, SoftBodiesFallAsleep) {
    expect_same([] { return built("stress_settle", {{"count", "9"}, {"sleep_speed", "0.05"}, {"sleep_after", "0.1"}}); }, 60 * 2);
}

// The state alone: while a free body sleeps its box keeps the margin of the pass that last computed it, and
// passes take 16 or 17 ms.
TEST(ClearScratchMore, FreeBodiesFallAsleep) {
    expect_same(
        [] {
            return built("rigid_stack", {{"sleep_speed", "0.05"}, {"sleep_after", "0.1"}});
        },
        60 * 2, {}, {}, [](Resource) { return false; });
}

// A live run, with device samples that arrive while no stage runs.
TEST(ClearScratchMore, Live) {
    FrameOptions options;
    options.external_ticks = true;
    const auto move = [](Frame& frame, uint32_t) {
        World& w = frame.world();
        const HapticParams params;
        for (uint32_t ms = 0; ms < 16; ++ms) {
            const double time = static_cast<double>(w.clock.tick + ms) * 1e-3;
            for (ToolState& state : w.haptics.state) {
                DeviceState sample = state.device_valid ? state.device : DeviceState{};
                sample.time = time;
                sample.position += Vec3d(2e-5, 0, -5e-5);
                take_sample(params, sample, state);
            }
        }
    };
    expect_same([] { return small_scene("probe_on_liver"); }, 60, options, move);
}

}  // namespace
