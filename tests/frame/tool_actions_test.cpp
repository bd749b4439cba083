// What instruments do when their hands tell them to: triggers, staples, their strength.
#include "systems/prepare/tool_actions.hpp"

#include <gtest/gtest.h>

#include "frame/written_scene.hpp"
#include "reference/paths.hpp"
namespace trocar {
namespace {

// A soft ball over a scripted one that leaves it at 2 mm/s, and a pen whose tip is between the two.
std::string stapling(const std::string& action) {
    return R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "ball"
shape = "sphere"
size = 0.04
triangles = 300
motion = "deformable"
anchor = "world"
[body.tissue]
youngs_modulus = 2e4
damping = 20.0
[[body]]
name = "plate"
shape = "sphere"
size = 0.04
triangles = 300
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, -0.042]
[[body.path]]
time = 0.2
position = [0.0, 0.0, -0.042]
[[body.path]]
time = 10.2
position = [0.0, 0.0, -0.062]
[[body]]
name = "pen"
shape = "sphere"
size = 0.002
triangles = 100
motion = "hand"
position = [0.0, 0.0, -0.021]
apart = ["ball", "plate"]
[[tool]]
body = "pen"
tip_radius = 0.001
[[tool.path]]
time = 0.0
position = [0.0, 0.0, -0.021]
[[tool.action]]
)" + action;
}

struct Shot {
    World w;
    LinkScratch scratch;
    explicit Shot(const std::string& action) : w(std::move(WrittenScene("actions", stapling(action)).build().world)) {}
    // One pass at a time (s), with the hand's state as it is.
    const ActionProgress& pass(double now = 0) {
        const ActionPass p{
            now,          {surfaces_of(w), w.solids, w.trees}, w.haptics.tool, w.haptics.jaw, w.haptics.state, w.actions, &w.spawning,
            &w.node_state};
        act(p, scratch, w.action_state, w.links, w.sleep, w.energy);
        return w.action_state.progress[0];
    }
    ToolState& hand() { return w.haptics.state[0]; }
};

// A pulled trigger sets one staple, however long it stays pulled. Breaks when a staple is set in every pass, when
// another button fires, or when a pull between two passes in which it was free is lost.
TEST(ToolActions, OneStapleAPull) {
    Shot shot("kind = \"staple\"\nbuttons = 6\nmagazine = 3\n");
    EXPECT_EQ(shot.pass().done, 0u);
    shot.hand().device.buttons = 1;
    EXPECT_EQ(shot.pass().done, 0u);
    for (uint64_t pull = 1; pull <= 3; ++pull) {
        shot.hand().device.buttons = pull == 2 ? 4 : 2;
        for (int i = 0; i < 3; ++i) EXPECT_EQ(shot.pass().done, pull);
        shot.hand().device.buttons = 1;
        shot.pass();
    }
    EXPECT_EQ(shot.w.links.node.size(), 3u);
    EXPECT_EQ(shot.pass().misfires, 0u);
    shot.hand().device.buttons = 2;
    EXPECT_EQ(shot.pass().misfires, 1u) << "the magazine is empty";
    EXPECT_EQ(shot.w.links.node.size(), 3u);
    EXPECT_EQ(find_fault(shot.w), "");
}

TEST(ToolActions, TriggersByGripForceAndTime) {
    Shot grip("kind = \"staple\"\nwhen = \"grip\"\ngrip = 10.0\n");
    grip.hand().device.grip = 0.2;
    EXPECT_EQ(grip.pass().done, 0u);
    grip.hand().device.grip = 0.17;  // 9.7 degrees
    EXPECT_EQ(grip.pass().done, 1u);
    Shot force("kind = \"staple\"\nwhen = \"force\"\nforce = 0.5\n");
    force.hand().command.force = {0, 0.3, 0.39};
    EXPECT_EQ(force.pass().done, 0u);
    force.hand().command.force = {0, 0.3, 0.41};
    EXPECT_EQ(force.pass().done, 1u);
    Shot times("kind = \"staple\"\nat = [0.1, 0.2, 0.25]\n");
    EXPECT_EQ(times.pass(0.099).done, 0u);
    EXPECT_EQ(times.pass(0.1).done, 1u);
    EXPECT_EQ(times.pass(0.15).done, 1u);
    EXPECT_EQ(times.pass(0.3).done, 3u) << "no pull is lost, however long a pass";
    EXPECT_EQ(times.pass(9).done, 3u);
}

// Both surfaces must be within reach, here 1 mm each, and the tool pressed.
TEST(ToolActions, MisfiresAreCounted) {
    Shot near("kind = \"staple\"\nat = [0.0]\nreach = 1.1e-3\n");
    EXPECT_EQ(near.pass().done, 1u);
    Shot far("kind = \"staple\"\nat = [0.0]\nreach = 0.9e-3\n");
    EXPECT_EQ(far.pass().misfires, 1u);
    Shot aside("kind = \"staple\"\nat = [0.0]\nreach = 1.1e-3\npoint = [0.0, 0.01, 0.0]\n");
    EXPECT_EQ(aside.pass().misfires, 1u);
    EXPECT_TRUE(aside.w.links.node.empty());
    Shot light("kind = \"staple\"\nat = [0.0, 0.1]\npress = 0.5\n");
    light.hand().command.force = {0, 0, 0.49};
    EXPECT_EQ(light.pass(0).misfires, 1u);
    light.hand().command.force = {0, 0, 0.51};
    EXPECT_EQ(light.pass(0.1).done, 1u);
}

