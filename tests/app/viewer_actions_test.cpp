#include "systems/app/run/viewer_actions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <random>

#include "content/scene/build_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "systems/app/run/live_replay.hpp"
#include "tests/app/quick_scene.hpp"
namespace trocar {
namespace {
namespace fs = std::filesystem;
using Kind = ViewCommand::Kind;

World viewed_world(const std::string& toml) {
    const fs::path file = fs::path(testing::TempDir()) / "trocar_viewed.toml";
    std::ofstream(file) << toml;
    World world = build_scene(read_scene_file(file), Looks::kPlain).world;
    ViewerActions::make_room(world);
    return world;
}

// A soft ball of 80 mm that nothing holds, and a free box, in weightlessness.
const char* const kWeightless = R"(
name = "dragged"
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "ball"
shape = "sphere"
triangles = 320
size = 0.08
motion = "deformable"
anchor = "shape"
[body.tissue]
youngs_modulus = 2e4
damping = 0.0
[[body]]
name = "box"
shape = "box"
triangles = 12
size = 0.04
motion = "free"
position = [0.3, 0.0, 0.0]
[body.tissue]
density = 1000.0
)";

Vec3d momentum_of_body(const World& w, uint32_t body) {
    Vec3d sum = Vec3d::Zero();
    const Range nodes = w.bodies.particles[body];
    for (uint32_t p = nodes.first + embedded_count(w.solids, w.bodies.mesh[body]); p < nodes.end(); ++p)
        if (w.particles.offset[p].w > 0)
            sum += Vec3d(w.particles.velocity_x[p], w.particles.velocity_y[p], w.particles.velocity_z[p]) /
                   static_cast<double>(w.particles.offset[p].w);
    return sum;
}

ViewCommand command(Kind kind, const Vec3d& point = Vec3d::Zero(), uint32_t body = 0) {
    ViewCommand c;
    c.kind = kind, c.point = point, c.body = body;
    return c;
}
ViewCommand setting(const std::string& key, const std::string& value) {
    ViewCommand c;
    c.kind = Kind::kSet, c.key = key, c.value = value;
    return c;
}

// The hand's links give a free ball the momentum of their impulses, and the hand's work is what the ball and the links have.
TEST(ViewerActions, DraggingASoftBallGivesItTheHandsMomentumAndWork) {
    Frame frame(viewed_world(kWeightless), {});
    ViewerActions actions;
    frame.step();
    const Vec3d surface(0.04, 0, 0);
    actions.obey(command(Kind::kGrab, surface, 0), frame, nullptr);
    Vec3d given = Vec3d::Zero();
    double most_work = 0, worst = 0;
    for (int pass = 0; pass < 60; ++pass) {
        const double angle = 0.1 * pass;
        actions.obey(command(Kind::kPull, surface + 0.03 * Vec3d(std::sin(angle), 1 - std::cos(angle), 0.5 * angle)), frame, nullptr);
        actions.before_pass(frame);
        frame.step();
        given += frame.world().links.group[0].impulse;
        if (!frame.times().picture) continue;
        most_work = std::max(most_work, std::abs(frame.world().energy.work_hand));
        worst = std::max(worst, std::abs(frame.world().energy.balance));
    }
    EXPECT_GT(frame.world().energy.work_hand, 1e-4);
    EXPECT_LT((momentum_of_body(frame.world(), 0) - given).norm(), 1e-4 * given.norm()) << given.transpose();
    EXPECT_LT(worst, 0.01 * most_work);
    actions.obey(command(Kind::kLet), frame, nullptr);
    EXPECT_FALSE(actions.holds());
    const Vec3d left = momentum_of_body(frame.world(), 0);
    const double work = frame.world().energy.work_hand;
    for (int pass = 0; pass < 10; ++pass) actions.before_pass(frame), frame.step();
    EXPECT_LT((momentum_of_body(frame.world(), 0) - left).norm(), 1e-5 * left.norm()) << "nothing pulls any more";
    EXPECT_EQ(frame.world().energy.work_hand, work);
    EXPECT_LT(std::abs(frame.world().energy.balance), 0.01 * most_work);
}

// A free body: its energy of motion is the hand's work, and with weight it hangs m g / k below the hand.
TEST(ViewerActions, AFreeBodyHangsByTheSpringOfTheHand) {
    Frame frame(viewed_world(kWeightless), {});
    World& w = frame.world();
    ViewerActions actions;
    const RigidMass mass = w.bodies.rigid_mass[0];
    const Vec3d start = w.poses.origin[1] + mass.centre;
    frame.step();
    actions.obey(command(Kind::kGrab, start + Vec3d(0.02, 0.02, 0.02), 1), frame, nullptr);
    actions.obey(command(Kind::kPull, start + Vec3d(0.05, 0.02, 0.06)), frame, nullptr);
    for (int pass = 0; pass < 8; ++pass) actions.before_pass(frame), frame.step();
    EXPECT_GT(w.energy.work_hand, 1e-5);
    EXPECT_GT(w.poses.angular_velocity[1].norm(), 0.1) << "pulled at a corner it turns";
    EXPECT_LT(std::abs(w.energy.balance), 1e-6 * w.energy.work_hand);
    actions.obey(command(Kind::kLet), frame, nullptr);

    Frame heavy(viewed_world(kWeightless), {});
    ViewerActions hand;
    heavy.step();
    hand.obey(setting("gravity", "[0, 0, -9.81]"), heavy, nullptr);
    hand.obey(command(Kind::kGrab, start, 1), heavy, nullptr);
    double sag = 0;  // m, mean over a second: passes are 16 and 17 ms long
    for (int pass = 0; pass < 300; ++pass) {
        hand.before_pass(heavy);
        heavy.step();
        if (pass >= 240) sag += (start.z() - (heavy.world().poses.origin[1] + mass.centre).z()) / 60;
    }
    EXPECT_NEAR(sag, mass.mass * 9.81 / ViewerActions::kStiffness, 0.05 * sag);
    EXPECT_LT(heavy.world().poses.velocity[1].norm(), 0.2) << "a pass of falling, 0.16 m/s, at most";
}

TEST(ViewerActions, TheHandIsNeitherFasterNorStrongerThanAHand) {
    Frame frame(viewed_world(kWeightless), {});
    ViewerActions actions;
    frame.step();
    actions.obey(command(Kind::kGrab, Vec3d(0.04, 0, 0), 0), frame, nullptr);
    actions.obey(command(Kind::kPull, Vec3d(100, 0, 0)), frame, nullptr);
    Vec3d before = frame.world().links.point[0];
    for (int pass = 0; pass < 60; ++pass) {
        const double period = 1e-3 * frame.world().clock.period;
        actions.before_pass(frame);
        const Vec3d now = frame.world().links.point[0];
        EXPECT_LE((now - before).norm(), ViewerActions::kFastest * period * (1 + 1e-9));
        before = now;
        frame.step();
        EXPECT_LE(frame.world().links.group[0].impulse.norm() / period, 1.05 * ViewerActions::kStrongest);
    }
}

TEST(ViewerActions, GravityThatChangesIsNobodysWork) {
    Frame frame(quick_scene(), {});
    ViewerActions actions;
    for (int pass = 0; pass < 20; ++pass) frame.step();
    const double peak = frame.world().energy.elastic + frame.world().energy.kinetic, before = frame.world().energy.balance;
    actions.obey(setting("gravity", "[3, 0, -2]"), frame, nullptr);
    for (int pass = 0; pass < 2; ++pass) frame.step();
    EXPECT_LT(std::abs(frame.world().energy.balance - before), 0.02 * std::max(peak, frame.world().energy.elastic));
    EXPECT_GT(std::abs(frame.world().energy.gravity), 0);
}

TEST(ViewerActions, WhatCannotBeDoneIsRefusedAndChangesNothing) {
    Frame frame(quick_scene(), {});
    ViewerActions actions;
    frame.step();
    const uint64_t hash = state_hash(frame.world()), all = scene_hash(frame.world());
    for (const auto& [key, value] : std::vector<std::pair<std::string, std::string>>{{"gravity", "[0, 0]"},
                                                                                     {"gravity", "[nan, 0, 0]"},
                                                                                     {"contact.tolerance", "-1"},
                                                                                     {"contact.tolerance", "fast"},
                                                                                     {"contact.iterations", "0"},
                                                                                     {"liver.tissue.friction", "-1"},
                                                                                     {"nobody.tissue.friction", "1"},
                                                                                     {"contact.deep", "\"last_free\""},
                                                                                     {"liver.tissue.youngs_modulus", "1e4"},
                                                                                     {"", ""}})
        EXPECT_THROW(actions.obey(setting(key, value), frame, nullptr), InputError) << key << " = " << value;
    EXPECT_THROW(actions.obey(command(Kind::kPull), frame, nullptr), InputError);
    EXPECT_THROW(actions.obey(command(Kind::kGrab, Vec3d::Zero(), 77), frame, nullptr), InputError);
    EXPECT_THROW(actions.obey(command(Kind::kGrab, Vec3d(9, 9, 9), 0), frame, nullptr), InputError) << "far from every node";
    actions.obey(command(Kind::kLet), frame, nullptr);
    actions.before_pass(frame);
    EXPECT_EQ(scene_hash(frame.world()), all);
    EXPECT_EQ(state_hash(frame.world()), hash);
    // nor when there is a slot of an earlier hand, or a body in the hand
    actions.obey(command(Kind::kGrab, {0, 0, 0.06}, 0), frame, nullptr);
    for (int held = 1; held >= 0; --held) {
        const uint64_t now = state_hash(frame.world());
        EXPECT_THROW(actions.obey(command(Kind::kGrab, Vec3d(9, 9, 9), 0), frame, nullptr), InputError);
        EXPECT_EQ(state_hash(frame.world()), now) << held;
        EXPECT_EQ(actions.holds(), held == 1);
        actions.obey(command(Kind::kLet), frame, nullptr);
    }
}

// A viewed run with commands is repeated from its recording, through a file and with another number of threads; without commands it
// has the bits of a run that nobody can hold.
TEST(ViewerActions, AViewedRunIsRepeatedToTheBit) {
    const auto viewed = [] {
        World w = quick_scene();
        ViewerActions::make_room(w);
        return w;
    };
    std::map<uint64_t, std::vector<ViewCommand>> script;
    script[3] = {command(Kind::kGrab, {0, 0, 0.06}, 0), command(Kind::kPull, {0.02, 0, 0.08})};
    script[10] = {setting("liver.tissue.friction", "0.7"), command(Kind::kPull, {-0.02, 0.01, 0.07})};
    script[20] = {setting("gravity", "[0, 1, -3]"), command(Kind::kLet)};
    script[22] = {setting("contact.tolerance", "2e-4"), command(Kind::kGrab, {0, 0.06, 0}, 0)};
    LiveRecording recording;
    recording.lockstep = recording.viewed = true;
    const auto run = [&](bool with_script, uint32_t threads, World world) {
        uint64_t hash = 0;
        ThreadPool pool(threads);
        pool.run([&] {
            Frame frame(std::move(world), {});
            ViewerActions actions;
            if (with_script) recording.start_hash = scene_hash(frame.world());
            for (uint64_t pass = 0; pass < 40; ++pass) {
                if (with_script) {
                    for (ViewCommand& c : script[pass]) c.pass = pass, actions.obey(c, frame, nullptr), recording.command.push_back(c);
                    recording.slip.push_back(0);
                }
                actions.before_pass(frame);
                frame.step();
            }
            hash = state_hash(frame.world());
        });
        return hash;
    };
    const uint64_t plain = run(false, 2, quick_scene());
    EXPECT_EQ(run(false, 2, viewed()), plain);
    recording.state_hash = run(true, 2, viewed());
    EXPECT_NE(recording.state_hash, plain);
    const fs::path file = fs::path(testing::TempDir()) / "trocar_viewed.recording";
    write_live_recording(file, recording);
    const LiveRecording again = read_live_recording(file);
    ASSERT_EQ(again.command.size(), recording.command.size());
    const auto difference = [&](const LiveRecording& r, uint32_t threads) {
        std::string text;
        ThreadPool pool(threads);
        pool.run([&] {
            Frame frame(viewed(), {});
            LiveReplay replay({}, r, "file", frame);
            while (frame.world().clock.tick < replay.end_tick()) replay.begin_pass(), frame.step();
            text = replay.difference();
        });
        return text;
    };
    EXPECT_EQ(difference(again, 1), "");
    EXPECT_EQ(difference(again, 3), "");
    LiveRecording other = again;
    other.viewed = false;
    write_live_recording(file, other);
    EXPECT_THROW(read_live_recording(file), InputError) << "commands of nobody";
    other.viewed = true, other.tools = 1, other.taken.assign(other.slip.size(), 1);
    write_live_recording(file, other);
    EXPECT_THROW(read_live_recording(file), InputError) << "ticks of a run without a clock";
    other = again;
    other.command[1].point.x() = std::nextafter(other.command[1].point.x(), 1.0);
    EXPECT_NE(difference(other, 2), "") << "one bit of one pull";
}

// Two balls that a staple holds together may get wet, a stapler stands beside.
const char* const kStapled = R"(
name = "stapled"
gravity = [0.0, 0.0, 0.0]
[fluid]
gravity = [0.0, 0.0, -9.81]
bodies = ["a"]
[[body]]
name = "a"
shape = "sphere"
triangles = 320
size = 0.08
motion = "deformable"
anchor = "shape"
[[body]]
name = "b"
shape = "sphere"
triangles = 320
size = 0.08
motion = "deformable"
anchor = "shape"
position = [0.0, 0.0, 0.0805]
[[body]]
name = "stapler"
shape = "sphere"
triangles = 100
size = 0.01
motion = "hand"
position = [0.0, 0.03, 0.04]
mass = 0.05
[[tool]]
body = "stapler"
tip_radius = 0.005
stiffness = 300.0
damping = 3.0
[[tool.action]]
kind = "staple"
at = [0.05]
point = [0.0, -0.03, 0.0]
reach = 0.02
[[tool.path]]
time = 0.0
position = [0.0, 0.03, 0.04]
[[tool.path]]
time = 1.0
position = [0.0, 0.03, 0.04]
)";

