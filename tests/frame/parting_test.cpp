#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "content/scene/build_scene.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/frame/frame.hpp"

// Soft bodies that start inside each other are parted as they are: nothing enters, so nothing may move faster than they are
// pushed, whatever is strained. Oracles: the energy of motion of the whole mass at that speed; the middle of the masses, which
// rests; the way out over the speed.
namespace {
using namespace trocar;

enum class Kind { kSolid, kShell, kStone, kFixedStone, kSheet, kHeldShell, kHeldSolid };

BodySpec thing(const std::string& name, Kind kind, const Vec3d& position) {
    BodySpec body;
    body.name = name;
    body.shape = kind == Kind::kSheet ? "sheet" : "sphere";
    body.triangles = kind == Kind::kSheet ? 128 : 320;
    body.size = 0.08;
    body.position = position;
    body.motion = kind == Kind::kStone ? Motion::kFree : kind == Kind::kFixedStone ? Motion::kStatic : Motion::kDeformable;
    body.tissue.youngs_modulus = 5e3;
    body.tissue.damping = 0;
    if (kind == Kind::kSolid || kind == Kind::kHeldSolid) body.solid = true, body.cells = 5;
    if (kind == Kind::kHeldSolid) body.fixed_below = -0.02;
    if (kind != Kind::kSolid && kind != Kind::kHeldShell && kind != Kind::kHeldSolid) body.anchor_frame = AnchorFrame::kShape;
    return body;
}

struct Parted {
    double moving = 0, strained = 0;  // J, the most
    double pushed = 0, late = 0;      // J, work of correction, and of it in the second half
    double depth = 0;                 // m, at the end
    double seconds = 0;               // until the last pass with an overlap
    double mass = 0;                  // kg
    Vec3d shift = Vec3d::Zero();      // m, of the middle of the masses
    uint64_t hash = 0;
};

Vec3d middle(const World& w, double& mass) {
    Vec3d moment = Vec3d::Zero();
    mass = 0;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b)
        for (uint32_t p = w.bodies.particles[b].first; p < w.bodies.particles[b].end(); ++p) {
            const Float4& o = w.particles.offset[p];
            if (!(o.w > 0)) continue;
            mass += 1 / double{o.w};
            moment += (w.poses.origin[b] + Vec3d(o.x, o.y, o.z)) / double{o.w};
        }
    for (const RigidMass& free : w.bodies.rigid_mass) mass += free.mass, moment += free.mass * w.poses.origin[free.body];
    return moment / mass;
}

Parted part(const std::vector<BodySpec>& bodies, double seconds, uint32_t threads = 1, double gravity = 0) {
    SceneFile scene;
    scene.settings.gravity = Vec3d(0, 0, -gravity);
    scene.bodies = bodies;
    Parted result;
    ThreadPool pool(threads);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
        const World& w = frame.world();
        const Vec3d before = middle(w, result.mass);
        double half = 0;  // J
        while (double(w.clock.tick) < 1e3 * seconds) {
            frame.step();
            result.moving = std::max(result.moving, w.energy.kinetic);
            result.strained = std::max(result.strained, w.energy.elastic + w.energy.pressure + w.energy.bending);
            if (double(w.clock.tick) > 500 * seconds && half == 0) half = w.energy.work_push;
            result.pushed = w.energy.work_push, result.late = w.energy.work_push - half;
            result.depth = 0;
            for (const double depth : w.penetrations.depth) result.depth = std::max(result.depth, depth);
            if (result.depth > w.settings.contact.tolerance) result.seconds = double(w.clock.tick) * 1e-3;
        }
        double mass = 0;
        result.shift = middle(w, mass) - before;
        result.hash = state_hash(w);
    });
    return result;
}

constexpr double kPush = 0.1, kSize = 0.08;  // m/s, the default of push_speed; m

void expect_parted(const Parted& p, double far, const std::string& what) {
    EXPECT_LT(p.moving, 0.01 * 0.5 * p.mass * kPush * kPush) << what;
    EXPECT_LT(p.strained, 0.01 * 0.5 * p.mass * kPush * kPush) << what;
    EXPECT_LE(p.depth, 1e-4) << what;
    EXPECT_LE(p.seconds, far / kPush + 0.1) << what;
}

