#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "content/mend/self_crossing.hpp"
#include "content/scene/build_scene.hpp"
#include "engine/base/cpu.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/surface_mesh.hpp"
#include "systems/frame/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"
#include "tests/reference/sample_count.hpp"

// Bit-identical results for any number of threads, order of execution, instruction set and cache state.
// Breaks when a system merges in thread order, lets a cache change a result, or contracts floating-point
// operations.
namespace {
using namespace trocar;

struct Run {
    uint32_t threads = 1;
    bool serial = false;
    bool clear_caches = false;
    bool avx2 = false;
    uint32_t passes = 90;
    bool embree = false;       // contact.search = "embree"
    bool cross_check = false;  // signs are compared with the winding number
};

// Number of threads that really take part in the pool's loops; waits up to ten seconds for the last one.
uint32_t count_threads(uint32_t expected) {
    std::vector<std::atomic<uint32_t>> seen(256);
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    uint32_t count = 0;
    while (count < expected && std::chrono::steady_clock::now() < until) {
        parallel_for(64, 1, [&](uint32_t, uint32_t) {
            seen[thread_index()] = 1;
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        });
        count = 0;
        for (const auto& s : seen) count += s;
    }
    return count;
}

// Whether some body's surface intersects itself: there pseudonormals and winding numbers may disagree.
bool has_self_crossing(const World& w) {
    for (uint32_t body = 0; body < w.bodies.mesh.size(); ++body)
        if (count_self_crossings(surface_mesh(surfaces_of(w), body)).crossing > 0) return true;
    return false;
}

uint64_t run_scene(const std::string& name, const Run& run) {
    force_avx2(run.avx2);
    uint64_t hash = 0;
    ThreadPool pool(run.threads);
    pool.run([&] {
        EXPECT_EQ(count_threads(run.threads), run.threads);
        FrameOptions options;
        options.serial = run.serial;
        options.clear_caches = run.clear_caches;
        World world = std::move(small_scene(name).world);
        if (run.embree) {
            world.settings.contact.search = TreeSearch::kEmbree;
            make_trees(world);
        }
        for (const auto& tree : world.trees) tree->cross_check(run.cross_check);
        Frame frame(std::move(world), options);
        for (uint32_t pass = 0; pass < run.passes; ++pass) {
            const uint64_t before = frame.world().report.disagreements;
            const bool crossed = has_self_crossing(frame.world());
            frame.step();
            EXPECT_TRUE(frame.world().report.disagreements == before || crossed) << "pass " << pass;
        }
        hash = state_hash(frame.world());
        const bool touched = frame.world().report.contact_events > 0 || frame.world().haptics.max_force > 0;
        EXPECT_TRUE(touched) << name << " never touched: nothing was tested";
    });
    force_avx2(false);
    return hash;
}

class Determinism : public testing::TestWithParam<std::string> {};

TEST_P(Determinism, SameHashForAnyThreadsOrderInstructionSetAndCaches) {
    const uint64_t reference = run_scene(GetParam(), {1, true, false, false, 90});
    EXPECT_EQ(run_scene(GetParam(), {2, false, false, false, 90}), reference) << "2 threads";
    EXPECT_EQ(run_scene(GetParam(), {8, false, true, false, 90}), reference) << "8 threads, caches cleared";
    if (!kSanitized) {
        EXPECT_EQ(run_scene(GetParam(), {3, false, false, false, 90, true}), reference) << "3 threads, rtcPointQuery";
        EXPECT_EQ(run_scene(GetParam(), {2, true, false, false, 90}), reference) << "serial list on two threads";
    }
    EXPECT_EQ(run_scene(GetParam(), {4, false, false, false, 90, false, true}), reference) << "4 threads, signs cross-checked";
    if (isa() == Isa::kAvx512) {
        EXPECT_EQ(run_scene(GetParam(), {1, false, false, true, 90}), reference) << "AVX2 kernels";
    }
}

INSTANTIATE_TEST_SUITE_P(Scenes, Determinism, testing::ValuesIn(scene_names()), [](const auto& info) { return info.param; });

class LongDeterminism : public testing::TestWithParam<std::string> {};

// 300 pictures.
TEST_P(LongDeterminism, SameHashAfter300Pictures) {
    const uint64_t reference = run_scene(GetParam(), {1, true, false, false, 600});
    for (const uint32_t threads : {1u, 2u, 4u, 8u})
        EXPECT_EQ(run_scene(GetParam(), {threads, false, false, false, 600}), reference) << threads << " threads";
}

INSTANTIATE_TEST_SUITE_P(Scenes, LongDeterminism, testing::ValuesIn(scene_names()), [](const auto& info) { return info.param; });

}  // namespace
