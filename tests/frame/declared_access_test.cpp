#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <vector>

#include "systems/frame/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"

// Checks the frame table. Each stage runs in a child process on a world whose undeclared resources were
// emptied; it must write the same as on the complete world, and change nothing else. Breaks when a stage
// reads or writes something its table entry does not name, which equal hashes of serial and parallel runs
// would not reveal.
namespace {
using namespace trocar;

constexpr uint32_t kPasses = 24;
constexpr uint32_t kResources = static_cast<uint32_t>(Resource::kCount);

struct StageRun {
    bool ran = false;
    uint32_t stages = 0;  // number of stages in the frame
    ResourceMask reads = 0, writes = 0;
    char name[64] = {};
    uint64_t before[kResources] = {}, after[kResources] = {};
};

// Runs one stage of the coming pass, on a world stripped of all that the stage does not declare or on the
// whole one.
StageRun run_stage(Frame& frame, uint32_t stage, bool strip) {
    frame.step_until(stage);
    World& world = frame.world();
    const Stage& row = frame.stages()[stage];
    StageRun run{.ran = true, .stages = static_cast<uint32_t>(frame.stages().size()), .reads = row.reads, .writes = row.writes};
    row.name.copy(run.name, sizeof run.name - 1);
    if (strip) strip_resources(world, row.reads | row.writes);
    const auto hash = [&](uint64_t* to) {
        for (uint32_t r = 0; r < kResources; ++r)
            if (!strip || (row.writes & mask(static_cast<Resource>(r)))) to[r] = resource_hash(world, static_cast<Resource>(r));
    };
    hash(run.before);
    frame.run_stage(stage);
    hash(run.after);
    return run;
}

// Runs every stage of a scene twice, with the whole and the stripped world, each in a child process: a stage
// may crash. These are children of a child with one thread and the scene in mid-run: a process forked while
// other threads run may wait for ever for a lock that one of them held.
std::vector<std::array<StageRun, 2>> run_stages(const std::string& scene) {
    int channel[2];
    if (pipe(channel) != 0) return {};
    const pid_t child = fork();
    if (child == 0) {
        close(channel[0]);
        alarm(600);
        FrameOptions options;
        options.serial = true;
        Frame frame(std::move(small_scene(scene).world), options);
        for (uint32_t pass = 0; pass < kPasses; ++pass) frame.step();
        for (uint32_t run = 0; run < 2 * frame.stages().size(); ++run) {
            const pid_t grandchild = fork();
            if (grandchild == 0) {
                alarm(300);
                const StageRun result = run_stage(frame, run / 2, run % 2 == 1);
                _exit(write(channel[1], &result, sizeof result) == sizeof result ? 0 : 1);
            }
            int status = 0;
            waitpid(grandchild, &status, 0);
            const StageRun none{};
            if (!(WIFEXITED(status) && WEXITSTATUS(status) == 0) && write(channel[1], &none, sizeof none) != sizeof none) _exit(1);
        }
        _exit(0);
    }
    close(channel[1]);
    std::vector<std::array<StageRun, 2>> runs;
    StageRun run;
    for (size_t count = 0; read(channel[0], &run, sizeof run) == sizeof run; ++count) {
        if (count % 2 == 0) runs.emplace_back();
        runs.back()[count % 2] = run;
    }
    close(channel[0]);
    waitpid(child, nullptr, 0);
    return runs;
}

class DeclaredAccess : public testing::TestWithParam<std::string> {};

TEST_P(DeclaredAccess, StagesTouchOnlyWhatTheirRowsName) {
    const auto runs = run_stages(GetParam());
    ASSERT_FALSE(runs.empty());
    ASSERT_EQ(runs.size(), runs[0][0].stages);
    for (const auto& [whole, stripped] : runs) {
        ASSERT_TRUE(whole.ran);
        for (uint32_t r = 0; r < kResources; ++r) {
            if (whole.writes & mask(static_cast<Resource>(r))) continue;
            EXPECT_EQ(whole.before[r], whole.after[r])
                << whole.name << " writes " << resource_name(static_cast<Resource>(r)) << " undeclared";
        }
        if (!stripped.ran) {
            ADD_FAILURE() << whole.name << " crashed without the resources it does not declare";
            continue;
        }
        for (uint32_t r = 0; r < kResources; ++r) {
            // tree hashes depend on the meshes' vertex counts, which a stripped world may lack
            if (static_cast<Resource>(r) == Resource::kTrees || !(whole.writes & mask(static_cast<Resource>(r)))) continue;
            EXPECT_EQ(whole.after[r], stripped.after[r])
                << whole.name << " needs something undeclared for " << resource_name(static_cast<Resource>(r));
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Scenes, DeclaredAccess, testing::ValuesIn(scene_names()), [](const auto& info) { return info.param; });
INSTANTIATE_TEST_SUITE_P(Wet, DeclaredAccess, testing::Values("bleed_and_suck", "smoke"), [](const auto& info) { return info.param; });

}  // namespace
