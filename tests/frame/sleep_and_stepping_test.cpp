#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <numbers>
#include <random>

#include "engine/base/error.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "systems/output/deformable_energy.hpp"
#include "systems/prepare/sleep.hpp"
#include "tests/frame/scenes_under_test.hpp"

namespace {
using namespace trocar;

// Two soft boxes on a table, a ball held far away in the air, and a plunger that comes down on the pair at 3
// s.
constexpr const char* kBoxes = R"(
sleep_speed = 2e-4
[[body]]
name = "table"
shape = "table"
triangles = 200
position = [0.0, 0.0, -0.01]
[[body]]
name = "low"
shape = "box"
triangles = 200
size = 0.05
motion = "deformable"
anchor = "shape"
position = [0.0, 0.0, 0.026]
tissue = {youngs_modulus = 3e4, wall = 3e-3, depth = 0.02, damping = 60.0, friction = 0.5}
[[body]]
name = "beside"
shape = "box"
triangles = 200
size = 0.05
motion = "deformable"
anchor = "shape"
position = [0.0501, 0.0, 0.026]
tissue = {youngs_modulus = 3e4, wall = 3e-3, depth = 0.02, damping = 60.0, friction = 0.5}
[[body]]
name = "held"
shape = "sphere"
triangles = 200
size = 0.05
motion = "deformable"
position = [0.0, 0.2, 0.2]
tissue = {youngs_modulus = 3e4, wall = 3e-3, depth = 0.02, damping = 60.0}
[[body]]
name = "plunger"
shape = "box"
triangles = 200
size = 0.02
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.15]
[[body.path]]
time = 0.1
position = [0.0, 0.0, 0.15]
[[body.path]]
time = 2.5
position = [0.0, 0.0, 0.15]
[[body.path]]
time = 3.0
position = [0.0, 0.0, 0.055]
)";

SceneFile scene_of(const std::string& text, const std::vector<Override>& overrides = {}) {
    const std::string path = testing::TempDir() + "/sleep_and_stepping.toml";
    std::ofstream(path) << text;
    return read_scene_file(path, overrides);
}

uint32_t body_named(const World& w, const std::string& name) {
    for (uint32_t b = 0; b < w.bodies.name.size(); ++b)
        if (w.bodies.name[b] == name) return b;
    return kNone;
}

std::vector<Float4> positions(const World& w, uint32_t body) {
    const Range r = w.bodies.particles[body];
    return {w.particles.offset.begin() + r.first, w.particles.offset.begin() + r.end()};
}
bool same(const std::vector<Float4>& a, const std::vector<Float4>& b) {
    return 0 == std::memcmp(a.data(), b.data(), a.size() * sizeof(Float4));
}

// The boxes fall asleep as a group, are still bit for bit, and are all woken before they are touched, while
// the distant body sleeps on.
TEST(Sleep, LiesStillUntilSomethingComesNear) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene_of(kBoxes), Looks::kPlain).world), {});
        const World& w = frame.world();
        const uint32_t low = body_named(w, "low"), beside = body_named(w, "beside"), held = body_named(w, "held");
        uint64_t slept_at = 0, woke_at = 0;
        std::vector<Float4> low_place, held_place;
        for (int pass = 0; pass < 60 * 4; ++pass) {
            frame.step();
            const bool asleep = is_asleep(w.sleep, low);
            EXPECT_EQ(asleep, is_asleep(w.sleep, beside)) << pass;
            if (asleep && slept_at == 0) {
                slept_at = w.clock.tick;
                low_place = positions(w, low), held_place = positions(w, held);
                EXPECT_TRUE(is_asleep(w.sleep, held));
                EXPECT_EQ(w.report.asleep_bodies, 3u);
                EXPECT_EQ(w.report.awake_bodies, 0u);
            }
            if (asleep && woke_at == 0) {  // under the plunger it comes to rest again, at another position
                ASSERT_TRUE(same(low_place, positions(w, low))) << pass;
            }
            if (!asleep && slept_at > 0 && woke_at == 0) {
                woke_at = w.clock.tick;
                EXPECT_EQ(w.report.awake_bodies, 2u);
                EXPECT_FALSE(is_asleep(w.sleep, beside)) << "woken with its neighbour";
                // the plunger's lower face is still above the box
                EXPECT_GT(w.poses.origin[body_named(w, "plunger")].z() - 0.01, 0.05);
            }
        }
        EXPECT_GT(slept_at, 500u);
        EXPECT_LT(slept_at, 2400u);
        EXPECT_GT(woke_at, 2500u);
        EXPECT_TRUE(is_asleep(w.sleep, held));
        EXPECT_TRUE(same(held_place, positions(w, held)));
        EXPECT_FALSE(same(low_place, positions(w, low))) << "the plunger has pressed it";
        EXPECT_GT(w.report.contact_events, 0u);
        std::printf("asleep at %.2f s, awake at %.2f s\n", slept_at * 1e-3, woke_at * 1e-3);
    });
}

