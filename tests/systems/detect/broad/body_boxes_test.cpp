#include "systems/detect/broad/body_boxes.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

// Breaks when a vertex, the margin, the rotation or the fastest speed is left out of a box.
TEST(BodyBoxes, HoldEveryVertexAndTheReach) {
    ContactScene scene({{make_noisy_sphere(6, 0.1, 0.1, 1), Motion::kDeformable, Vec3d(3, -2, 1), {}},
                        {make_noisy_sphere(6, 0.1, 0.1, 2), Motion::kHand, Vec3d(-1, 2, 5), turn({1, 2, 3}, 0.7)},
                        {make_sheet(0.2, 3), Motion::kStatic, Vec3d::Zero(), turn({1, 0, 0}, 1), Admission::kSheet, 0.004}});
    scene.particles.velocity_x[7] = 0.3f;
    scene.particles.velocity_y[7] = -0.4f;
    scene.particles.velocity_z[11] = 0.2f;
    scene.poses.velocity[1] = Vec3d(0, 0, 2);
    scene.poses.angular_velocity[1] = Vec3d(0, 3, 0);
    compute_body_boxes({0.02, scene.surfaces()}, scene.boxes);

    const double mean[3] = {scene.meshes.info[0].mean_edge, scene.meshes.info[1].mean_edge, scene.meshes.info[2].mean_edge};
    // two vertices tremble, the rest is still: the bound of the mean displacement and half an edge holds
    const double mean_way = 0.02 * std::sqrt((0.25 + 0.04) / scene.meshes.info[0].vertices.count);
    EXPECT_NEAR(scene.boxes.margin[0], std::min(0.5 * 0.02, mean_way + 0.5 * mean[0]) + 0.05 * mean[0], 1e-9);
    EXPECT_NEAR(scene.boxes.margin[1], std::min((2 + 3 * scene.meshes.info[1].radius) * 0.02, 3 * mean[1]) + 0.05 * mean[1], 1e-12);
    EXPECT_NEAR(scene.boxes.margin[2], 0.05 * mean[2], 1e-15);
    for (uint32_t body = 0; body < 3; ++body) {
        Box box;
        for (uint32_t v = 0; v < scene.meshes.info[body].vertices.count; ++v) {
            box.min = box.min.cwiseMin(vertex_position(scene.surfaces(), body, v));
            box.max = box.max.cwiseMax(vertex_position(scene.surfaces(), body, v));
        }
        const double reach = scene.boxes.margin[body] + (body == 2 ? 0.002 : 0);
        EXPECT_LT((scene.boxes.box[body].min - box.min + Vec3d::Constant(reach)).norm(), 1e-14) << body;
        EXPECT_LT((scene.boxes.box[body].max - box.max - Vec3d::Constant(reach)).norm(), 1e-14) << body;
    }
}

// Breaks when a non-finite particle affects its body's box or margin.
TEST(BodyBoxes, H09_SkipNonFiniteVertices) {
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    ContactScene scene({{make_box({1, 1, 1}, {2, 2, 2}), Motion::kDeformable, Vec3d::Zero(), {}}});
    for (Float4& p : scene.particles.offset) {
        if (p.x < -0.4f && p.y < -0.4f) p.x = nan;
        if (p.x > 0.4f && p.z > 0.4f) p.y = -inf;
    }
    scene.particles.velocity_x[0] = nan;
    scene.particles.velocity_x[1] = inf;
    scene.particles.velocity_x[9] = 1;
    compute_body_boxes({0.01, scene.surfaces()}, scene.boxes);
    EXPECT_NEAR(scene.boxes.margin[0], 0.01 + 0.05 * scene.meshes.info[0].mean_edge, 1e-12);
    EXPECT_TRUE((scene.boxes.box[0].max - Vec3d::Constant(0.5 + scene.boxes.margin[0])).norm() < 1e-12);

    for (Float4& p : scene.particles.offset) p.z = nan;
    compute_body_boxes({0.01, scene.surfaces()}, scene.boxes);
    EXPECT_GT(scene.boxes.box[0].min.x(), scene.boxes.box[0].max.x());  // empty
}

TEST(BodyBoxes, H14_NoBodies) {
    ContactScene scene({});
    scene.run();
    EXPECT_TRUE(scene.boxes.box.empty());
    EXPECT_TRUE(scene.pairs.a.empty());
    EXPECT_TRUE(scene.contacts.pair.empty());
    EXPECT_TRUE(scene.islands.bodies.empty());
}

}  // namespace
}  // namespace trocar::test
