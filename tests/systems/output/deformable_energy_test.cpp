#include "systems/output/deformable_energy.hpp"

#include <gtest/gtest.h>

#include "tests/reference/measures.hpp"
#include "tests/systems/advance/advance_scene.hpp"
namespace trocar {
namespace {

// Terms against the plain double version, before any step. Breaks on a spring counted twice, a missing goal
// or a sign of gravity.
TEST(DeformableEnergy, AgreesWithDouble) {
    for (const AnchorFrame frame : {AnchorFrame::kWorld, AnchorFrame::kShape}) {
        AdvanceScene s;
        const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 2, 0.05)), Motion::kDeformable, Vec3d(0, 0, 2), {}, frame,
                                         from_rotation_vector({0.2, 0.1, -0.7}));
        double kinetic = 0;
        for (uint32_t v = 0; v < 162; ++v) {
            Float4& o = s.particles.offset[v];
            o.x *= 1.2f, o.y += 0.3f * o.z;
            s.set_velocity(body, v, {0.1, 0.01 * v, 0});
            kinetic += 0.5 * s.velocity(body, v).squaredNorm() / o.w;
        }
        reference::DoubleBody b = double_copy(s, body);
        for (Vec3d& x : b.position) x += s.poses.origin[body];
        for (Vec3d& g : b.goal) g += s.poses.origin[body];
        Energy energy;
        energy.work_hand = 1, energy.work_contact = 2, energy.work_damping = 3, energy.work_push = 4, energy.work_numeric = 6;
        EnergyStart start{true, 5};
        measure_energy({s.springs, s.bodies, s.poses, s.particles, s.anchors, s.params.gravity}, start, s.energy_scratch, energy);
        const double total = reference::potential_energy(b);
        b.gravity.setZero();
        const double elastic = reference::potential_energy(b);
        EXPECT_NEAR(energy.elastic, elastic, 1e-6 * elastic);
        EXPECT_NEAR(energy.gravity, total - elastic, 1e-9);
        EXPECT_NEAR(energy.kinetic, kinetic, 1e-9 * kinetic);
        EXPECT_NEAR(energy.balance, energy.elastic + energy.gravity + energy.kinetic - 21, 1e-12);
    }
}

// For an oscillator of omega the leapfrog keeps k x_n x_(n-1) / 2 + m v^2 / 2, so the energy half a step back
// oscillates by (omega dt)^2 / 4 only; at the offsets' time, or with full kicks first, by omega dt.
TEST(DeformableEnergy, IsTakenHalfAStepBack) {
    AdvanceScene s;
    s.params.gravity.setZero();
    Tissue tissue;
    tissue.damping = 0;
    s.add_body(s.add_mesh(subdivided_sphere(0.05, 2)), Motion::kDeformable, Vec3d::Zero(), tissue);
    for (uint32_t v = 0; v < 162; ++v) s.particles.offset[v].x += 0.002f;
    s.open_energy_account();
    const double start = s.energy.elastic;
    double worst = 0;
    for (int n = 0; n < 100; ++n) {
        s.advance(1, 1);
        s.measure();
        worst = std::max(worst, std::abs(s.energy.kinetic + s.energy.elastic - start));
    }
    const float w = s.particles.offset[0].w, k = s.anchors.stiffness[0];
    EXPECT_NEAR(worst, 0.25 * k * w * 1e-6 * start, 0.03 * 0.25 * k * w * 1e-6 * start);
}

TEST(DeformableEnergy, MomentumOfASpinningBody) {
    AdvanceScene s;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 2)), Motion::kDeformable, Vec3d(1, 0, 0), {}, AnchorFrame::kShape);
    for (uint32_t v = 0; v < 162; ++v) s.set_velocity(body, v, Vec3d(0, 2, 0) + Vec3d(0, 0, 3).cross(s.offset(body, v)));
    const Momentum p = measure_momentum(s.bodies, s.poses, s.particles, body);
    const double mass = 1050 * s.meshes.info[0].volume;
    EXPECT_NEAR(p.linear.y(), 2 * mass, 1e-5 * mass);
    double inertia = 0;
    for (uint32_t v = 0; v < 162; ++v) {
        const Vec3d x = s.offset(body, v);
        inertia += (x.x() * x.x() + x.y() * x.y()) / s.particles.offset[v].w;
    }
    EXPECT_NEAR(p.angular.z(), 2 * mass + 3 * inertia, 1e-4 * mass);
}

}  // namespace
}  // namespace trocar
