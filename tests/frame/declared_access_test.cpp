#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include "systems/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"

// The frame table tells the truth. Each stage runs in a child process on a world whose undeclared resources were
// emptied; what it writes must be what it writes on the whole world, and nothing else may change. Breaks when a stage
// reads or writes something its row does not name - what equal hashes of serial and parallel runs do not show.
namespace {
using namespace trocar;

constexpr uint32_t kPasses = 24;
constexpr uint32_t kResources = static_cast<uint32_t>(Resource::kCount);

struct StageRun {
    uint32_t stages = 0;  // of the frame
    uint64_t reads = 0, writes = 0;
    char name[64] = {};
    uint64_t before[kResources] = {}, after[kResources] = {};
};

// Runs the scene up to a stage in a child, optionally strips the world, runs the stage, and sends the hashes back.
// The parent builds nothing: a child forked while other threads run may wait for ever for a lock one of them held.
bool run_stage_in_child(const std::string& scene, uint32_t stage, bool strip, StageRun& out) {
    int channel[2];
    if (pipe(channel) != 0) return false;
    const pid_t child = fork();
    if (child == 0) {
        close(channel[0]);
        alarm(300);
        FrameOptions options;
        options.serial = true;
        Frame frame(std::move(small_scene(scene).world), options);
        for (uint32_t pass = 0; pass < kPasses; ++pass) frame.step();
        frame.step_until(stage);
        World& world = frame.world();
        const Stage& row = frame.stages()[stage];
        StageRun run{.stages = static_cast<uint32_t>(frame.stages().size()), .reads = row.reads, .writes = row.writes};
        row.name.copy(run.name, sizeof run.name - 1);
        if (strip) strip_resources(world, row.reads | row.writes);
        for (uint32_t r = 0; r < kResources; ++r)
            if (!strip || (row.writes & mask(static_cast<Resource>(r)))) run.before[r] = resource_hash(world, static_cast<Resource>(r));
        frame.run_stage(stage);
        for (uint32_t r = 0; r < kResources; ++r)
            if (!strip || (row.writes & mask(static_cast<Resource>(r)))) run.after[r] = resource_hash(world, static_cast<Resource>(r));
        const bool sent = write(channel[1], &run, sizeof run) == sizeof run;
        _exit(sent ? 0 : 1);
    }
    close(channel[1]);
    const bool got = read(channel[0], &out, sizeof out) == sizeof out;
    close(channel[0]);
    int status = 0;
    waitpid(child, &status, 0);
    return got && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

class DeclaredAccess : public testing::TestWithParam<std::string> {};

TEST_P(DeclaredAccess, StagesTouchOnlyWhatTheirRowsName) {
    uint32_t stages = 1;
    for (uint32_t s = 0; s < stages; ++s) {
        StageRun whole, stripped;
        ASSERT_TRUE(run_stage_in_child(GetParam(), s, false, whole)) << "stage " << s;
        const StageRun& stage = whole;
        stages = whole.stages;
        for (uint32_t r = 0; r < kResources; ++r) {
            if (stage.writes & mask(static_cast<Resource>(r))) continue;
            EXPECT_EQ(whole.before[r], whole.after[r])
                << stage.name << " writes " << resource_name(static_cast<Resource>(r)) << " undeclared";
        }
        if (!run_stage_in_child(GetParam(), s, true, stripped)) {
            ADD_FAILURE() << stage.name << " crashed without the resources it does not declare";
            continue;
        }
        for (uint32_t r = 0; r < kResources; ++r) {
            // trees are hashed through the meshes' vertex counts, which a stripped world may not have
            if (static_cast<Resource>(r) == Resource::kTrees || !(stage.writes & mask(static_cast<Resource>(r)))) continue;
            EXPECT_EQ(whole.after[r], stripped.after[r])
                << stage.name << " needs something undeclared for " << resource_name(static_cast<Resource>(r));
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Scenes, DeclaredAccess, testing::ValuesIn(scene_names()), [](const auto& info) { return info.param; });

}  // namespace
