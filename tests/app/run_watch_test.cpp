#include "systems/app/run/run_watch.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "engine/tissue/tet_forces.hpp"
#include "tests/app/run_program.hpp"
#include "tests/frame/written_scene.hpp"

namespace trocar {
namespace {

struct Watched {
    std::string warnings, ruin;
    Report report;
};

// Runs a scene under a RunWatch; disturb(World&, pass) before each pass.
template <typename Disturb>
Watched watch(const std::string& text, int passes, const Disturb& disturb) {
    Watched seen;
    const WrittenScene scene("watch", text);
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(scene.build().world, {});
        RunWatch watch(frame.world());
        for (int pass = 0; pass < passes; ++pass) {
            disturb(frame.world(), pass);
            frame.step();
            watch.after_pass(frame);
        }
        watch.finish(frame.world());
        for (const std::string& warning : watch.take_warnings()) seen.warnings += warning + "\n";
        seen.ruin = watch.ruin();
        seen.report = frame.world().report;
    });
    return seen;
}
Watched watch(const std::string& text, int passes) {
    return watch(text, passes, [](World&, int) {});
}

std::string body(const std::string& name, const std::string& rest) {
    return "[[body]]\nname = \"" + name + "\"\nshape = \"box\"\ntriangles = 300\nsize = 0.1\n" + rest + "\n";
}
const std::string kSoft = "motion = \"deformable\"\nanchor = \"shape\"\n[body.tissue]\ndamping = 0.0\n";
const std::string kSolid = "motion = \"deformable\"\nmodel = \"solid\"\ncells = 4\nanchor = \"shape\"\n[body.tissue]\ndamping = 0.0\n";

bool says(const Watched& w, const std::string& text) { return w.warnings.find(text) != std::string::npos; }

// Depth and share of the smaller body are exact: cubes of 0.1 m, whose diagonal is the size, overlap by 24 mm and by 5 mm. What
// starts more than a hundredth inside is counted, more than an eighth named.
TEST(RunWatch, NamesWhatStartsInsideAndHowDeep) {
    const std::string scene = "gravity = [0, 0, 0]\n" + body("low", "motion = \"static\"") +
                              body("high", "motion = \"free\"\nposition = [0, 0, 0.076]") +
                              body("far", "motion = \"free\"\nposition = [0.095, 0, -0.03]");
    const Watched w = watch(scene, 1);
    EXPECT_EQ(w.report.start_overlaps, 2u) << w.warnings;
    EXPECT_TRUE(says(w, "\"low\" and \"high\" start 24 mm inside each other, 14 %")) << w.warnings;
    EXPECT_FALSE(says(w, "far")) << w.warnings;
    EXPECT_TRUE(watch("gravity = [0, 0, 0]\n" + body("low", "") + body("high", "motion = \"free\"\nposition = [0, 0, 0.101]"), 30)
                    .warnings.empty());
}

TEST(RunWatch, NamesAToolThatStartsInside) {
    const auto scene = [](const std::string& height) {
        return body("block", "") +
               "[[body]]\nname = \"probe\"\nshape = \"sphere\"\nsize = 0.01\ntriangles = 300\nmotion = \"hand\"\nposition = [0, 0, " +
               height + "]\n[[tool]]\nbody = \"probe\"\ntip_radius = 0.005\npath = [{time = 0.0, position = [0, 0, " + height + "]}]\n";
    };
    const Watched inside = watch(scene("0.048"), 3), outside = watch(scene("0.0551"), 3);
    EXPECT_EQ(inside.report.tools_inside, 1u);
    EXPECT_TRUE(says(inside, "the tool \"probe\" starts inside \"block\"")) << inside.warnings;
    EXPECT_EQ(outside.report.tools_inside, 0u);
    EXPECT_TRUE(outside.warnings.empty()) << outside.warnings;
}

