#include "systems/detect/narrow/penetration.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

Mesh ball(double radius, uint32_t n = 14) {
    return make_sphere(n, [=](const Vec3d& p) { return Vec3d(radius * p); });
}

// P01: two spheres whose poles touch exactly: depth 0, all numbers finite.
TEST(Penetration, P01_SpheresExactlyTouching) {
    ContactScene scene({{ball(0.5, 8), Motion::kDeformable, Vec3d::Zero(), {}}, {ball(0.5, 8), Motion::kHand, Vec3d(1, 0, 0), {}}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    EXPECT_EQ(scene.penetrations.depth[0], 0.0);
    EXPECT_EQ(scene.penetrations.vertices_a_in_b[0], 0u);
    EXPECT_NEAR(scene.penetrations.direction[0].norm(), 1, 1e-9);
    EXPECT_GT(scene.penetrations.direction[0].x(), 0.5);
}

// P04: one body on top of its copy: they overlap, the shortest distances are all zero.
TEST(Penetration, P04_CoincidentBodies) {
    ContactScene scene({{ball(0.5, 8), Motion::kDeformable, Vec3d::Zero(), {}}, {ball(0.5, 8), Motion::kDeformable, Vec3d::Zero(), {}}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    EXPECT_EQ(scene.penetrations.depth[0], 0.0);
    EXPECT_EQ(scene.contacts.pair.size(), 2 * scene.meshes.info[0].vertices.count);
    for (const Vec3d& n : scene.contacts.normal) EXPECT_NEAR(n.norm(), 1, 1e-9);
}

// P05: concentric spheres: the thesis depth is the difference of their radii, to the sagitta of the larger.
TEST(Penetration, P05_ConcentricSpheres) {
    ContactScene scene(
        {{ball(0.5, 20), Motion::kDeformable, Vec3d::Zero(), {}}, {ball(0.3, 6), Motion::kHand, Vec3d::Zero(), turn({1, 2, 3}, 1)}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    const double sagitta = std::pow(scene.meshes.info[0].max_edge, 2) / (6 * 0.5);
    EXPECT_LE(scene.penetrations.depth[0], 0.2 + 1e-7);
    EXPECT_GE(scene.penetrations.depth[0], 0.2 - 1.5 * sagitta);
    EXPECT_EQ(scene.penetrations.vertices_b_in_a[0], scene.meshes.info[1].vertices.count);
    EXPECT_EQ(scene.penetrations.vertices_a_in_b[0], 0u);
}

// P06, P18: equal spheres pushed together, in steps much smaller than an edge: the depth follows the closed form to the
// sagittas, falls again past the centre, and never jumps by more than the step.
TEST(Penetration, P06_P18_SpheresPassingThrough) {
    ContactScene scene(
        {{ball(0.5, 12), Motion::kDeformable, Vec3d::Zero(), {}}, {ball(0.5, 12), Motion::kHand, Vec3d(1.1, 0, 0), turn({1, 2, 3}, 1)}});
    const double sagitta = std::pow(scene.meshes.info[0].max_edge, 2) / (6 * 0.5) * 1.5;
    const double step = 0.004;
    double before = 0;
    for (double d = 1.02; d > 0.02; d -= step) {
        scene.poses.origin[1] = Vec3d(d, 0, 0);
        scene.run();
        const double depth = scene.penetrations.depth.empty() ? 0 : scene.penetrations.depth[0];
        const double want = std::max(0.0, std::min(1 - d, d));
        EXPECT_LE(depth, want + 2 * sagitta) << d;
        EXPECT_GE(depth, want - 2 * sagitta - 0.32 * scene.meshes.info[0].max_edge * (std::abs(d - 0.5) < 0.15)) << d;
        EXPECT_LE(std::abs(depth - before), step + scene.settings.contact.tolerance) << d;
        before = depth;
    }
}

// P12: a small box pressed 0.1 into a slab of two huge triangles: exactly 0.1.
TEST(Penetration, P12_SmallBoxOnAHugeSlab) {
    ContactScene scene({{make_box({100, 100, 10}), Motion::kStatic, Vec3d(0, 0, -5), {}},
                        {make_box({1, 1, 1}), Motion::kHand, Vec3d(7.3, -11.1, 0.4), {}}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    EXPECT_NEAR(scene.penetrations.depth[0], 0.1, 1e-13);
    EXPECT_EQ(scene.penetrations.vertices_b_in_a[0], 4u);
    EXPECT_NEAR(scene.penetrations.direction[0].z(), 1, 1e-12);
}

// P14: a sphere that plugs a torus: depth r + s - R = 0.01 on smooth shapes.
TEST(Penetration, P14_SpherePluggingATorus) {
    ContactScene scene({{make_torus(1, 0.3, 120, 60), Motion::kDeformable, Vec3d::Zero(), {}},
                        {ball(0.71, 40), Motion::kHand, Vec3d::Zero(), turn({0, 0, 1}, 0.3)}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    const double sagitta = std::pow(scene.meshes.info[1].max_edge, 2) / (6 * 0.71) + std::pow(2 * M_PI * 0.3 / 60, 2) / (8 * 0.3);
    EXPECT_NEAR(scene.penetrations.depth[0], 0.01, 2 * sagitta);
    EXPECT_LT(sagitta, 0.0025);
}

// P24: the bodies swapped: same depth, opposite direction. Breaks on a wrong sign or side.
TEST(Penetration, P24_SwappedBodiesOppositeDirection) {
    const BodyInput x{make_noisy_sphere(12, 0.1, 0.1, 0), Motion::kDeformable, Vec3d::Zero(), {}};
    const BodyInput y{make_noisy_sphere(9, 0.07, 0.1, 1), Motion::kHand, Vec3d(0.12, 0.03, 0.01), turn({1, 2, 0}, 1)};
    ContactScene one({x, y}), two({y, x});
    one.run();
    two.run();
    ASSERT_EQ(one.penetrations.pair.size(), 1u);
    EXPECT_EQ(one.penetrations.depth, two.penetrations.depth);
    EXPECT_EQ(one.penetrations.direction[0], Vec3d(-two.penetrations.direction[0]));
    EXPECT_EQ(one.penetrations.vertices_a_in_b, two.penetrations.vertices_b_in_a);
    EXPECT_EQ(one.penetrations.edge_contacts, two.penetrations.edge_contacts);
    EXPECT_GT(one.penetrations.direction[0].dot(Vec3d(0.12, 0.03, 0.01)), 0);  // b is pushed away from a
    EXPECT_EQ(one.contacts.distance[one.penetrations.witness[0]], -one.penetrations.depth[0]);
}

// Metamorphic: the same pair scaled, moved or turned has the depth of the original.
TEST(Penetration, RigidMotionAndScale) {
    const auto depth = [](double scale, const Quat& q, const Vec3d& shift) {
        Mesh a = make_noisy_sphere(10, 1, 0.1, 0), b = make_noisy_sphere(8, 0.7, 0.1, 1);
        for (Mesh* m : {&a, &b}) {
            for (Vec3d& p : m->position) p *= scale;
        }
        ContactScene scene({{a, Motion::kHand, shift, q}, {b, Motion::kHand, Vec3d(shift + rotate(q, scale * Vec3d(1.2, 0.3, 0.1))), q}});
        scene.settings.contact.tolerance = 1e-4 * scale;
        scene.run();
        return scene.penetrations.depth.at(0);
    };
    const double want = depth(1, {}, Vec3d::Zero());
    EXPECT_GT(want, 0.1);
    EXPECT_NEAR(depth(0.125, {}, Vec3d::Zero()), 0.125 * want, 1e-12);
    EXPECT_NEAR(depth(1, turn({3, 1, 2}, 2), Vec3d::Zero()), want, 2e-4);
    EXPECT_NEAR(depth(1, {}, Vec3d(100, -30, 1)), want, 1e-12);
}

}  // namespace
}  // namespace trocar::test
