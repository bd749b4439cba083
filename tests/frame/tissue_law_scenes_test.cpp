// Scenes with laws of solids: what they refuse, their bits, and that contact with an instrument pays for what it gives.
#include <gtest/gtest.h>

#include <cstdio>

#include "systems/prepare/sleep.hpp"
#include "tests/frame/written_scene.hpp"
namespace trocar {
namespace {

const std::string kSoftBall = R"(gravity = [0, 0, 0]
[[body]]
name = "ball"
shape = "sphere"
size = 0.06
triangles = 600
motion = "deformable"
model = "solid"
skin = true
cells = 6
fixed_below = -0.02
[body.tissue]
youngs_modulus = 4e3
damping = 20
)";
const std::string kPressingRod = R"([[body]]
name = "rod"
shape = "sphere"
size = 0.02
triangles = 300
motion = "kinematic"
[[body.path]]
time = 0
position = [0, 0, 0.042]
[[body.path]]
time = 0.3
position = [0, 0, 0.028]
[[body.path]]
time = 0.5
position = [0, 0, 0.028]
)";

TEST(TissueLawScenes, KeysAreReadAndChecked) {
    const auto error = [](const std::string& lines, const std::string& rest = "", const std::vector<Override>& overrides = {}) {
        return WrittenScene("law_keys", kSoftBall + lines + rest).error(overrides);
    };
    EXPECT_EQ(error("law = \"neo_hookean\"\nprony = [[0.4, 0.05], [0.3, 0.6]]\n"), "");
    const BuiltScene built = WrittenScene("law_built", kSoftBall + "law = \"neo_hookean\"\nprony = [[0.4, 0.05], [0.3, 1]]\n").build();
    EXPECT_EQ(law_of(built.world.bodies, 0), TissueLaw::kNeoHookean);
    EXPECT_EQ(prony_of(built.world.bodies, 0).branches(), 2u);
    EXPECT_EQ(prony_of(built.world.bodies, 0).share[1], 0.3);
    EXPECT_EQ(prony_of(built.world.bodies, 0).time[1], 1);
    EXPECT_EQ(find_fault(built.world), "");
    EXPECT_NE(built.notes[0].find("neo-Hookean, relaxes from 1.7 times its stiffness in 0.05 s and more"), std::string::npos)
        << built.notes[0];

    EXPECT_NE(error("law = \"ogden\"\n").find(":15:7: law \"ogden\" is none of springs, neo_hookean"), std::string::npos)
        << error("law = \"ogden\"\n");
    for (const char* bad : {"prony = 3", "prony = [0.4, 0.05]", "prony = [[0.4]]", "prony = [[0, 1]]", "prony = [[0.4, 1e-4]]",
                            "prony = [[0.4, 1e3]]", "prony = [[-1, 1]]", "prony = [[\"a\", 1]]", "prony = [[1,1],[1,2],[1,3],[1,4],[1,5]]"})
        EXPECT_NE(error(std::string(bad) + "\n").find("prony must be up to 4 pairs"), std::string::npos) << bad;
    const std::string law = "law = \"neo_hookean\"\n", relaxes = "prony = [[0.4, 0.05]]\n";
    for (const std::string& lines : {law, relaxes}) {
        EXPECT_NE(error(lines, "", {{"ball.model", "shell"}, {"ball.skin", "false"}}).find("are for deformable bodies with model"),
                  std::string::npos);
        EXPECT_NE(error(lines, "", {{"ball.break_strain", "0.5"}}).find("does not break"), std::string::npos);
        EXPECT_NE(error(lines, "[[cut]]\nbody = \"ball\"\nsphere = [0, 0, 0.03, 0.01]\n", {{"ball.skin", "false"}}).find("does not break"),
                  std::string::npos);
        EXPECT_NE(error(lines, "", {{"ball.integrator", "implicit"}}).find("is for shells and sheets"), std::string::npos);
        const std::string tool =
            "[[body]]\nname = \"hook\"\nshape = \"probe\"\nmotion = \"hand\"\nmass = 0.05\n[[tool]]\nbody = \"hook\"\npath = [{time = 0, "
            "position = [0, 0, 0.1]}]\n";
        EXPECT_NE(error(lines, tool + "[[tool.action]]\nkind = \"cauterise\"\nbodies = \"ball\"\npower = 20\nat = [0.1, 0.2]\n")
                      .find("cannot be cauterised"),
                  std::string::npos)
            << error(lines, tool + "[[tool.action]]\nkind = \"cauterise\"\nbodies = \"ball\"\npower = 20\nat = [0.1, 0.2]\n");
        EXPECT_NE(
            error(lines, tool + "[[tool.action]]\nkind = \"cut\"\nbodies = \"ball\"\nedge = [0, 0, 0.02]\ntoughness = 50\nat = [0.1]\n",
                  {{"ball.skin", "false"}})
                .find("cannot be cut by instruments"),
            std::string::npos);
    }
}