// A staple bears what it is said to bear, within 2 %, then it is gone: from the links, the picture and, with the energy
// that it held, F^2 / 2k, from the accounting. Breaks when its strength is converted by a wrong length, or when its
// energy leaves unseen.
TEST(ToolActions, AStapleIsPulledOutAtItsForce) {
    for (const double bears : {0.1, 0.25}) {
        const WrittenScene scene("pull_out",
                                 stapling("kind = \"staple\"\nat = [0.1]\nstiffness = 100.0\npull_out = " + std::to_string(bears)));
        uint64_t pulled = 0;
        size_t rods_before = 0, rods_after = 1;
        double force = 0, freed = 0, entered = 0, balance = 1, before = 0, worst = 0;
        run(std::move(scene.build().world), 420, [&](Frame& frame, int pass) {
            const World& w = frame.world();
            if (pulled == 0 && w.action_state.progress[0].pulled_out == 0) before = w.energy.balance;
            worst = std::max(worst, std::abs(w.energy.balance));
            if (pass == 12) rods_before = frame.snapshot_now().rod.size();
            if (pulled == 0 && w.action_state.progress[0].pulled_out == 1) {
                pulled = static_cast<uint64_t>(pass);
                force = w.action_state.progress[0].largest_force, freed = -w.energy.work_links;
                entered = w.energy.work_hand, balance = w.energy.balance;
                rods_after = frame.snapshot_now().rod.size();
                EXPECT_TRUE(w.links.node.empty());
                EXPECT_EQ(w.report.broken_links, 1u);
            }
        });
        EXPECT_GT(pulled, 12u);
        EXPECT_EQ(rods_before, 3u) << "a crown and two legs";
        EXPECT_EQ(rods_after, 0u);
        std::printf("bears %.3f N: pulled out at %.4f N (%.2f %%) in pass %llu, balance %.3g, then %.3g, at most %.3g of %.3g J\n", bears,
                    force, 100 * (force / bears - 1), static_cast<unsigned long long>(pulled), before, balance, worst, entered);
        EXPECT_LE(force, 1.001 * bears);
        EXPECT_NEAR(force, bears, 0.02 * bears);
        EXPECT_NEAR(freed, bears * bears / 200, 0.02 * bears * bears / 200);
        EXPECT_GT(entered, 0);
        EXPECT_LT(std::abs(before), 1e-3 * entered);
        EXPECT_LT(std::abs(balance), 1e-3 * entered) << "what it held rings near the stable step";
        EXPECT_LT(worst, 1e-3 * entered) << "while it rings, and after";
    }
}

// The tacker of the scene sets its first staple, in contact with mesh and wall: the accounting closes to 0.1 % of the hand's work.
TEST(ToolActions, TheAccountingOfAStapledMeshCloses) {
    const auto path = source_folder() / "content/scenes/staple.toml";
    BuiltScene scene = build_scene(read_scene_file(path, {{"wall.triangles", "800"}, {"mesh.triangles", "400"}}), Looks::kPlain);
    double worst = 0;
    run(std::move(scene.world), 60, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        worst = std::max(worst, std::abs(w.energy.balance));
        if (pass < 59) return;
        std::printf("balance at most %.3g of %.3g J\n", worst, w.energy.work_hand);
        EXPECT_EQ(w.action_state.progress[0].done, 1u);
        EXPECT_LT(worst, 1e-3 * w.energy.work_hand);
    });
}

// Any number of threads, and scratch thrown away between any two stages, give the same bits.
TEST(ToolActions, SameBitsForThreadsAndWithoutScratch) {
    const WrittenScene scene("bits", stapling("kind = \"staple\"\nat = [0.05, 0.1]\npull_out = 0.05\n"));
    expect_same_bits(scene, 90, [](const Frame& frame) { EXPECT_EQ(frame.world().action_state.progress[0].done, 2u); });
}

TEST(ToolActions, WhatCannotBeDoneIsRefused) {
    const auto error = [](const std::string& action) { return WrittenScene("refused", stapling(action)).error(); };
    EXPECT_EQ(error("kind = \"staple\"\n"), "");
    const auto complains = [&](const std::string& action, const std::string& about) {
        const std::string text = error(action);
        EXPECT_NE(text.find(about), std::string::npos) << action << ": " << text;
        EXPECT_NE(text.find(".toml:"), std::string::npos) << text;
    };
    complains("buttons = 1\n", "needs a kind: staple, cut");
    complains("kind = \"sew\"\n", "is none of staple, cut");
    complains("kind = \"suture\"\n", "a suture needs thread");
    complains("kind = \"staple\"\nwhen = \"times\"\n", "at = [...]");
    complains("kind = \"staple\"\nwhen = \"button\"\nat = [1.0]\n", "at = [...]");
    complains("kind = \"staple\"\nat = [1.0, 1.0]\n", "must ascend");
    complains("kind = \"staple\"\nat = [-1.0]\n", "not negative");
    complains("kind = \"staple\"\nat = []\n", "list of times");
    complains("kind = \"staple\"\nwhen = \"grip\"\n", "needs grip");
    complains("kind = \"staple\"\nwhen = \"force\"\n", "needs force");
    complains("kind = \"staple\"\nwhen = \"pedal\"\n", "none of button");
    complains("kind = \"staple\"\nreach = 0.0\n", "reach");
    complains("kind = \"staple\"\npull_of = 1.0\n", "pull_out");
}

}  // namespace
}  // namespace trocar