// A free box beside a soft one sleeps with it, bit for bit and with closed energy accounting, and wakes with
// it or when a program gives it a velocity. Breaks when free bodies keep their neighbours awake, or continue
// to fall while asleep.
TEST(Sleep, FreeBodiesSleepAndWakeWithTheirNeighbours) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene_of(kBoxes, {{"beside.motion", "free"}, {"sleep_speed", "1e-3"}}), Looks::kPlain).world),
                    {});
        World& w = frame.world();
        const uint32_t low = body_named(w, "low"), beside = body_named(w, "beside");
        uint64_t slept = 0, woke = 0;
        Vec3d position = Vec3d::Zero();
        double fallen = 0, worst = 0;
        for (int pass = 0; pass < 60 * 3; ++pass) {
            frame.step();
            const bool asleep = is_asleep(w.sleep, low);
            EXPECT_EQ(asleep, is_asleep(w.sleep, beside)) << pass;
            fallen = std::max(fallen, std::abs(w.energy.work_contact));
            worst = std::max(worst, std::abs(w.energy.balance));
            if (asleep && slept == 0) {
                slept = w.clock.tick, position = w.poses.origin[beside];
                EXPECT_EQ(w.report.asleep_bodies, 3u);
            }
            if (asleep && woke == 0) {
                ASSERT_EQ(w.poses.origin[beside], position) << pass;
                EXPECT_EQ(w.poses.velocity[beside], Vec3d(0, 0, 0));
                EXPECT_EQ(w.contact_constraints.body.size(), 0u) << "nobody asks about who sleeps";
            }
            if (!asleep && slept > 0 && woke == 0) woke = w.clock.tick;
        }
        EXPECT_GT(slept, 500u);
        EXPECT_LT(slept, 2400u);
        EXPECT_GT(woke, 2500u);
        EXPECT_LT(worst, 0.02 * fallen);
    });
    pool.run([&] {
        Frame frame(std::move(build_scene(scene_of(kBoxes, {{"beside.motion", "free"},
                                                            {"beside.position", "[0.2, 0.0, 0.026]"},
                                                            {"beside.tissue.damping", "0"},
                                                            {"sleep_speed", "1e-3"}}),
                                          Looks::kPlain)
                                  .world),
                    {});
        World& w = frame.world();
        const uint32_t beside = body_named(w, "beside");
        while (!is_asleep(w.sleep, beside) && w.clock.tick < 2400) frame.step();
        ASSERT_TRUE(is_asleep(w.sleep, beside));
        const double from = w.poses.origin[beside].z();
        w.poses.velocity[beside].z() = 1;
        for (int pass = 0; pass < 3; ++pass) frame.step();
        EXPECT_FALSE(is_asleep(w.sleep, beside));
        EXPECT_NEAR(w.poses.origin[beside].z() - from, 0.05 - 0.5 * 9.81 * 0.05 * 0.05, 1e-3);
    });
}

TEST(Sleep, SameBitsForAnyThreads) {
    uint64_t hash[2];
    for (int i = 0; i < 2; ++i) {
        ThreadPool pool(i == 0 ? 1 : 3);
        pool.run([&] {
            Frame frame(std::move(build_scene(scene_of(kBoxes), Looks::kPlain).world), {});
            for (int pass = 0; pass < 60 * 3; ++pass) frame.step();
            hash[i] = state_hash(frame.world());
        });
    }
    EXPECT_EQ(hash[0], hash[1]);
}