// What an instructor lets happen: the ledger has the blood of the vessel, 1 ml/s for as long as it is open, the staple lets go of both
// bodies and of its energy, and the run is repeated to the bit; where there is neither surface nor staple it is refused.
TEST(ViewerActions, AnInstructorLetsATissueBleedAndAStapleSlip) {
    LiveRecording recording;
    recording.lockstep = recording.viewed = true;
    const auto happens = [](Kind kind, const Vec3d& point, uint32_t body = 0) {
        ViewCommand c = command(kind, point, body);
        c.rate = kind == Kind::kBleed ? 1e-6 : 0;
        return c;
    };
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(viewed_world(kStapled), {});
        World& w = frame.world();
        ViewerActions actions;
        recording.start_hash = scene_hash(w);
        const auto obey = [&](ViewCommand c) {
            c.pass = w.clock.pass;
            actions.obey(c, frame, nullptr), recording.command.push_back(c);
        };
        const auto step = [&](int passes) {
            for (; passes > 0; --passes) actions.before_pass(frame), frame.step(), recording.slip.push_back(0);
        };
        step(10);
        ASSERT_EQ(w.action_state.staple.size(), 1u);
        const uint64_t before = state_hash(w);
        for (const ViewCommand& refused : {happens(Kind::kBleed, {0, 0, 0.04}, 1), happens(Kind::kBleed, {0, 0, 0}),
                                           happens(Kind::kBleed, {0, 0, 0}, 9), happens(Kind::kSlip, {0, 0, -0.04})})
            EXPECT_THROW(actions.obey(refused, frame, nullptr), InputError) << text_of(refused);
        EXPECT_EQ(state_hash(w), before);
        obey(happens(Kind::kBleed, {0.04, 0, 0}));
        const uint64_t ticks = w.clock.tick;
        step(10);
        EXPECT_NEAR(w.fluid_state.ledger.bled, 1e-6 * 1e-3 * static_cast<double>(w.clock.tick - ticks), 2e-9);
        double wettest = 0;
        Vec3d place = Vec3d::Zero();
        for (uint32_t v = 0; v < w.meshes.info[w.bodies.mesh[0]].vertices.count; ++v)
            if (w.fluid_state.volume[w.fluids.body[0].cells.first + v] > wettest)
                wettest = w.fluid_state.volume[w.fluids.body[0].cells.first + v], place = vertex_position(surfaces_of(w), 0, v);
        EXPECT_LT((place - Vec3d(0.04, 0, 0)).norm(), 0.02) << "where it was asked for";
        obey(happens(Kind::kSlip, {0, 0, 0.04}));
        EXPECT_TRUE(w.action_state.staple.empty());
        for (const LinkGroup& g : w.links.group) EXPECT_EQ(g.links.count, 0u);
        EXPECT_EQ(w.action_state.progress[0].pulled_out, 0u) << "it was not the trainee's doing";
        step(20);
        EXPECT_LT(std::abs(w.energy.balance), 1e-3 * (std::abs(w.energy.kinetic) + std::abs(w.energy.elastic) + 1e-6));
        recording.state_hash = state_hash(w);
    });
    const fs::path file = fs::path(testing::TempDir()) / "trocar_injected.recording";
    write_live_recording(file, recording);
    for (const uint32_t threads : {1u, 3u}) {
        ThreadPool other(threads);
        other.run([&] {
            const LiveRecording read = read_live_recording(file);
            Frame frame(viewed_world(kStapled), {});
            LiveReplay replay({}, read, "file", frame);
            while (frame.world().clock.tick < replay.end_tick()) replay.begin_pass(), frame.step();
            EXPECT_EQ(replay.difference(), "");
        });
    }
}

