#include <dlfcn.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <thread>

#include "engine/files/capture_file.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "tests/allocations/counting_malloc.hpp"
#include "tests/frame/scenes_under_test.hpp"

// A warm frame allocates nothing: begin, advance with its haptic ticks, and end with the picture snapshot.
// Drawing the picture is not part of a frame (Mesa allocates freely). A scene runs twice from the same state;
// the second run repeats the first one's work, so every buffer already has its largest size. Breaks when a
// stage creates a vector, a string or a std::function, or lets a buffer grow for ever.
namespace {
using namespace trocar;

// State of a pass without caches: enough to replay a scene in the same frame.
struct Start {
    explicit Start(const World& w) {
        for (const Resource r : resources()) save_resource(w, r, record);
    }
    void restore(World& w) const {
        std::vector<ToolState> tools = std::move(w.haptics.state);
        for (const Resource r : resources()) load_resource(record, r, w);
        tools = w.haptics.state;  // by assignment: lists inside a tool's state keep their capacity
        w.haptics.state = std::move(tools);
    }
    static std::vector<Resource> resources() {
        std::vector<Resource> kept{Resource::kEnergy};
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
            if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kState) kept.push_back(static_cast<Resource>(r));
        return kept;
    }
    CaptureRecord record;
};

std::string list(const AllocationCount& count) {
    std::string text;
    for (const std::string& caller : count.callers) text += "\n  " + caller;
    return text;
}

struct Runs {
    AllocationCount cold, warm;
    uint64_t passes = 0, events = 0, ticks = 0, first_hash = 0, second_hash = 0;
};

Runs run_twice(const std::string& scene, uint32_t threads, uint64_t passes) {
    Runs runs;
    runs.passes = passes;
    ThreadPool pool(threads);
    pool.run([&] {
        Frame frame(std::move(small_scene(scene).world), {});
        const Start start(frame.world());
        start_counting_allocations();
        for (uint64_t i = 0; i < passes; ++i) frame.step();
        runs.cold = stop_counting_allocations();
        runs.first_hash = state_hash(frame.world());
        start.restore(frame.world());
        frame.world().report = {};
        frame.world().haptics.ticks = 0;
        start_counting_allocations();
        for (uint64_t i = 0; i < passes; ++i) frame.step();
        runs.warm = stop_counting_allocations();
        runs.second_hash = state_hash(frame.world());
        runs.events = frame.world().report.contact_events;
        runs.ticks = frame.world().haptics.ticks;
    });
    return runs;
}

TEST(Allocations, CountsOfEveryThreadAndFunction) {
    ThreadPool pool(2);
    pool.run([&] {
        start_counting_allocations();
        auto number = std::make_unique<double>(1.0);
        auto numbers = std::make_unique<double[]>(100);
        void* memory = malloc(10);
        memory = realloc(memory, 100);
        free(memory);
        void* volatile aligned = aligned_alloc(64, 128);
        free(aligned);
        std::vector<double> vector(10);
        const AllocationCount here = stop_counting_allocations();
        EXPECT_EQ(here.ours, 6u) << *number + numbers[0] + vector[0] << list(here);
        std::thread other([] {
            start_counting_allocations();
            std::vector<int> v(5);
            EXPECT_EQ(v[0], 0);
        });
        other.join();
        EXPECT_EQ(stop_counting_allocations().ours, 1u);
    });
}

// Breaks when the counter misses the blocks that the scheduler's allocator takes from the system.
TEST(Allocations, CountsTheSchedulersBlocks) {
    void* library = dlopen("libtbbmalloc.so.2", RTLD_NOW);
    if (!library) GTEST_SKIP() << "the scheduler uses malloc here";
    const auto take = reinterpret_cast<void* (*)(size_t)>(dlsym(library, "scalable_malloc"));
    const auto compliance = reinterpret_cast<void (*)(void*)>(dlsym(library, "scalable_free"));
    ASSERT_TRUE(take && compliance);
    start_counting_allocations();
    compliance(take(size_t{1} << 28));
    EXPECT_GE(stop_counting_allocations().tbb, 1u);
}

class WarmFrame : public testing::TestWithParam<std::string> {};

TEST_P(WarmFrame, AllocatesNothingOnOneThread) {
    const Runs runs = run_twice(GetParam(), 1, 100);
    EXPECT_GT(runs.events, 10u);
    EXPECT_EQ(runs.first_hash, runs.second_hash) << "the second run was to do the work of the first";
    EXPECT_GT(runs.cold.ours, 0u) << "a cold frame must allocate: is anything counted?";
    EXPECT_EQ(runs.warm.ours, 0u) << "in " << runs.passes << " warm passes" << list(runs.warm);
    EXPECT_EQ(runs.warm.tbb, 0u);
    // Embree 3.13 allocates the name of its builder in every commit
    EXPECT_LE(runs.warm.embree, 2 * runs.passes);
}

TEST_P(WarmFrame, AllocatesNothingOfOursOnThreeThreads) {
    const Runs runs = run_twice(GetParam(), 3, 100);
    EXPECT_GT(runs.events, 10u);
    EXPECT_EQ(runs.first_hash, runs.second_hash);
    EXPECT_EQ(runs.warm.ours, 0u) << "in " << runs.passes << " warm passes" << list(runs.warm);
    // the scheduler cuts its tasks from blocks it holds; a late worker may need a new one
    EXPECT_LE(runs.warm.tbb, 3u);
}

INSTANTIATE_TEST_SUITE_P(Scenes, WarmFrame,
                         testing::Values("probe_on_liver", "kidney_on_liver", "every_contact_stage", "tet_liver_press", "jaw_grasp",
                                         "shaft_on_liver"),
                         [](const auto& info) { return info.param; });

// Blood and water on a liver, drops of a jet and suction.
TEST(Allocations, NoneForLiquids) {
    for (const uint32_t threads : {1u, 3u}) {
        const Runs runs = run_twice("bleed_and_suck", threads, 100);
        EXPECT_EQ(runs.first_hash, runs.second_hash);
        EXPECT_EQ(runs.warm.ours, 0u) << list(runs.warm);
    }
}

// Islands are assigned to threads arbitrarily: no thread may allocate for an island that another one had in
// the first run. Breaks when only the thread that ran the largest island has memory for it.
TEST(Allocations, NoneForIslandsThatChangeThreads) {
    const BuiltScene scene = small_scene("kidney_on_liver");
    World world;
    world.settings = scene.world.settings;
    world.meshes = scene.world.meshes;
    world.springs = scene.world.springs;
    for (uint32_t i = 0; i < 12; ++i) {
        const uint32_t body = add_body(world, "organ", i % 6 ? 1 : 0, Motion::kDeformable, {}, AnchorFrame::kShape);
        world.poses.origin[body].x() = i;
        make_deformable(world, body);
    }
    make_trees(world);
    ThreadPool pool(4);
    pool.run([&] {
        Frame frame(std::move(world), {});
        for (int i = 0; i < 4; ++i) frame.step();
        EXPECT_EQ(frame.world().islands.bodies.size(), 12u);
        start_counting_allocations();
        for (int i = 0; i < 30; ++i) frame.step();
        const AllocationCount count = stop_counting_allocations();
        EXPECT_EQ(count.ours, 0u) << list(count);
    });
}

}  // namespace