// Boxes, normals, pictures and energy accounting of sleeping bodies equal those of a run that recomputes them
// in every pass, while some bodies fall asleep, wake up, leave their slot asleep and are respawned; and
// nothing is recomputed for sleeping bodies.
void expect_same_with_and_without_looking(const std::function<BuiltScene()>& build, int passes) {
    FrameOptions look;
    look.update_sleeping_bodies = true;
    Frame skips(std::move(build().world), {}), looks(std::move(build().world), look);
    uint64_t slept = 0;
    for (int pass = 0; pass < passes; ++pass) {
        skips.step(), looks.step();
        for (const Resource r : {Resource::kBoxes, Resource::kPairs, Resource::kSleep, Resource::kNormals, Resource::kPicture,
                                 Resource::kEnergy, Resource::kParticles})
            ASSERT_EQ(resource_hash(skips.world(), r), resource_hash(looks.world(), r)) << resource_name(r) << " in pass " << pass;
        slept += skips.world().report.asleep_bodies;
    }
    EXPECT_GT(slept, 100u);
}

TEST(Sleep, WhoLiesStillLooksTheSame) {
    ThreadPool pool(1);
    pool.run([&] {
        expect_same_with_and_without_looking([] { return build_scene(scene_of(kBoxes), Looks::kPlain); }, 60 * 4);
        const std::vector<Override> few{{"count", "6"},       {"rate", "25"},         {"life", "1.5"},
                                        {"resolution", "80"}, {"sleep_speed", "0.5"}, {"sleep_after", "0.1"}};
        const auto stress = source_folder() / "content/scenes/stress_come_and_go.toml";
        expect_same_with_and_without_looking([&] { return build_scene(read_scene_file(stress, few), Looks::kPlain); }, 60 * 3);
    });
}

TEST(Sleep, NobodyLooksTwiceAtWhoLiesStill) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene_of(kBoxes), Looks::kPlain).world), {});
        World& w = frame.world();
        const uint32_t held = body_named(w, "held");
        int passes = 0;
        for (; passes < 60 * 2 && !is_asleep(w.sleep, held); ++passes) frame.step();
        for (int pass = 0; pass < 4; ++pass) frame.step();
        ASSERT_TRUE(is_asleep(w.sleep, held));
        Vec3& normal = w.normals.normal[w.bodies.particles[held].first];
        const Vec3 right = normal, mark(7, 7, 7);
        normal = mark;
        const Clock clock = w.clock;
        for (int pass = 0; pass < 4; ++pass) frame.step();
        EXPECT_EQ(normal, mark);
        w.clock = clock;  // as after restoring a state: clears what is cached about sleeping bodies
        for (int pass = 0; pass < 4; ++pass) frame.step();
        EXPECT_EQ(normal, right);
    });
}

TEST(Sleep, ZeroSpeedMeansNever) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene_of(kBoxes, {{"sleep_speed", "0"}}), Looks::kPlain).world), {});
        for (const std::string& name : frame.stage_names()) EXPECT_NE(name, "sleep");
        for (int pass = 0; pass < 60; ++pass) frame.step();
        EXPECT_TRUE(frame.world().sleep.group.empty());
    });
}

// Keys of the scene and of --set take effect; invalid ones are rejected with line and name.
TEST(SteppingKeys, FromSceneAndCommandLine) {
    const BuiltScene built = build_scene(
        scene_of(kBoxes,
                 {{"low.integrator", "implicit"}, {"low.step", "4e-3"}, {"beside.integrator", "implicit"}, {"beside.iterations", "3"}}),
        Looks::kPlain);
    const World& w = built.world;
    const uint32_t low = body_named(w, "low"), beside = body_named(w, "beside"), held = body_named(w, "held");
    EXPECT_EQ(stepping_of(w.bodies, low).integrator, Integrator::kBackwardEuler);
    EXPECT_EQ(stepping_of(w.bodies, low).step, 4e-3);
    EXPECT_EQ(stepping_of(w.bodies, beside).integrator, Integrator::kBackwardEuler);
    EXPECT_EQ(stepping_of(w.bodies, beside).iterations, 3u);
    EXPECT_EQ(stepping_of(w.bodies, held).integrator, Integrator::kLeapfrog);
    EXPECT_NE(built.notes[low].find("stepped by backward Euler"), std::string::npos) << built.notes[low];
}