// Counted are steps of less than 0.02 ms: all of a stiff shell's, none of a soft one's. The warning comes before the first pass.
TEST(RunWatch, NamesShortSteps) {
    for (const bool stiff : {true, false}) {
        const Watched w = watch("gravity = [0, 0, 0]\n" + body("mesh", kSoft + "youngs_modulus = " + (stiff ? "1e11" : "1e4")), 2);
        EXPECT_EQ(w.report.short_steps > 0, stiff);
        EXPECT_EQ(says(w, "\"mesh\" takes "), stiff) << w.warnings;
    }
}

// Every third vertex of a soft block is mirrored: named at the end of the run.
TEST(RunWatch, NamesWhatCrossesItself) {
    const WrittenScene written("crossed", "gravity = [0, 0, 0]\n" + body("block", kSoft + "youngs_modulus = 10"));
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(written.build().world, {});
        RunWatch watch(frame.world());
        const Range particles = frame.world().bodies.particles[0];
        for (uint32_t p = particles.first; p < particles.end(); p += 3) frame.world().particles.offset[p].x *= -1;
        for (int pass = 0; pass < 2; ++pass) frame.step(), watch.after_pass(frame);
        watch.finish(frame.world());
        const uint64_t pairs = frame.world().report.self_crossings;
        EXPECT_GT(pairs, 0u);
        const std::vector<std::string> warnings = watch.take_warnings();
        EXPECT_TRUE(std::ranges::any_of(warnings, [&](const std::string& text) {
            return text.find("\"block\" crosses itself in " + std::to_string(pairs) + " pairs of faces") != std::string::npos;
        })) << testing::PrintToString(warnings);
    });
}

// Turns one inner node's tetrahedra inside out by hand; what is counted at the end of the pass is what doubles say.
TEST(RunWatch, CountsInvertedTetrahedra) {
    uint32_t inverted = 0;
    const auto disturb = [&](World& w, int pass) {
        if (pass != 1) return;
        const Range particles = w.bodies.particles[0];
        // a far throw: one step later the node is still outside of what was around it
        w.particles.offset[particles.first].x += 0.3f;
    };
    const std::string scene = "gravity = [0, 0, 0]\n" + body("block", kSolid + "poisson = 0.45\nyoungs_modulus = 1e3");
    const WrittenScene written("inverted", scene);
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(written.build().world, {});
        RunWatch watch(frame.world());
        const World& w = frame.world();
        for (int pass = 0; pass < 2; ++pass) {
            disturb(frame.world(), pass);
            frame.step();
            watch.after_pass(frame);
        }
        const auto at = [&](uint32_t node) {
            const Float4& o = w.particles.offset[w.bodies.particles[0].first + node];
            return Vec3d(o.x, o.y, o.z);
        };
        for (uint32_t t = 0; t < w.solids.info[w.bodies.mesh[0]].count; ++t) {
            const Vec3d a = at(w.solids.corner[0][t]);
            inverted += (at(w.solids.corner[1][t]) - a).dot((at(w.solids.corner[2][t]) - a).cross(at(w.solids.corner[3][t]) - a)) <= 0;
        }
        EXPECT_GT(inverted, 0u);
        EXPECT_EQ(w.report.inverted_tetrahedra, inverted);
        const std::vector<std::string> warnings = watch.take_warnings();
        EXPECT_TRUE(std::ranges::any_of(warnings, [&](const std::string& text) {
            return text.find(std::to_string(inverted) + " of " + std::to_string(w.solids.info[w.bodies.mesh[0]].count) +
                             " tetrahedra of \"block\" are inside out") != std::string::npos;
        }));
    });
}

