// Solids that instruments cut, in whole scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numeric>
#include <random>

#include "engine/tissue/cut_solid_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "frame/written_scene.hpp"
#include "reference/paths.hpp"
namespace trocar {
namespace {

// A block of 60 mm in no gravity, and a blade as long as it is high that goes through it at x = 4 mm.
const char* const kBlock = R"(
seconds = 1.0
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "block"
shape = "box"
size = 0.06
motion = "deformable"
model = "solid"
cells = 6
[body.tissue]
youngs_modulus = 5e3
poisson = 0.45
density = 1000.0
damping = 20.0
[[body]]
name = "blade"
shape = "box"
size = 0.004
motion = "hand"
position = [0.004, 0.0, 0.1]
mass = 0.05
apart = "block"
[[tool]]
body = "blade"
stiffness = 1000.0
damping = 8.0
[[tool.action]]
kind = "cut"
when = "always"
point = [0.0, 0.0, -0.14]
edge = [0.0, 0.0, -0.06]
bodies = "block"
toughness = 50.0
[[tool.path]]
time = 0.0
position = [0.004, -0.05, 0.1]
[[tool.path]]
time = 0.2
position = [0.004, -0.04, 0.1]
[[tool.path]]
time = 0.8
position = [0.004, 0.05, 0.1]
)";

struct SolidSums {
    double mass = 0, momentum = 0, volume = 0;  // kg, kg m/s, m^3 of the surface
    std::vector<double> pieces;                 // m^3, of what hangs together by nodes, ascending
    uint32_t surfaces = 0;
};

SolidSums solid_sums(const World& w) {
    SolidSums sums;
    const uint32_t prototype = w.bodies.mesh[0];
    const SolidInfo& info = w.solids.info[prototype];
    const uint32_t first = w.bodies.particles[0].first + embedded_count(info);
    std::vector<uint32_t> parent(info.nodes.count);
    std::iota(parent.begin(), parent.end(), 0u);
    const auto root = [&](uint32_t i) {
        while (parent[i] != i) i = parent[i];
        return i;
    };
    for (uint32_t t = 0; t < info.count; ++t)
        for (size_t k = 1; k < 4; ++k)
            parent[root(w.solids.corner[k][info.tetrahedra.first + t])] = root(w.solids.corner[0][info.tetrahedra.first + t]);
    Vec3d momentum = Vec3d::Zero();
    std::map<uint32_t, double> volume;
    for (uint32_t n = 0; n < info.nodes.count; ++n) {
        const double v = w.solids.node_volume[info.nodes.first + n];
        if (v > 0) volume[root(n)] += v;
        sums.mass += w.bodies.tissue[0].density * v;
        const uint32_t p = first + n;
        if (v > 0)
            momentum +=
                w.bodies.tissue[0].density * v * Vec3d(w.particles.velocity_x[p], w.particles.velocity_y[p], w.particles.velocity_z[p]);
    }
    for (const auto& [r, v] : volume) sums.pieces.push_back(v);
    std::sort(sums.pieces.begin(), sums.pieces.end());
    sums.momentum = momentum.norm();
    sums.volume = w.meshes.info[prototype].volume;
    sums.surfaces = w.meshes.info[prototype].components;
    return sums;
}

// A blade makes two pieces of a block, with all its mass and volume, that the winding number tells from the outside; its work is in
// the accounting, which closes, and felt; and the step is no shorter than before. Breaks when a copy of a node has no mass, or when a part
// has the whole stiffness of its tetrahedron.
TEST(SolidCuts, ABladeMakesTwoOfABlock) {
    const WrittenScene scene("solid_cut", kBlock);
    World world = std::move(scene.build().world);
    const SolidSums before = solid_sums(world);
    ASSERT_EQ(before.pieces.size(), 1u);
    const double step = world.bodies.stable_dt[0];
    const uint32_t particles = world.bodies.particles[0].count;
    double entered = 0, drift = 0, felt = 0;
    run(std::move(world), 60, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        entered = std::max(entered, w.energy.work_hand);
        drift = std::max(drift, std::abs(w.energy.balance));
        felt = std::max(felt, w.haptics.state[0].output.force.norm());
        if (pass % 10 == 9) {
            EXPECT_EQ(find_fault(w), "") << pass;
        }
        const SolidSums now = solid_sums(w);
        EXPECT_NEAR(now.mass, before.mass, 1e-12 * before.mass);
        EXPECT_NEAR(now.volume, before.volume, 1e-12 * before.volume);
        if (pass < 59) return;
        const ActionProgress& p = w.action_state.progress[0];
        EXPECT_EQ(p.done, 1u);
        EXPECT_EQ(p.refused, 0u);
        EXPECT_DOUBLE_EQ(p.work, 50 * p.area);
        EXPECT_NEAR(-w.energy.work_cuts, p.work - p.owed, 1e-12);
        ASSERT_EQ(now.pieces.size(), 2u);
        EXPECT_EQ(now.surfaces, 2u);
        EXPECT_EQ(w.meshes.info[w.bodies.mesh[0]].admission, Admission::kWinding);
        // the plane x = 4 mm to a fifth of an edge
        EXPECT_NEAR(now.pieces[0] / before.volume, 0.026 / 0.06, 0.02);
        EXPECT_NEAR(p.area, 0.06 * 0.06, 0.1 * 0.06 * 0.06);
        EXPECT_EQ(w.bodies.stable_dt[0], step);
        EXPECT_EQ(w.bodies.particles[0].count, particles);
        std::printf("parts %.4f and %.4f of %.4g ml, area %.4g of %.4g mm^2, felt %.2f N, drift %.2g of %.2g J, step %.3g s\n",
                    now.pieces[0] / before.volume, now.pieces[1] / before.volume, 1e6 * before.volume, 1e6 * p.area, 3600.0, felt, drift,
                    entered, step);
    });
    EXPECT_GT(felt, 0.1);
    EXPECT_LT(drift, 1e-3 * entered);
}

