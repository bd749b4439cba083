#include <gtest/gtest.h>
#include <xmmintrin.h>

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "content/scene/build_scene.hpp"
#include "content/scene/make_prototype.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/tissue/links.hpp"
#include "systems/frame/frame.hpp"

namespace trocar {
namespace {

constexpr uint32_t kTable = 0, kBall = 1;

// A table and, optionally, a soft ball that falls on it.
World table_and_ball(bool with_ball = true) {
    World w;
    PrototypeOptions small;
    small.scale = 0.1;
    make_prototype(w.meshes, make_shape("table", 200), {});
    make_prototype(w.meshes, make_shape("sphere", 400), small);
    add_body(w, "table", kTable, Motion::kStatic);
    if (with_ball) {
        add_body(w, "ball", kBall, Motion::kDeformable, {}, AnchorFrame::kShape);
        w.poses.origin[1] = Vec3d(-0.2, 0, 0.06);
        make_deformable(w, 1);
    }
    make_trees(w);
    return w;
}

// A ball slightly above the table, soft or hard; returns its index.
uint32_t add_ball(World& w, Motion motion) {
    const uint32_t body = add_body(w, "other", kBall, motion, {}, AnchorFrame::kShape);
    w.poses.origin[body] = Vec3d(0.2, 0, 0.07);
    if (motion == Motion::kDeformable)
        make_deformable(w, body);
    else
        EXPECT_TRUE(set_rigid_mass(w.meshes, body, 0, w.bodies, w.particles));
    make_trees(w);
    return body;
}

std::string refusal(World w) {
    try {
        Frame(std::move(w), {});
    } catch (const InputError& e) {
        return e.what();
    }
    return "";
}

// Breaks when a frame accepts an incomplete world: it would then read beyond arrays, or divide by zero.
TEST(WorldsByHand, AFrameNamesWhatWasForgotten) {
    EXPECT_EQ(refusal(table_and_ball()), "");
    World w = table_and_ball();
    w.trees.clear();
    EXPECT_NE(refusal(std::move(w)).find("body 0 \"table\" has no closest-point tree"), std::string::npos);
    w = table_and_ball();
    add_body(w, "late", kBall, Motion::kStatic);
    EXPECT_NE(refusal(std::move(w)).find("body 2 \"late\" has no closest-point tree"), std::string::npos);
    w = table_and_ball();
    w.meshes.position.reserve(2 * w.meshes.position.capacity());  // as adding a prototype would
    EXPECT_NE(refusal(std::move(w)).find("make_trees is missing"), std::string::npos);
    w = table_and_ball();
    w.bodies.motion[kTable] = Motion::kDeformable;
    EXPECT_NE(refusal(std::move(w)).find("make_deformable is missing"), std::string::npos);
    w = table_and_ball();
    w.bodies.motion[kTable] = Motion::kFree;
    EXPECT_NE(refusal(std::move(w)).find("set_rigid_mass is missing"), std::string::npos);
    w = table_and_ball();
    w.bodies.mesh[kTable] = 42;
    EXPECT_NE(refusal(std::move(w)).find("is of no mesh"), std::string::npos);
    w = table_and_ball();
    w.poses.velocity.pop_back();
    EXPECT_NE(refusal(std::move(w)).find("arrays of different length"), std::string::npos);
    for (const uint32_t rate : {0u, 45u, 100u, 270u, 2000u}) {
        w = table_and_ball();
        w.clock.contact_rate = rate;
        EXPECT_NE(refusal(std::move(w)).find("contact_rate"), std::string::npos);
    }
    for (const double substep : {0.0, -1.0, 1e-12, std::numeric_limits<double>::quiet_NaN()}) {
        w = table_and_ball();
        w.settings.substep = substep;
        EXPECT_NE(refusal(std::move(w)).find("substep"), std::string::npos);
    }
    w = table_and_ball();
    w.trees.clear();
    EXPECT_THROW(detect_contacts(w), InputError);
}

TEST(WorldsByHand, FindFaultSeesWhatIsNowhere) {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    World w = table_and_ball();
    EXPECT_EQ(find_fault(w), "");
    w.settings.gravity.z() = kNan;
    EXPECT_NE(find_fault(w).find("gravity"), std::string::npos);
    for (const uint32_t body : {0u, 1u}) {
        w = table_and_ball();
        w.poses.origin[body].x() = kNan;
        EXPECT_NE(find_fault(w).find("place"), std::string::npos);
        w = table_and_ball();
        w.poses.velocity[body].y() = kNan;
        EXPECT_NE(find_fault(w).find("velocity"), std::string::npos);
        for (const double x : {0.0, kNan}) {
            w = table_and_ball();
            w.poses.orientation[body] = Quat{x, 0, 0, 0};
            EXPECT_NE(find_fault(w).find("orientation"), std::string::npos);
        }
    }
}

using WorldsByHandDeathTest = testing::Test;

TEST(WorldsByHandDeathTest, OrderMistakesAreNamed) {
    World w = table_and_ball();
    EXPECT_DEATH(add_body(w, "x", kNone, Motion::kStatic), "was its mesh refused");
    EXPECT_DEATH(add_body(w, "x", 2, Motion::kStatic), "was its mesh refused");
    EXPECT_DEATH(make_deformable(w, 0), "check failed");
    EXPECT_DEATH(make_deformable(w, 77), "check failed");
    w.bodies.motion[kTable] = Motion::kDeformable;
    EXPECT_DEATH(make_trees(w), "make_trees comes after make_deformable");
}

// Breaks when the bodies of a staple are not checked: memory beyond the arrays would be read.
TEST(WorldsByHandDeathTest, AStapleHoldsTwoBodiesThatAreThere) {
    World w = table_and_ball();
    const auto staple = [&](uint32_t a, uint32_t b, double stiffness) {
        add_staple({surfaces_of(w), w.solids, w.trees}, {.a = a, .b = b, .stiffness = stiffness}, w.links, w.energy);
    };
    EXPECT_DEATH(staple(kNone, kNone, 100), "check failed");
    EXPECT_DEATH(staple(77, 1, 100), "check failed");
    EXPECT_DEATH(staple(1, 77, 100), "check failed");
    EXPECT_DEATH(staple(1, 1, 100), "check failed");
    EXPECT_DEATH(staple(0, 1, 100), "check failed");  // a rigid body has no nodes
    EXPECT_DEATH(staple(1, 0, std::numeric_limits<double>::quiet_NaN()), "check failed");
    staple(1, 0, 100);
}

TEST(WorldsByHand, OnlyBodiesThatAreThereAreThere) {
    const World w = table_and_ball();
    EXPECT_TRUE(is_there(w.bodies, w.spawning, w.bodies.entity[1]));
    EXPECT_FALSE(is_there(w.bodies, w.spawning, Entity{}));
    EXPECT_FALSE(is_there(w.bodies, w.spawning, {2, 0}));
    EXPECT_FALSE(is_there(w.bodies, w.spawning, {1, 1}));
}

void run(Frame& frame, uint32_t passes) {
    for (uint32_t i = 0; i < passes; ++i) frame.step();
}

// Height of the highest vertex of a body, m.
double top_of(const World& w, uint32_t body) {
    double top = -1;
    for (uint32_t v = 0; v < w.meshes.info[w.bodies.mesh[body]].vertices.count; ++v)
        top = std::max(top, vertex_position(surfaces_of(w), body, v).z());
    return top;
}

// Returns an untouched body to its pose in `start`.
void put_back(const World& start, uint32_t body, World& w) {
    w.poses.origin[body] = start.poses.origin[body], w.poses.orientation[body] = start.poses.orientation[body];
    w.poses.velocity[body] = start.poses.velocity[body], w.poses.angular_velocity[body] = start.poses.angular_velocity[body];
    const Range rows = w.bodies.particles[body];
    for (uint32_t i = rows.first; i < rows.end(); ++i) {
        w.particles.offset[i] = start.particles.offset[i];
        w.particles.velocity_x[i] = w.particles.velocity_y[i] = w.particles.velocity_z[i] = 0;
    }
    w.particles.last_dt[body] = 0;
    w.sleep.still[body] = 0, w.sleep.group[body] = kNone;
}

// A body added to a running frame moves as if it had been there without falling yet, and its energy is
// accounted. Breaks when the stages or the initial energy are not updated.
TEST(WorldsByHand, BodiesMayComeWhileAFrameRuns) {
    constexpr uint32_t kBefore = 3;
    for (const Motion motion : {Motion::kDeformable, Motion::kFree}) {
        World start = table_and_ball(), both = table_and_ball();
        const uint32_t body = add_ball(start, motion);
        add_ball(both, motion);
        Frame late(table_and_ball(), {}), there(std::move(both), {});
        run(late, kBefore), run(there, kBefore);
        add_ball(late.world(), motion);
        put_back(start, body, there.world());
        EXPECT_EQ(find_fault(late.world()), "");
        for (uint32_t pass = 0; pass < 60; ++pass) {
            late.step(), there.step();
            ASSERT_EQ(state_hash(late.world()), state_hash(there.world())) << "pass " << pass;
        }
        const World& w = late.world();
        EXPECT_GT(w.contacts.point.size(), 0u);
        EXPECT_LT(top_of(w, body), top_of(start, body) - 1e-3);
        EXPECT_GT(w.energy.kinetic + w.energy.elastic, 0);
        EXPECT_NEAR(w.energy.balance, 0, 1e-3);
    }
}

// The same where nothing could move and no pair could collide before the addition.
TEST(WorldsByHand, TheFirstMoverMayComeWhileAFrameRuns) {
    for (const Motion motion : {Motion::kDeformable, Motion::kFree}) {
        World there = table_and_ball(false);
        add_ball(there, motion);
        Frame frame(table_and_ball(false), {});
        run(frame, 2);
        const uint32_t body = add_ball(frame.world(), motion);
        size_t contacts = 0;
        for (uint32_t pass = 0; pass < 60; ++pass) {
            frame.step();
            contacts = std::max(contacts, frame.world().contacts.point.size());
        }
        EXPECT_LT(top_of(frame.world(), body), top_of(there, body) - 1e-3);
        EXPECT_GT(contacts, 0u);
        EXPECT_NEAR(frame.world().energy.balance, 0, 1e-3);
    }
}

TEST(WorldsByHand, ARunningFrameRefusesBodiesThatAreNotComplete) {
    Frame frame(table_and_ball(), {});
    frame.step();
    World& w = frame.world();
    const uint32_t body = add_body(w, "late", kBall, Motion::kStatic);
    EXPECT_THROW(frame.step(), InputError);
    w.poses.origin[body] = Vec3d(0, 0, 1);
    make_trees(w);
    frame.step();
    make_prototype(w.meshes, make_shape("table", 200), {});
    EXPECT_THROW(frame.step(), InputError);  // the trees point into arrays that have been reallocated
    make_trees(w);
    frame.step();
    w.bodies.mesh.pop_back();
    EXPECT_THROW(frame.step(), InputError);
}

// A simulated second has as many passes as the rate says and 30 pictures, each after the same number of
// passes. Breaks when a rate is accepted whose passes never coincide with pictures, or when periods of whole
// milliseconds sum to a different time.
TEST(WorldsByHand, AnyMultipleOfThePictureRateKeepsTime) {
    for (uint32_t rate = 30; rate <= kHighestContactRate; rate += 30) {
        World world = table_and_ball();
        world.clock.contact_rate = rate;
        Frame frame(std::move(world), {});
        uint32_t pictures = 0;
        for (uint32_t pass = 1; pass <= rate; ++pass) {
            frame.step();
            if (frame.times().picture) ++pictures;
            EXPECT_EQ(frame.times().picture, pass * 30 % rate == 0) << rate << " Hz, pass " << pass;
        }
        EXPECT_EQ(pictures, 30u) << rate;
        EXPECT_EQ(frame.world().clock.tick, 1000u) << rate;
    }
}

// For any float mode of the caller, the mode is restored afterwards and the results are the same. Breaks when
// a frame leaves its own mode behind, or runs in the caller's.
TEST(WorldsByHand, AFrameGivesTheFloatModeBack) {
    constexpr unsigned kPlain = 0x1f80, kUpward = 0x5f80, kControl = 0xffc0;
    const unsigned before = _mm_getcsr();
    const auto hash_in = [before](unsigned mode, uint32_t threads) {
        _mm_setcsr(before);
        ThreadPool pool(2);
        uint64_t hash = 0;
        World w = table_and_ball();
        _mm_setcsr(mode);
        const auto work = [&] {
            Frame frame(std::move(w), {});
            run(frame, 20);
            frame.snapshot_now();
            hash = state_hash(frame.world());
        };
        threads > 1 ? pool.run(work) : work();
        EXPECT_EQ(_mm_getcsr() & kControl, mode);
        return hash;
    };
    const uint64_t expected = hash_in(before & kControl, 1);
    for (const unsigned mode : {kPlain, kUpward})
        for (const uint32_t threads : {1u, 2u}) EXPECT_EQ(hash_in(mode, threads), expected);
    _mm_setcsr(before);
}

}  // namespace
}  // namespace trocar