// Motion out of nothing is called so, and ten times what was there breaks the run; a fall, a bounce and a spring are not.
TEST(RunWatch, NamesEnergyFromNowhere) {
    const std::string thrown = "gravity = [0, 0, 0]\n" +
                               body("other", "motion = \"free\"\nposition = [0.5, 0, 0]\nvelocity = [0.1, 0, 0]") +
                               body("ball", "motion = \"free\"\nvelocity = [1, 0, 0]");
    for (const double faster : {1.0, 1.004, 1.02, 4.0}) {
        const Watched w = watch(thrown, 20, [&](World& world, int pass) {
            if (pass == 5) world.poses.velocity[1] *= faster;
        });
        EXPECT_EQ(w.report.unearned_energy > 0, faster > 1.005) << faster;
        EXPECT_EQ(says(w, "most energy is in \"ball\""), faster > 1.005 && faster < 3) << faster << w.warnings;
        EXPECT_EQ(w.ruin.empty(), faster < 3) << w.ruin;
    }
    const std::string floor = body("floor", "position = [0, 0, -0.05]"), up = "position = [0, 0, 0.2]\n";
    for (const std::string& dropped : {up + "motion = \"free\"\n[body.tissue]\nrestitution = 0.9", up + kSoft, up + kSolid}) {
        const Watched w = watch("[contact]\nrate = 240\n" + floor + body("thing", dropped), 240);
        EXPECT_EQ(w.report.unearned_energy, 0u) << w.warnings << w.ruin;
    }
}

// A cube of 4.2 g at rest in space is given a speed: what is less than the tolerance of contacts in a pass, 6 mm/s at 60 Hz, no
// contact resolves; more than that comes from nowhere. While it falls, its weight times the tolerance is as little.
TEST(RunWatch, JudgesEnergyByWhatContactsResolve) {
    const std::string cube = body("cube", "motion = \"free\"\nmass = 0.0042"), still = "gravity = [0, 0, 0]\n";
    const auto given = [&](const std::string& gravity, double speed) {
        return watch(gravity + cube, 20, [&](World& world, int pass) {
            if (pass == 5) world.poses.velocity[0] += Vec3d(speed, 0, 0);
        });
    };
    const double resolved = 1e-4 * 60;
    for (const double times : {0.2, 0.9, 1.2, 5.0}) {
        const Watched w = given(still, times * resolved);
        EXPECT_EQ(w.report.unearned_energy > 0, times > 1) << times << w.warnings;
    }
    const double weight = std::sqrt(2 * 9.81 * 1e-4);  // m/s, of a fall by the tolerance
    EXPECT_EQ(given("gravity = [0, 0, -9.81]\n", 0.9 * weight).report.unearned_energy, 0u);
    EXPECT_GT(given(still, 0.9 * weight).report.unearned_energy, 0u);
}

// Soft cubes that start 20 mm inside each other: straining a ball as large as one by that takes 1/2 E (d / r)^2 4/3 pi r^3. Correction
// that does less is the price of parting; more than twice that comes from nowhere, however long they are still inside.
TEST(RunWatch, PartingTakesNoMoreThanTheOverlapNeeds) {
    const std::string scene = "gravity = [0, 0, 0]\n" + body("low", kSoft) + body("high", "position = [0.003, 0.002, 0.08]\n" + kSoft);
    const double r = 0.05 * std::sqrt(3.0), d = 0.02, strain = d / r;
    const double needs = 0.5 * 10e3 * strain * strain * 4.0 / 3 * std::numbers::pi * r * r * r;
    for (const double share : {0.1, 0.3}) {
        const Watched w = watch(scene, 14, [&](World& world, int pass) {
            if (pass > 0 && pass < 9) world.energy.work_push += share * needs;
        });
        EXPECT_EQ(w.report.unearned_energy > 0, share > 0.25) << share << w.warnings;
        EXPECT_EQ(says(w, "the work of position correction is"), share > 0.25) << share << w.warnings;
    }
}

// A scripted cube at 6 m/s moves its own length in a pass: named if something that may move is in its way, not if it flies away.
TEST(RunWatch, NamesWhatMovesFartherThanContactsLook) {
    for (const std::string to : {"0.5", "-1.5"}) {
        const Watched w = watch("gravity = [0, 0, 0]\n" + body("thing", "motion = \"free\"\nposition = [0.2, 0, 0]") +
                                    body("ram",
                                         "motion = \"kinematic\"\npath = [{time = 0.0, position = [-0.5, 0, 0]}, {time = 0.1667, "
                                         "position = [" +
                                             to + ", 0, 0]}]"),
                                12);
        EXPECT_GT(w.report.unswept_bodies, 0u);
        EXPECT_EQ(says(w, "it may go through \"thing\""), to == "0.5") << w.warnings;
        EXPECT_EQ(says(w, "\"ram\" moves"), to == "0.5") << w.warnings;
    }
}