// A block on a fixed base, and a hand that goes to and fro in it with the blade at any angle: dozens of strokes through tissue that moves,
// and that was cut before.
struct RandomStrokes {
    uint64_t refused = 0, inverted = 0, cuts = 0;
    size_t pieces = 0;
    double mass = 0, volume = 0, drift = 0;  // largest relative errors
};

RandomStrokes stroke_at_random(uint64_t seed, int passes) {
    std::mt19937_64 random(seed);
    const auto unit = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
    std::string text = kBlock;
    text.erase(text.find("[[tool.path]]"));
    text.replace(text.find("cells = 6"), 9, "cells = 4\nfixed_below = -0.025\ncut_capacity = 20000");
    for (int key = 0; key * 6 <= passes; ++key) {
        char line[300];
        std::snprintf(line, sizeof line, "[[tool.path]]\ntime = %.2f\nposition = [%.4f, %.4f, %.4f]\nrotation = [%.3f, %.3f, 1.0, %.1f]\n",
                      0.1 * key, 0.12 * (unit() - 0.5), 0.12 * (unit() - 0.5), 0.08 + 0.03 * unit(), unit() - 0.5, unit() - 0.5,
                      60 * (unit() - 0.5));
        text += line;
    }
    RandomStrokes result;
    const WrittenScene scene("solid_strokes", text);
    World world = std::move(scene.build().world);
    const SolidSums before = solid_sums(world);
    run(std::move(world), passes, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const SolidSums now = solid_sums(w);
        result.mass = std::max(result.mass, std::abs(now.mass / before.mass - 1));
        result.volume = std::max(result.volume, std::abs(now.volume / before.volume - 1));
        result.drift = std::max(result.drift, std::abs(w.energy.balance) / std::max(w.energy.work_hand, 1e-6));
        if (pass % 15 == 14) {
            EXPECT_EQ(find_fault(w), "") << pass;
        }
        if (pass + 1 < passes) return;
        const ActionProgress& p = w.action_state.progress[0];
        result.refused = p.refused, result.cuts = w.action_state.lattice.count[0][1] - w.actions.cut_solid[0].tetrahedra.count;
        result.inverted = w.report.inverted_tetrahedra + w.report.nonfinite_particles + w.report.short_steps + w.report.runaway_bodies;
        result.pieces = now.pieces.size();
    });
    return result;
}

