// Conditions of runs that last for days. S02, S03: clocks and counters near 32-bit overflow; everything
// independent of the time of day continues bit for bit as from a clock at zero. S04 to S06: denormals,
// libraries that change the float mode, clocks that are set.
#include <gtest/gtest.h>
#include <xmmintrin.h>

#include <atomic>
#include <cfenv>
#include <fstream>
#include <limits>
#include <sstream>
#include <vector>

#include "content/scene/build_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "tests/frame/written_scene.hpp"
#include "tests/reference/paths.hpp"
namespace trocar {
namespace {

constexpr uint32_t kRate = 60;             // Hz
constexpr uint64_t kWholeSeconds = kRate;  // passes: the milliseconds of a pass repeat every third one,
                                           // bodies of a pool are spawned every fortieth

// The pass `before` passes ahead of the one at which the number of milliseconds, or of passes, needs more
// than `bits` bits.
uint64_t pass_before_tick(int bits, uint64_t before) {
    const uint64_t pass = (uint64_t{1} << bits) / 1000 * kRate - before;
    return pass / kWholeSeconds * kWholeSeconds;
}
std::vector<uint64_t> late_passes(uint64_t before) {
    return {pass_before_tick(31, before), pass_before_tick(32, before), ((uint64_t{1} << 32) - before) / kWholeSeconds * kWholeSeconds};
}

void start_clock(World& w, uint64_t pass) {
    w.clock.pass = pass;
    w.clock.tick = pass_tick(pass, w.clock.contact_rate);
    w.clock.picture = pass * w.clock.display_rate / w.clock.contact_rate;
}

// Results of `look` after each of some passes of a world whose clock starts at `pass`; checks that the ticks
// follow the integer rule.
template <typename Look>
std::vector<uint64_t> tell(World world, uint64_t pass, int passes, const Look& look) {
    std::vector<uint64_t> told;
    start_clock(world, pass);
    run(std::move(world), passes, [&](Frame& f, int i) {
        const Clock& clock = f.world().clock;
        EXPECT_EQ(clock.pass, pass + uint64_t(i) + 1);
        EXPECT_EQ(clock.tick, clock.pass * 1000 / kRate);
        EXPECT_EQ(f.times().picture, clock.pass % 2 == 0) << clock.pass;
        told.push_back(look(f.world()));
    });
    return told;
}

TEST(LongRun, S03_FreeBodiesFallAsTheyDoFromZero) {
    const auto world = [] {
        return std::move(build_scene(read_scene_file(source_folder() / "content/scenes/rigid_stack.toml", {}), Looks::kPlain).world);
    };
    const auto hash = [](const World& w) {
        StateHash h;
        for (size_t body = 0; body < w.bodies.mesh.size(); ++body) {
            for (int k = 0; k < 3; ++k) h.add(w.poses.origin[body][k]), h.add(w.poses.velocity[body][k]);
            const Quat& q = w.poses.orientation[body];
            h.add(q.w), h.add(q.x), h.add(q.y), h.add(q.z);
        }
        h.add(w.contacts.pair.size());
        return h.value;
    };
    constexpr int kPasses = 2 * int(kWholeSeconds);
    const std::vector<uint64_t> from_zero = tell(world(), 0, kPasses, hash);
    ASSERT_NE(from_zero.front(), from_zero.back());
    for (const uint64_t pass : late_passes(30)) EXPECT_EQ(tell(world(), pass, kPasses, hash), from_zero) << pass;
}

TEST(LongRun, S03_BodiesComeAndGoAsTheyDoFromZero) {
    constexpr double kBodiesASecond = 25, kLife = 0.3;
    const auto world = [&](uint64_t pass) {
        const std::vector<Override> values{{"count", "6"}, {"rate", "25"}, {"life", "0.3"}, {"resolution", "80"}};
        World w = std::move(
            build_scene(read_scene_file(source_folder() / "content/scenes/stress_come_and_go.toml", values), Looks::kPlain).world);
        EXPECT_EQ(w.pools.rate[0], kBodiesASecond);
        EXPECT_EQ(w.pools.life[0], kLife);
        w.spawning.came[0] = pass / kRate * uint64_t(kBodiesASecond);  // as if bodies had been spawned and removed
        return w;
    };
    const auto there = [](const World& w) {
        StateHash h;
        for (const uint8_t away : w.spawning.away) h.add(away);
        for (const uint32_t generation : w.spawning.generation) h.add(generation);
        return h.value;
    };
    constexpr int kPasses = 2 * int(kWholeSeconds);
    const std::vector<uint64_t> from_zero = tell(world(0), 0, kPasses, there);
    for (const uint64_t pass : late_passes(30)) EXPECT_EQ(tell(world(pass), pass, kPasses, there), from_zero) << pass;
}

TEST(LongRun, S02_EffectsBeginAndEndInTheirTicks) {
    const auto world = [](uint64_t pass) {
        const std::string start = std::to_string(pass / kRate) + ".25";
        return std::move(WrittenScene("late_clock", R"(
[[body]]
name = "probe"
shape = "probe"
triangles = 600
motion = "hand"
[[tool]]
body = "probe"
tip_radius = 0.007
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.03]
[[tool.effect]]
kind = "constant"
direction = [0.0, 0.0, 1.0]
force = 1.5
duration = 1.4
start = )" + start + "\n")
                             .build()
                             .world);
    };
    const auto force = [](const World& w) {
        StateHash h;
        for (int k = 0; k < 3; ++k) h.add(w.haptics.state[0].output.force[k]);
        return h.value;
    };
    constexpr int kPasses = 2 * int(kWholeSeconds);
    const std::vector<uint64_t> from_zero = tell(world(0), 0, kPasses, force);
    ASSERT_NE(from_zero[0], from_zero[25]);
    ASSERT_EQ(from_zero[0], from_zero[110]);
    for (const uint64_t pass : {pass_before_tick(31, 30), pass_before_tick(32, 30)})  // start times are doubles of up to 1e9 seconds
        EXPECT_EQ(tell(world(pass), pass, kPasses, force), from_zero) << pass;
}

// Decaying motion must not end in denormals, which cost a hundred times as much. Breaks when a worker thread
// keeps its own float mode.
TEST(LongRun, S04_DecayEndsInZeroOnEveryThread) {
    constexpr uint32_t kItems = 4096;
    std::vector<float> left(kItems);
    _mm_setcsr(_mm_getcsr() & ~0x8040u);
    ThreadPool pool(3);
    pool.run([&] {
        parallel_for(kItems, 1, [&](uint32_t begin, uint32_t end) {
            for (uint32_t i = begin; i < end; ++i) {
                volatile float v = 1;
                for (int k = 0; k < 140; ++k) v = v * 0.5f;  // 2^-140 is a denormal
                left[i] = v;
            }
        });
    });
    set_float_mode();
    EXPECT_EQ(left, std::vector<float>(kItems, 0.0f));
}

// Breaks when a pass relies on the float mode set by the caller.
TEST(LongRun, S05_AChangedFloatModeIsPutRightBeforeThePass) {
    const auto hash_after = [](bool change) {
        StateHash h;
        ThreadPool pool(1);
        pool.run([&] {
            Frame frame(std::move(build_scene(read_scene_file(source_folder() / "content/scenes/kidney_on_liver.toml",
                                                              {{"liver.triangles", "300"}, {"kidney.triangles", "200"}}),
                                              Looks::kPlain)
                                      .world),
                        {});
            for (int pass = 0; pass < 20; ++pass) {
                if (change) std::fesetround(FE_UPWARD), _mm_setcsr(_mm_getcsr() & ~0x8040u);
                frame.step();
            }
            for (const Float4& o : frame.world().particles.offset) h.add(o.x), h.add(o.y), h.add(o.z);
        });
        std::fesetround(FE_TONEAREST);
        set_float_mode();
        return h.value;
    };
    EXPECT_EQ(hash_after(true), hash_after(false));
}

// Breaks when something reads a clock that can be set.
TEST(LongRun, S06_OnlyMonotonicClocksAreRead) {
    namespace fs = std::filesystem;
    size_t files = 0;
    for (const char* folder : {"components", "engine", "systems", "content"}) {
        for (const fs::directory_entry& entry : fs::recursive_directory_iterator(source_folder() / folder)) {
            if (entry.path().extension() != ".hpp" && entry.path().extension() != ".cpp") continue;
            std::stringstream text;
            text << std::ifstream(entry.path()).rdbuf();
            ++files;
            for (const char* word : {"system_clock", "high_resolution_clock", "gettimeofday", "CLOCK_REALTIME", "std::time(", "utc_clock"})
                EXPECT_EQ(text.str().find(word), std::string::npos) << entry.path() << ' ' << word;
        }
    }
    EXPECT_GT(files, 300u);
}

}  // namespace
}  // namespace trocar