// Moved into a wall by hand and held there: named at the end with the depth of that moment.
TEST(RunWatch, NamesWhatIsLeftInside) {
    const std::string scene =
        "[contact]\npush_speed = 0.0\n" + body("wall", "") + body("stuck", "motion = \"free\"\nposition = [0, 0, 0.2]");
    const auto push_in = [](World& world, int) {
        world.poses.origin[1] = Vec3d(0, 0, 0.092);
        world.poses.velocity[1] = Vec3d::Zero();
    };
    const Watched w = watch("gravity = [0, 0, 0]\n" + scene, 12, push_in);
    EXPECT_EQ(w.report.left_overlaps, 1u);
    EXPECT_TRUE(says(w, "\"wall\" and \"stuck\" are left 8 mm inside each other, 4.6 %")) << w.warnings;
    EXPECT_EQ(watch("gravity = [0, 0, 0]\n" + scene, 3, push_in).report.left_overlaps, 0u);
}

// Two balls that start half inside each other and may not be pushed apart fall asleep so: named at the end all the same, with the
// depth that they have awake.
TEST(RunWatch, NamesWhatSleepsInside) {
    const auto balls = [](const std::string& keys) {
        std::string text = keys + "gravity = [0, 0, 0]\n[contact]\npush_speed = 0.0\n";
        for (const char* place : {"name = \"a\"\nposition = [0, 0, 0]", "name = \"b\"\nposition = [0.05, 0.003, 0.002]"})
            text += std::string("[[body]]\n") + place +
                    "\nshape = \"sphere\"\nsize = 0.1\ntriangles = 300\nmotion = \"deformable\"\nmodel = \"solid\"\ncells = 5\n"
                    "[body.tissue]\nyoungs_modulus = 2e4\n";
        return text;
    };
    uint32_t asleep = 0;
    const Watched sleeping =
        watch(balls(""), 90, [&](World& world, int) { asleep = is_asleep(world.sleep, 0) + is_asleep(world.sleep, 1); });
    ASSERT_EQ(asleep, 2u);
    const Watched awake = watch(balls("sleep_speed = 0\n"), 90, [](World&, int) {});
    EXPECT_EQ(awake.report.left_overlaps, 1u);
    EXPECT_EQ(sleeping.report.left_overlaps, 1u);
    const auto depth = [](const Watched& w) {
        const size_t at = w.warnings.find("are left ");
        return at == std::string::npos ? 0 : std::stod(w.warnings.substr(at + 9));
    };
    EXPECT_GT(depth(awake), 20);
    EXPECT_NEAR(depth(sleeping), depth(awake), 1) << sleeping.warnings << awake.warnings;
}

// A script that jumps below a box lifts it without work: the program says so, by name and number, and ends with 1.
TEST(RunWatch, ARunOfEnergyFromNowhereEndsWithOne) {
    const auto lift = [](const std::string& jump) {
        return "[contact]\npush_speed = 10.0\n" + body("floor", "position = [0, 0, -0.05]") +
               body("thing", "motion = \"free\"\nposition = [0, 0, 0.05]") +
               body("lift", "motion = \"kinematic\"\npath = [{time = 0.0, position = [0, 0, -1]}, {time = 0.1, position = [0, 0, " + jump +
                                "], jump = true}]");
    };
    const std::filesystem::path folder = std::filesystem::temp_directory_path() / ("trocar_watch_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder);
    for (const bool lifts : {true, false}) {
        const WrittenScene scene("jump", lift(lifts ? "-0.035" : "-0.2"));
        const Outcome outcome = run_program("run " + scene.path.string() + " --seconds 0.2 --no-render --out out", folder, folder);
        EXPECT_EQ(outcome.code, lifts ? 1 : 0) << outcome.err;
        EXPECT_EQ(outcome.err.find("the simulation broke: the work of position correction is 1") != std::string::npos, lifts)
            << outcome.err;
        EXPECT_EQ(outcome.err.find("most energy is in \"thing\"") != std::string::npos, lifts) << outcome.err;
    }
    std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace trocar