TEST(ViewCommand, EveryNumberIsReadBackToTheBit) {
    std::mt19937_64 random(5);
    for (int i = 0; i < 2000; ++i) {
        ViewCommand c;
        c.kind = static_cast<Kind>(random() % 6), c.pass = random() >> (11 + random() % 50);
        c.body = static_cast<uint32_t>(random() % 1000), c.rate = 1e-4 / (1 + static_cast<double>(random() % 1000));
        for (int k = 0; k < 3; ++k)
            c.point[k] = std::ldexp(static_cast<double>(static_cast<int64_t>(random() >> 10)), -static_cast<int>(random() % 60) - 40);
        c.key = "body.\"\\\n" + std::to_string(random()), c.value = "[0,\t1]";
        const ViewCommand back = read_view_command(text_of(c));
        EXPECT_EQ(back.kind, c.kind);
        EXPECT_EQ(back.pass, c.pass);
        if (c.kind == Kind::kSet) {
            EXPECT_EQ(back.key, c.key);
            EXPECT_EQ(back.value, c.value);
        }
        if (c.kind == Kind::kGrab || c.kind == Kind::kBleed) {
            EXPECT_EQ(back.body, c.body);
        }
        EXPECT_EQ(back.rate, c.kind == Kind::kBleed ? c.rate : 0);
        if (c.kind != Kind::kSet && c.kind != Kind::kLet) {
            EXPECT_EQ(back.point, c.point) << text_of(c);
        }
    }
}

