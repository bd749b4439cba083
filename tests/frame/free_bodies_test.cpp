#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "engine/mass_properties.hpp"
#include "engine/thread_pool.hpp"
#include "systems/deformable_energy.hpp"
#include "systems/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"

// Free rigid bodies in whole frames, against closed forms and conservation laws.
namespace {
using namespace trocar;

constexpr double kGravity = 9.81;

BodySpec body(const std::string& name, const std::string& shape, Motion motion, double size, const Vec3d& position,
              uint32_t triangles = 12) {
    BodySpec spec;
    spec.name = name;
    spec.shape = shape;
    spec.motion = motion;
    spec.size = size;
    spec.position = position;
    spec.triangles = triangles;
    spec.tissue.friction = 0;
    spec.tissue.damping = 0;
    spec.tissue.density = 1000;
    return spec;
}

void run(const SceneFile& scene, double seconds, const std::function<void(const Frame&)>& each,
         const std::function<void(const Frame&)>& last = {}) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene).world), {});
        const int passes = static_cast<int>(std::lround(seconds * 60));
        for (int pass = 0; pass < passes; ++pass) {
            frame.step();
            if (each) each(frame);
        }
        if (last) last(frame);
    });
}

double seconds_of(const Frame& f) { return static_cast<double>(f.world().clock.tick) * 1e-3; }
Vec3d centre_of(const World& w, uint32_t b) {
    return w.poses.origin[b] + rotate(w.poses.orientation[b], find_rigid_mass(w.bodies, b)->centre);
}
Vec3d velocity_of(const World& w, uint32_t b) {
    return w.poses.velocity[b] + w.poses.angular_velocity[b].cross(centre_of(w, b) - w.poses.origin[b]);
}

// The leapfrog's places are exact under a constant force, however the body turns. Breaks when the first kick is a
// whole one or the centre of mass is not what falls.
TEST(FreeBodies, FallOnTheExactParabola) {
    SceneFile scene;
    scene.bodies = {body("probe", "probe", Motion::kFree, 0.2, {0, 0, 1}, 500)};
    scene.bodies[0].velocity = {1, -2, 3};
    scene.bodies[0].spin = {0, 5, 1};
    const World start = std::move(build_scene(scene).world);
    const Vec3d from = centre_of(start, 0), speed = velocity_of(start, 0);
    ASSERT_GT((from - start.poses.origin[0]).norm(), 0.05) << "the probe's origin is its tip";
    run(scene, 2, [&](const Frame& f) {
        const double t = seconds_of(f);
        const Vec3d exact = from + t * speed - 0.5 * t * t * Vec3d(0, 0, kGravity);
        EXPECT_LT((centre_of(f.world(), 0) - exact).norm(), 1e-12 * (1 + exact.norm()));
    });
}

struct Totals {
    Vec3d linear = Vec3d::Zero(), angular = Vec3d::Zero();
};
Totals totals_of(const World& w) {
    Totals sum;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const Momentum m = measure_momentum(w.bodies, w.poses, w.particles, b);
        sum.linear += m.linear, sum.angular += m.angular;
    }
    return sum;
}

// Spinning boxes that hit each other with friction, off centre and edge first: linear and angular momentum stay, energy
// goes only as the books say, and none appears.
TEST(FreeBodies, CollisionsKeepMomentumAndTheBooks) {
    SceneFile scene;
    scene.settings.gravity.setZero();
    scene.settings.contact.push_speed = 0;  // a push-out moves bodies apart and leaves their momenta where they were
    scene.bodies = {body("a", "box", Motion::kFree, 0.06, {-0.06, 0, 0}), body("b", "box", Motion::kFree, 0.04, {0.03, 0.02, 0.01}),
                    body("c", "sphere", Motion::kFree, 0.05, {0.02, -0.05, 0.02}, 320)};
    for (BodySpec& b : scene.bodies) b.tissue.friction = 0.4;
    scene.bodies[0].velocity = {0.5, 0, 0};
    scene.bodies[0].spin = {1, 7, -4};
    scene.bodies[1].spin = {-3, 2, 8};
    scene.bodies[2].velocity = {0, 0.3, 0};
    const World start = std::move(build_scene(scene).world);
    const Totals before = totals_of(start);
    double energy = 1e9, contact = 0, first_energy = -1;
    run(
        scene, 2,
        [&](const Frame& f) {
            const World& w = f.world();
            const Totals now = totals_of(w);
            EXPECT_LT((now.linear - before.linear).norm(), 1e-12 * before.linear.norm());
            EXPECT_LT((now.angular - before.angular).norm(), 1e-9 * before.linear.norm() * 0.06) << seconds_of(f);
            if (!f.times().picture) return;
            if (first_energy < 0) first_energy = w.energy.kinetic;
            EXPECT_LE(w.energy.kinetic, energy * (1 + 1e-4));
            EXPECT_LT(std::abs(w.energy.balance), 1e-3 * first_energy);
            energy = w.energy.kinetic;
            contact = w.energy.work_contact;
        },
        [](const Frame& f) { EXPECT_GT(f.world().report.contact_events, 2u); });
    EXPECT_LT(contact, -0.05 * first_energy);
}

}  // namespace