// M09: a step set above the limit is rejected with the limit in the message. The tissue scenes run with every
// integrator, also where an untouched body follows a pressed one in its thread's scratch memory:
// bit-identical for any number of threads.
TEST(SteppingKeys, ScenesByEveryIntegrator) {
    for (const char* name : {"soft_stack", "jaw_grasp"}) {
        const auto file = source_folder() / "content/scenes" / (std::string(name) + ".toml");
        for (const char* integrator : {"leapfrog", "implicit", "auto"}) {
            std::vector<Override> all;
            for (const BodySpec& body : read_scene_file(file, {}).bodies)
                if (body.motion == Motion::kDeformable && !body.solid) all.push_back({body.name + ".integrator", integrator});
            uint64_t hash[2] = {0, 0};
            for (const uint32_t threads : {1u, 3u}) {
                ThreadPool pool(threads);
                pool.run([&] {
                    Frame frame(std::move(build_scene(read_scene_file(file, all), Looks::kPlain).world), {});
                    for (int pass = 0; pass < 8; ++pass) frame.step();
                    EXPECT_EQ(frame.world().report.nonfinite_particles + frame.world().report.runaway_bodies, 0u)
                        << name << ", " << integrator;
                    hash[threads == 3] = state_hash(frame.world());
                });
            }
            EXPECT_EQ(hash[0], hash[1]) << name << ", " << integrator;
        }
    }
}

TEST(SteppingKeys, M09_ImpossibleStepsAreRefused) {
    const auto refused = [](const char* key, const char* value) -> std::string {
        try {
            build_scene(scene_of(kBoxes, {{key, value}}), Looks::kPlain);
        } catch (const InputError& error) {
            return error.what();
        }
        return "";
    };
    const double limit = build_scene(scene_of(kBoxes), Looks::kPlain).world.bodies.stable_dt[1];
    const std::string above = refused("low.step", "0.05");
    char text[32];
    std::snprintf(text, sizeof text, "%.4g s", limit);
    EXPECT_NE(above.find(text), std::string::npos) << above;
    EXPECT_NE(above.find("low"), std::string::npos) << above;
    for (const char* bad : {"0", "-1e-3", "nan", "inf"}) EXPECT_NE(refused("low.step", bad), "") << bad;
    EXPECT_NE(refused("low.integrator", "euler").find("leapfrog, implicit, auto"), std::string::npos);
    for (const char* gone : {"xpbd", "midpoint"})
        EXPECT_NE(refused("low.integrator", gone).find("take \"leapfrog\", or \"implicit\""), std::string::npos) << gone;
    EXPECT_EQ(refused("low.step", "1e-4"), "");
}

// auto is leapfrog, however stiff and held; a solid asked to be implicit is refused by name.
TEST(SteppingKeys, AutoIsLeapfrogAndNoSolidIsImplicit) {
    const std::string stiff = "held.tissue.youngs_modulus";
    const BuiltScene by_auto = build_scene(scene_of(kBoxes, {{"held.integrator", "auto"}, {stiff, "1e9"}}), Looks::kPlain);
    EXPECT_EQ(stepping_of(by_auto.world.bodies, body_named(by_auto.world, "held")).integrator, Integrator::kLeapfrog);
    EXPECT_TRUE(by_auto.warnings.empty());
    EXPECT_TRUE(build_scene(scene_of(kBoxes, {{"held.integrator", "implicit"}, {stiff, "1e9"}}), Looks::kPlain).warnings.empty());
    try {
        build_scene(scene_of(kBoxes, {{"held.integrator", "implicit"}, {"held.model", "solid"}}), Looks::kPlain);
        ADD_FAILURE();
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("is for shells and sheets"), std::string::npos) << error.what();
        EXPECT_NE(std::string(error.what()).find("held"), std::string::npos) << error.what();
    }
}