// Data of a law that is missing or does not fit is named.
TEST(TissueLawScenes, FaultyWorldsAreNamed) {
    const WrittenScene scene("law_faults", kSoftBall + "law = \"neo_hookean\"\nprony = [[0.4, 0.05]]\n");
    const auto fault = [&](auto spoil) {
        BuiltScene built = scene.build();
        spoil(built.world);
        return find_fault(built.world);
    };
    EXPECT_NE(fault([](World& w) { w.solids.metric.clear(); }).find("its law lacks data"), std::string::npos);
    EXPECT_NE(fault([](World& w) { w.relaxation.body.clear(); }).find("do not fit its springs"), std::string::npos);
    EXPECT_NE(fault([](World& w) { w.relaxation.overstretch.pop_back(); }).find("do not fit its springs"), std::string::npos);
    EXPECT_NE(fault([](World& w) { w.bodies.prony[0].time[0] = -1; }), "");
    EXPECT_NE(fault([](World& w) { w.bodies.law[0] = static_cast<TissueLaw>(7); }).find("is of no kind"), std::string::npos);
}

TEST(TissueLawScenes, SameBitsForAnyThreadsAndClearedScratch) {
    const WrittenScene scene("law_bits", kSoftBall + "law = \"neo_hookean\"\nprony = [[0.4, 0.05], [0.3, 0.6]]\n" + kPressingRod);
    expect_same_bits(scene, 20, [](Frame&) {});
}

// What relaxes falls asleep once hardly anything is left to relax: its shape is that of one that never sleeps.
TEST(TissueLawScenes, WhatHasRelaxedFallsAsleep) {
    const WrittenScene scene("law_sleep", kSoftBall + "prony = [[0.8, 0.2]]\n" + kPressingRod);
    std::vector<Float4> slept, awake;
    double asleep_at = 0, left = 0;
    run(std::move(scene.build().world), 270, [&](const Frame& f, int) {
        const World& w = f.world();
        slept = w.particles.offset;
        if (!is_asleep(w.sleep, 0) || asleep_at > 0) return;
        asleep_at = 1e-3 * static_cast<double>(w.clock.tick);
        left = strain_to_relax(w.relaxation, w.relaxation.body[0], w.springs, w.bodies.mesh[0]);
    });
    run(std::move(scene.build({{"sleep_speed", "0"}}).world), 270, [&](const Frame& f, int) { awake = f.world().particles.offset; });
    double worst = 0;
    for (size_t i = 0; i < slept.size(); ++i)
        worst = std::max(worst, (Vec3d(slept[i].x, slept[i].y, slept[i].z) - Vec3d(awake[i].x, awake[i].y, awake[i].z)).norm());
    std::printf("asleep at %.2f s with a strain of %.2g to relax, then off by at most %.3g mm\n", asleep_at, left, 1e3 * worst);
    EXPECT_GT(asleep_at, 1.5) << "later than a body that does not relax";
    EXPECT_LT(asleep_at, 5);
    EXPECT_LT(left, kRelaxedStrain);
    EXPECT_LT(worst, kRelaxedStrain * 0.06) << "of its extent";
}

// A press: every law keeps its books, relaxing or not, and the tissue remembers nothing but its history.
TEST(TissueLawScenes, EnergyBalancesInContact) {
    for (const char* law : {"springs", "neo_hookean"}) {
        for (const bool relaxes : {false, true}) {
            const WrittenScene scene("law_energy",
                                     kSoftBall + "law = \"" + law + "\"\n" + (relaxes ? "prony = [[0.6, 0.05]]\n" : "") + kPressingRod);
            double worst = 0, entered = 0;
            run(std::move(scene.build().world), 30, [&](const Frame& f, int) {
                const Energy& e = f.world().energy;
                worst = std::max(worst, std::abs(e.balance)), entered = std::max(entered, e.work_hand);
                EXPECT_EQ(f.world().report.inverted_tetrahedra, 0u);
            });
            std::printf("%s%s: %.4f mJ of work, balance within %.3f %%\n", law, relaxes ? ", relaxing" : "", 1e3 * entered,
                        100 * worst / entered);
            EXPECT_LT(worst, 2e-3 * entered) << law;
        }
    }
}

}  // namespace
}  // namespace trocar
