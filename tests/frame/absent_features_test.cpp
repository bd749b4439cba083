#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"

// Features that a scene does not use cost no memory, no threads and no stages. Breaks when a system allocates
// for, or a stage runs on, something the scene lacks.
namespace {
using namespace trocar;

uint32_t threads_of_process() {
    uint32_t count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator("/proc/self/task")) ++count;
    return count;
}

bool has_stage(const Frame& frame, const std::string& name) {
    const auto& names = frame.stage_names();
    return std::find(names.begin(), names.end(), name) != names.end();
}

// Runs a world for some passes in a pool of one thread and passes the frame to `look`.
template <typename Look>
void run_and_look(World world, int passes, const Look& look) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(world), {});
        for (int i = 0; i < passes; ++i) frame.step();
        look(frame);
    });
}

TEST(AbsentFeatures, EmptySceneHasNoStagesButTheClock) {
    run_and_look(World{}, 10, [](const Frame& frame) {
        EXPECT_TRUE(frame.stage_names().empty()) << frame.stage_names().front();
        EXPECT_EQ(frame.world().clock.pass, 10u);
    });
}

TEST(AbsentFeatures, SceneWithoutToolHasNoHapticStageAndNoHapticBytes) {
    run_and_look(std::move(small_scene("kidney_on_liver").world), 4, [](const Frame& frame) {
        for (const char* stage : {"device input", "local contact", "rigid motion"}) EXPECT_FALSE(has_stage(frame, stage));
        EXPECT_EQ(frame.world().haptics.state.capacity() + frame.world().haptics.tool.capacity(), 0u);
        EXPECT_EQ(frame.world().local_contact.capacity(), 0u);
        EXPECT_EQ(frame.world().haptics.ticks, 0u);
        EXPECT_EQ(frame.world().springs.fans.first.capacity(), 0u) << "no body keeps its volume";
        EXPECT_EQ(frame.world().springs.hinges.first.capacity(), 0u) << "none bends";
        for (const char* stage : {"links", "tears"}) EXPECT_FALSE(has_stage(frame, stage));
        const World& w = frame.world();
        EXPECT_EQ(w.links.group.capacity() + w.links.node.capacity() + w.links.stable_dt.capacity(), 0u) << "nothing is linked";
        EXPECT_EQ(w.tears.body.capacity() + w.torn.spring.capacity() + w.torn_springs.neighbour.capacity(), 0u) << "nothing tears";
        EXPECT_EQ(w.springs.factor.capacity() + w.solids.factor.capacity(), 0u) << "no region differs";
        EXPECT_EQ(w.bodies.stepping.capacity(), 0u) << "none says how it is stepped";
        for (const char* stage : {"fluid sources", "films", "drops"}) EXPECT_FALSE(has_stage(frame, stage));
        EXPECT_EQ(w.fluids.body.capacity() + w.fluid_state.volume.capacity() + w.fluid_state.from.capacity() +
                      w.fluid_state.drops.volume.capacity() + w.fluid_state.puffs.mass.capacity() + w.picture.liquid.capacity() +
                      w.picture.puff.capacity(),
                  0u)
            << "nothing is wet";
        for (const char* stage : {"sutures", "threaded bodies", "threads", "thread forces"}) EXPECT_FALSE(has_stage(frame, stage));
        EXPECT_EQ(w.threads.thread.capacity() + w.thread_state.position.capacity() + w.thread_state.hold.capacity() +
                      w.thread_state.stable_dt.capacity() + w.picture.rod.capacity(),
                  0u)
            << "nothing is sewn";
    });
    run_and_look(std::move(small_scene("probe_on_liver").world), 1, [](const Frame& frame) {
        for (const char* stage : {"device input", "local contact"}) EXPECT_TRUE(has_stage(frame, stage));
    });
}

TEST(AbsentFeatures, OneBodyHasNoContactStages) {
    BuiltScene scene = small_scene("kidney_on_liver");
    World one;
    one.meshes = scene.world.meshes;
    one.springs = scene.world.springs;
    make_deformable(one, add_body(one, "alone", 0, Motion::kDeformable));
    make_trees(one);
    run_and_look(std::move(one), 4, [](const Frame& frame) {
        EXPECT_FALSE(has_stage(frame, "overlap"));
        EXPECT_FALSE(has_stage(frame, "rasterise"));
        EXPECT_TRUE(has_stage(frame, "advance"));
        EXPECT_EQ(frame.world().contacts.point.capacity(), 0u);
    });
}

TEST(AbsentFeatures, OneThreadStartsNoOther) {
    const uint32_t before = threads_of_process();
    ThreadPool pool(1);
    pool.run([&] {
        FrameOptions options;
        Frame frame(std::move(small_scene("probe_on_liver").world), options);
        for (int i = 0; i < 4; ++i) frame.step();
    });
    EXPECT_EQ(threads_of_process(), before);
}

// Breaks when a run without pictures pays for them, gives other results, or cannot show a picture on request.
TEST(AbsentFeatures, WithoutPicturesNothingIsMadeForThem) {
    ThreadPool pool(1);
    pool.run([&] {
        FrameOptions blind;
        blind.pictures = false;
        Frame frame(small_scene("probe_on_liver").world, blind), drawn(small_scene("probe_on_liver", "1000", Looks::kPainted).world, {});
        const auto count_painted = [](const World& w) {
            return std::ranges::count_if(w.meshes.material, [](const Material& m) { return !m.image.rgba.empty(); });
        };
        EXPECT_EQ(count_painted(frame.world()), 0);
        EXPECT_GT(count_painted(drawn.world()), 0);
        for (const char* stage : {"surface normals", "picture"}) {
            EXPECT_FALSE(has_stage(frame, stage));
            EXPECT_TRUE(has_stage(drawn, stage));
        }
        while (drawn.world().clock.picture < 2) frame.step(), drawn.step();
        EXPECT_EQ(frame.world().normals.normal.capacity() + frame.world().picture.position.capacity(), 0u);
        EXPECT_EQ(state_hash(frame.world()), state_hash(drawn.world()));
        EXPECT_EQ(frame.world().energy.balance, drawn.world().energy.balance);
        EXPECT_EQ(frame.snapshot_now().normal, drawn.snapshot_now().normal);
        EXPECT_EQ(frame.snapshot_now().position, drawn.snapshot_now().position);
        EXPECT_GT(drawn.snapshot_now().position.size(), 100u);
    });
}

}  // namespace