void check_random_strokes(uint64_t first, uint64_t count, int passes) {
    uint64_t cuts = 0;
    for (uint64_t seed = first; seed < first + count; ++seed) {
        const RandomStrokes r = stroke_at_random(seed, passes);
        EXPECT_EQ(r.refused, 0u) << seed;
        EXPECT_EQ(r.inverted, 0u) << seed;
        EXPECT_LT(r.mass, 1e-12) << seed;
        EXPECT_LT(r.volume, 1e-12) << seed;
        EXPECT_LT(r.drift, 1e-3) << seed;
        cuts += r.cuts;
        std::printf("seed %u: %u parts more, %zu pieces, mass %.1g, volume %.1g, drift %.1g\n", static_cast<unsigned>(seed),
                    static_cast<unsigned>(r.cuts), r.pieces, r.mass, r.volume, r.drift);
    }
    EXPECT_GT(cuts, 50 * count);
}

TEST(SolidCuts, RandomStrokesInAMovingBlock) { check_random_strokes(1, 2, 90); }
TEST(SolidCuts, LongRandomStrokesInAMovingBlock) { check_random_strokes(100, 20, 180); }

// What instruments may cut has at least half the step of what they may not.
TEST(SolidCuts, TheStepIsAtLeastHalfThatOfTheUncut) {
    std::string plain = kBlock;
    const size_t action = plain.find("[[tool.action]]");
    plain.erase(action, plain.find("[[tool.path]]") - action);
    const WrittenScene cut("solid_step", kBlock), whole("solid_whole", plain);
    const double step = cut.build().world.bodies.stable_dt[0], most = whole.build().world.bodies.stable_dt[0];
    std::printf("step %.3g of %.3g s\n", step, most);
    EXPECT_GE(step, 0.5 * most);
    EXPECT_LE(step, most);
}

// The bits do not depend on threads or scratch, and everything follows from the state: set back into a world as at load it is the same.
TEST(SolidCuts, TheStateHoldsThePieces) {
    const WrittenScene scene("solid_state", kBlock);
    const auto look = [&](const World& w) {
        ASSERT_GT(w.action_state.progress[0].area, 0);
        World again = std::move(scene.build().world);
        again.action_state = w.action_state, again.particles = w.particles, again.poses = w.poses;
        restore_cut_solids(again.actions, again.action_state.lattice, again.bodies, again.particles,
                           {again.meshes, again.springs, again.solids, again.anchors}, again.trees);
        for (const Resource r : {Resource::kMeshes, Resource::kSprings, Resource::kSolids, Resource::kAnchors})
            EXPECT_EQ(resource_hash(again, r), resource_hash(w, r)) << resource_name(r);
    };
    const uint64_t hash = hash_of(scene, 32, 1, false, [&](Frame& frame) { look(frame.world()); });
    EXPECT_EQ(hash_of(scene, 32, 3, false, [](Frame&) {}), hash);
    EXPECT_EQ(hash_of(scene, 32, 1, true, [](Frame&) {}), hash);
}

// A cut beyond the room is not made, and counted.
TEST(SolidCuts, BeyondItsRoomNothingIsCut) {
    const WrittenScene scene("solid_room", kBlock);
    run(std::move(scene.build({{"block.cut_capacity", "30"}}).world), 50, [&](Frame& frame, int pass) {
        if (pass < 49) return;
        EXPECT_GT(frame.world().action_state.progress[0].refused, 0u);
        EXPECT_EQ(solid_sums(frame.world()).pieces.size(), 1u);
        EXPECT_EQ(find_fault(frame.world()), "");
    });
}

TEST(SolidCuts, WhatCannotBeCutIsRefused) {
    const WrittenScene scene("solid_refused", kBlock);
    for (const auto& [key, value] : {std::pair{"block.break_strain", "0.5"}, {"block.skin", "true"}})
        EXPECT_NE(scene.error({{key, value}}).find("instruments cannot cut it"), std::string::npos)
            << key << ": " << scene.error({{key, value}});
}

}  // namespace
}  // namespace trocar