// A shell under pressure with bending stiffness, hung by its lower half: undamped its energy never grows, damped it
// sags as with leapfrog.
TEST(Stepping, ImplicitBearsPressureAndBending) {
    struct Swing {
        double start = 0, most = -1e9, deformation = 0, sag = 0;  // J, J, J, m
    };
    const auto swing = [](const std::string& integrator, double damping) {
        const SceneFile scene = scene_of(
            "sleep_speed = 0.0\n[[body]]\nname = \"a\"\nshape = \"sphere\"\ntriangles = 320\nsize = 0.1\n"
            "motion = \"deformable\"\nanchor = \"world\"\nfixed_below = -0.03\nintegrator = \"" +
            integrator + "\"\n[body.tissue]\nyoungs_modulus = 2e4\nwall = 3e-3\ndepth = 0.05\n" +
            "pressure_modulus = 2e4\nbending = 2e4\ndamping = " + std::to_string(damping) + "\n");
        Swing found;
        ThreadPool pool(1);
        pool.run([&] {
            Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
            const World& w = frame.world();
            const Range rows = w.bodies.particles[0];
            const auto height = [&] {
                double sum = 0;
                for (uint32_t i = rows.first; i < rows.end(); ++i) sum += w.particles.offset[i].z;
                return sum / rows.count;
            };
            const double start = height();
            for (int pass = 0; pass < 120; ++pass) {
                frame.step();
                const Energy& e = w.energy;
                const double sum = e.kinetic + e.elastic + e.pressure + e.bending + e.gravity;
                if (pass == 0) found.start = sum;
                found.most = std::max(found.most, sum);
                found.deformation = std::max(found.deformation, e.elastic + e.pressure + e.bending);
            }
            found.sag = start - height();
        });
        return found;
    };
    const Swing free = swing("implicit", 0);
    EXPECT_LT(free.most - free.start, 1e-3 * free.deformation);
    const double leapfrog = swing("leapfrog", 30).sag, implicit = swing("implicit", 30).sag;
    EXPECT_GT(leapfrog, 1e-5);
    EXPECT_NEAR(implicit, leapfrog, 0.01 * leapfrog);
    std::printf("energy grows by %.2g of the deformation's, sag %.4f mm, leapfrog %.4f mm\n", (free.most - free.start) / free.deformation,
                1e3 * implicit, 1e3 * leapfrog);
}

// Such a shell, with springs that are soft compared with these forces, falls on a table.
TEST(Stepping, ImplicitBearsPressureUnderContact) {
    const std::string text =
        "sleep_speed = 0.0\n[[body]]\nname = \"floor\"\nshape = \"table\"\ntriangles = 200\nsize = 1.0\n"
        "[[body]]\nname = \"a\"\nshape = \"sphere\"\ntriangles = 320\nsize = 0.1\nposition = [0.0, 0.0, 0.0505]\n"
        "motion = \"deformable\"\nanchor = \"shape\"\nintegrator = \"implicit\"\n"
        "[body.tissue]\nyoungs_modulus = 2e2\nwall = 3e-3\ndepth = 0.05\npressure_modulus = 2e4\nbending = 2e4\n"
        "damping = 0.0\n";
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene_of(text), Looks::kPlain).world), {});
        const Energy& e = frame.world().energy;
        double first = 0, most = 0;
        for (int pass = 0; pass < 120; ++pass) {
            frame.step();
            const double sum = e.kinetic + e.elastic + e.pressure + e.bending + e.gravity;
            if (pass == 1) first = sum;
            most = std::max(most, sum);
        }
        EXPECT_EQ(frame.world().report.nonfinite_particles, 0u);
        EXPECT_GT(frame.world().report.contact_events, 10u);
        EXPECT_LT(most, 1.5 * first);
        std::printf("energy at most %.3f of the first, %.4g J\n", most / first, first);
    });
}

// A shell that falls on a table; where it is placed and how all of it is turned, gravity too, must not matter.
struct Drop {
    double height = 0.1, modulus = 2e5, step = 2.5e-4;
    uint32_t rate = 60;
    Vec3d shift = Vec3d::Zero(), turn = Vec3d::Zero();  // rotation vector