// Damaged messages are refused or are commands with finite numbers; nothing else comes of them.
TEST(ViewCommand, DamagedMessagesAreRefusedOrMeanSomethingFinite) {
    const std::string seeds[] = {R"({"do":"grab","body":3,"point":[0.1,-2e-3,3]})",         R"({"do":"pull","point":[1,2,3],"pass":17})",
                                 R"({"do":"set","key":"gravity","value":"[0, 0, -9.81]"})", R"({"do":"let"})",
                                 R"({"do":"bleed","body":1,"point":[0,1,2],"rate":1e-6})",  R"({"do":"slip","point":[0,1,2]})"};
    const std::string pieces[] = {"null", "1e999", "-1",  "[", "]", "{", "}", "\"", "\\u0000", "\xff\xfe", "9223372036854775808",
                                  "true", ",",     "1e6", "{}"};
    std::mt19937 random(7);
    int refused = 0, understood = 0;
    for (int i = 0; i < 40000; ++i) {
        std::string text = seeds[random() % std::size(seeds)];
        for (uint32_t change = 0, changes = random() % 3 + (i % 10 > 0); change < changes; ++change) {
            const size_t at = random() % (text.size() + 1);
            const uint32_t how = random() % 4;
            if (how == 0) text.insert(at, pieces[random() % std::size(pieces)]);
            if (how == 1 && at < text.size()) text[at] = static_cast<char>(random());
            if (how == 2) text.erase(at, random() % 6);
            if (how == 3) text.replace(at, random() % 8, pieces[random() % std::size(pieces)]);
        }
        try {
            const ViewCommand c = read_view_command(text);
            ++understood;
            EXPECT_TRUE(c.point.allFinite() && c.point.cwiseAbs().maxCoeff() <= 1e6) << text;
            EXPECT_TRUE(c.rate >= 0 && c.rate <= 1e-4) << text;
            EXPECT_LE(c.key.size() + c.value.size(), 400u);
        } catch (const InputError& error) {
            ++refused;
            EXPECT_LT(std::string(error.what()).size(), 500u);
        }
    }
    EXPECT_GT(refused, 10000);
    EXPECT_GT(understood, 2000);
    for (const std::string& deep : {std::string(4000, '['), std::string(4000, '{'), R"({"do":)" + std::string(3000, '[')})
        EXPECT_THROW(read_view_command(deep), InputError);
}

}  // namespace
}  // namespace trocar
