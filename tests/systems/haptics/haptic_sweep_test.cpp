#include <gtest/gtest.h>

#include <cmath>

#include "systems/haptics/tick.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/local_patches.hpp"
#include "tests/reference/sample_meshes.hpp"

// The sweep of the proxy, the only continuous collision test of haptics: double roots, no motion at all,
// motion along the surface. It may stop slightly early, never late.
namespace trocar {
namespace {

constexpr double kTick = 1e-3, kRadius = 3e-3;  // s, m
constexpr double kSkin = 2e-9;                  // m, twice what the sweep may go deeper than the planes

struct Sweep {
    HapticParams params;
    LocalContactModel model;
    HandTool tool;
    HapticScratch scratch;
    ToolState state;
    Vec3d drift = Vec3d::Zero();  // m/s, of the surface
    uint64_t tick = 0;
    double least_clearance = 1;

    explicit Sweep(const Mesh& surface) : model(reference::make_patch(surface)) {
        tool.tip_radius = kRadius;
        tool.coupling_damping = 0;
        tool.friction = 0;
        tool.max_force = 1e9;
        params.model_timeout = params.device_timeout = 1e9;
        params.force_slew = 1e12;
    }
    double time() const { return static_cast<double>(tick) * kTick; }
    // a new model of a surface that drifts, every 17 ticks
    Vec3d at(const Vec3d& position) {
        if (tick % 17 == 0) {
            for (Vec3d& p : model.position) p += (time() - model.time) * drift;
            model.time = time();
            model.velocity.assign(model.position.size(), drift);
            group_triangles(model);
        }
        DeviceState sample;
        sample.time = time();
        sample.position = position;
        haptic_tick(params, model, time(), tool, sample, scratch, state);
        std::vector<Vec3d> now = model.position;
        for (size_t v = 0; v < now.size(); ++v) now[v] += (time() - model.time) * drift;
        least_clearance = std::min(least_clearance, brute_force_distance(now, model.triangle, state.proxy).distance - kRadius);
        ++tick;
        return state.command.force;
    }
};

// Past an edge and past a corner of a box at half a metre per second, so near that the distance has a double
// root: a contact is felt by no more than the missing clearance, and the proxy never sticks.
TEST(HapticSweep, P20_TangentialGraze) {
    const Mesh box = reference::make_box(Vec3d(-0.02, -0.02, -0.02), Vec3d::Zero());
    struct Case {
        Vec3d feature, along, away;
    };
    const Case cases[] = {{{0, -0.007, 0}, Vec3d(1, 0, -1).normalized(), Vec3d(1, 0, 1).normalized()},
                          {{0, -0.007, 0}, Vec3d(1, 0.3, -1).normalized(), Vec3d(1, 0, 1).normalized()},
                          {{0, 0, 0}, Vec3d(1, -1, 0).normalized(), Vec3d(1, 1, 1).normalized()},
                          {{-0.01, -0.01, 0}, Vec3d(1, 0.2, 0).normalized(), Vec3d(0, 0, 1)}};
    for (const Case& c : cases) {
        for (const double gap : {-1e-4, -1e-6, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-6}) {
            Sweep sweep(box);
            const Vec3d middle = c.feature + (kRadius + gap) * c.away;
            sweep.at(middle + 0.02 * c.away - 0.02 * c.along);
            double largest = 0;
            for (int k = -40; k <= 40; ++k) {
                const Vec3d displacement = (k + 0.37) * 0.5e-3 * c.along;
                largest = std::max(largest, sweep.at(middle + displacement + (k < -39 ? 0.01 : 0.0) * c.away).norm());
            }
            // back to where the box is far away
            sweep.at(middle + 0.02 * c.away + 0.02 * c.along);
            const Vec3d rest = sweep.at(middle + 0.02 * c.away + 0.02 * c.along);
            EXPECT_GE(sweep.least_clearance, -kSkin) << gap;
            EXPECT_LE(largest, sweep.tool.coupling_stiffness * (std::max(0.0, -gap) * 1.5 + 2 * kSkin)) << gap;
            if (gap >= 1e-6) {
                EXPECT_EQ(largest, 0) << gap;
            }
            if (gap <= -1e-4) {
                EXPECT_GT(largest, 0) << gap;
            }
            EXPECT_EQ(rest, Vec3d::Zero()) << gap;
        }
    }
}

// No relative motion for a while - at rest in contact, and carried along with a moving surface - then motion
// in the surface's own plane over its inner edges, then a press: the press is felt in full.
TEST(HapticSweep, P21_NoMotionAndCoplanarMotion) {
    for (const Vec3d& drift : {Vec3d(0, 0, 0), Vec3d(0.02, 0.01, 0), Vec3d(0.01, 0, 0.03)}) {
        for (const double gap : {-1e-4, -1e-9, 0.0, 1e-9}) {
            Sweep sweep(reference::make_plane());
            sweep.drift = drift;
            const auto at = [&](double x, double z) { return sweep.at(Vec3d(x, 0, kRadius + z) + sweep.time() * drift); };
            at(-0.0215, 0.01);
            for (int k = 0; k < 100; ++k) at(-0.0215, gap);
            for (int k = 0; k < 200; ++k) at(-0.0215 + 2e-4 * k, gap);
            for (int k = 0; k < 100; ++k) at(0.0185, gap);
            EXPECT_GE(sweep.least_clearance, -kSkin) << gap << " " << drift.transpose();
            Vec3d force;
            for (int k = 1; k <= 20; ++k) force = at(0.0185, gap - 1e-4 * k);
            EXPECT_GE(sweep.least_clearance, -kSkin) << gap << " " << drift.transpose();
            EXPECT_NEAR(force.z(), sweep.tool.coupling_stiffness * (2e-3 - gap), 2e-6);
        }
    }
}

}  // namespace
}  // namespace trocar