    World world() const {
        const double angle = turn.norm();
        const Vec3d axis = angle > 0 ? Vec3d(turn / angle) : Vec3d::UnitX();
        const auto text = [](const Vec3d& v) {
            char list[100];
            std::snprintf(list, sizeof list, "[%.17g, %.17g, %.17g]", v.x(), v.y(), v.z());
            return std::string(list);
        };
        const Quat q = from_rotation_vector(turn);
        const auto placed = [&](const Vec3d& at) {
            char turned[120];
            std::snprintf(turned, sizeof turned, "\nrotation = [%.17g, %.17g, %.17g, %.17g]\n", axis.x(), axis.y(), axis.z(),
                          angle * 180 / std::numbers::pi);
            return "position = " + text(shift + rotate(q, at)) + turned;
        };
        const std::string scene = "substep = " + std::to_string(step) + "\ngravity = " + text(rotate(q, Vec3d(0, 0, -9.81))) +
                                  "\n[contact]\nrate = " + std::to_string(rate) +
                                  "\n[[body]]\nname = \"floor\"\nshape = \"table\"\nsize = 0.6\n" + placed(Vec3d::Zero()) +
                                  "[[body]]\nname = \"ball\"\nshape = \"sphere\"\nsize = 0.1\ntriangles = 1000\n" +
                                  "motion = \"deformable\"\nanchor = \"shape\"\n" + placed(Vec3d(0, 0, height)) +
                                  "[body.tissue]\nyoungs_modulus = " + std::to_string(modulus) + "\n";
        const std::string path = testing::TempDir() + "drop.toml";
        std::ofstream(path) << scene;
        return build_scene(read_scene_file(path, {}), Looks::kPlain).world;
    }
    // Vertices in the frame of the scene after `seconds`, m.
    std::vector<Vec3d> land(double seconds, std::vector<double>* height_at_100_ms = nullptr) const {
        FrameOptions options;
        options.pictures = false;
        Frame frame(world(), options);
        const World& w = frame.world();
        const Quat back = conjugate(from_rotation_vector(turn));
        const Range range = w.bodies.particles[1];
        std::vector<Vec3d> vertex(w.meshes.info[w.bodies.mesh[1]].vertices.count);
        while (static_cast<double>(w.clock.tick) < 1e3 * seconds) {
            frame.step();
            if (!height_at_100_ms || w.clock.tick % 100 != 0) continue;
            double sum = 0, mass = 0;
            for (uint32_t v = 0; v < vertex.size(); ++v) {
                const Float4& o = w.particles.offset[range.first + v];
                sum += o.z / o.w, mass += 1 / o.w;
            }
            height_at_100_ms->push_back(w.poses.origin[1].z() + sum / mass);
        }
        for (uint32_t v = 0; v < vertex.size(); ++v) {
            const Float4& o = w.particles.offset[range.first + v];
            vertex[v] = rotate(back, Vec3d(w.poses.origin[1] + Vec3d(o.x, o.y, o.z) - shift));
        }
        return vertex;
    }
};

// Tissue that a hit has set vibrating turns its vertices round within a pass; those that come in then are found in time, at any rate: the
// centre's height over two bounces is that at 240 Hz to 0.15 % of the ball's size.
TEST(Drop, AShellBouncesTheSameAtAnyRate) {
    for (const double height : {0.08, 0.1, 0.13}) {
        for (const double modulus : {5e4, 1e5, 2e5, 4e5}) {
            std::vector<double> right;
            Drop{height, modulus, 2.5e-4, 240}.land(0.4, &right);
            ASSERT_EQ(right.size(), 4u);
            for (const uint32_t rate : {60u, 120u}) {
                std::vector<double> found;
                Drop{height, modulus, 2.5e-4, rate}.land(0.4, &found);
                ASSERT_EQ(found.size(), right.size());
                for (size_t i = 0; i < found.size(); ++i)
                    EXPECT_NEAR(found[i], right[i], 1.5e-4) << height << " m, " << modulus << " Pa, " << rate << " Hz";
            }
        }
    }
}

TEST(Drop, TheOriginAndTheAxesOfTheWorldDoNotMatter) {
    for (const double modulus : {2e5, 4e5}) {
        const std::vector<Vec3d> right = Drop{0.1, modulus}.land(0.3);
        std::mt19937 random(3);
        std::uniform_real_distribution<double> unit(-1, 1);
        for (int place = 0; place < 10; ++place) {
            Drop moved{0.1, modulus};
            if (place > 0) moved.turn = 3 * Vec3d(unit(random), unit(random), unit(random));
            if (place % 2 == 0) moved.shift = 10 * Vec3d(unit(random), unit(random), unit(random));
            const std::vector<Vec3d> found = moved.land(0.3);
            double most = 0;
            for (size_t v = 0; v < right.size(); ++v) most = std::max(most, (found[v] - right[v]).norm());
            EXPECT_LT(most, 1e-4) << modulus << " Pa, place " << place;
        }
    }
}

}  // namespace