TEST(SoftStartsInside, TwoLeaveWithoutEnergy) {
    for (const Kind kind : {Kind::kSolid, Kind::kShell})
        for (const double apart : {0.04, 0.02, 0.008}) {
            const std::string what = std::to_string(int(kind)) + ' ' + std::to_string(apart);
            const Parted p = part({thing("a", kind, Vec3d::Zero()), thing("b", kind, Vec3d(apart, 0.003, 0.002))}, 1.0);
            expect_parted(p, kSize - apart, what);
            EXPECT_LT(p.shift.norm(), 1e-6) << what;
        }
}

// A heap of three, a shell in a solid, a sheet through the middle of a ball, a soft ball in a rigid one that is free or stands.
TEST(SoftStartsInside, WhateverIsInsideWhatever) {
    const Vec3d at(0.03, 0.004, 0.002);
    const auto pair = [&](Kind a, Kind b) { return std::vector{thing("a", a, Vec3d::Zero()), thing("b", b, at)}; };
    for (const auto& [a, b] : {std::pair(Kind::kSolid, Kind::kShell),
                               {Kind::kStone, Kind::kSolid},
                               {Kind::kFixedStone, Kind::kShell},
                               {Kind::kSolid, Kind::kHeldShell}}) {
        const Parted p = part(pair(a, b), 1.2);
        expect_parted(p, kSize - at.x(), std::to_string(int(a)) + std::to_string(int(b)));
    }
    expect_parted(part({thing("ball", Kind::kSolid, Vec3d::Zero()), thing("sheet", Kind::kSheet, Vec3d(0.002, 0.001, 0.01))}, 1.2), kSize,
                  "sheet");
    std::vector<BodySpec> three = pair(Kind::kSolid, Kind::kSolid);
    three.push_back(thing("c", Kind::kShell, Vec3d(0.018, 0.036, 0.001)));
    const Parted heap = part(three, 2.0);
    expect_parted(heap, 3 * kSize, "three");
    EXPECT_LT(heap.shift.norm(), 1e-6);
    EXPECT_EQ(part(three, 0.3, 4).hash, part(three, 0.3, 1).hash);
}

// What stands on a plate stays there, also between a plate and a held ball, and the other ball goes. Breaks when bodies are moved into
// others that they only touch: the plate then strains them.
TEST(SoftStartsInside, WhatStandsIsNotPushedIntoItsPlate) {
    BodySpec plate = thing("plate", Kind::kFixedStone, Vec3d(0, 0, -0.1));
    plate.shape = "box", plate.size = 0.2;
    for (const Kind kind : {Kind::kSolid, Kind::kShell, Kind::kHeldShell}) {
        const Parted p = part({plate, thing("a", Kind::kShell, Vec3d(0, 0, 0.0401)), thing("b", kind, Vec3d(0, 0.001, 0.105))}, 1.0);
        std::printf("kind %d: pushed %.3g J, strained %.3g J, depth %.3g mm\n", int(kind), p.pushed, p.strained, 1e3 * p.depth);
        EXPECT_LT(p.pushed, 1e-6) << int(kind);
        EXPECT_LT(p.strained, 1e-6) << int(kind);
        EXPECT_TRUE(kind == Kind::kHeldShell || p.depth < 1e-4) << int(kind);
    }
}

// What holds both to the world keeps them from being moved: they are pressed flat, or, if that takes more than half a body or goes
// nowhere, left as they are. Oracle: two balls as large as they, strained all over by the overlap over their diameter: what takes
// more, or goes on and on, pumps.
TEST(SoftStartsInside, WhatIsHeldIsNotPumped) {
    for (const Kind kind : {Kind::kHeldShell, Kind::kHeldSolid})
        for (const double apart : {0.06, 0.05, 0.044, 0.036, 0.02, 0.008}) {
            const std::string what = std::to_string(int(kind)) + ' ' + std::to_string(apart);
            const Parted p = part({thing("a", kind, Vec3d::Zero()), thing("b", kind, Vec3d(apart, 0.003, 0.002))}, 1.0);
            const double strain = (kSize - apart) / kSize, volume = 4.0 / 3 * M_PI * std::pow(kSize / 2, 3);
            const double most = 2 * 0.5 * 5e3 * strain * strain * volume;
            EXPECT_LT(p.pushed, (apart < kSize / 2 ? 0.01 : 1.0) * most) << what;  // what is left gets a pass of corrections
            EXPECT_LT(p.late, 0.1 * most) << what;
        }
}

}  // namespace
