#include "systems/output/picture_snapshot.hpp"

#include <gtest/gtest.h>

#include "tests/reference/picture_scene.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using reference::PictureScene;

// fails when positions are converted to world floats: 1e7 m away they would be 1 m off
TEST(PictureSnapshot, HoldsWorldPositionsExactlyAtAnyDistance) {
    PictureScene scene;
    const uint32_t mesh = scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.1, 2));
    scene.add_body(mesh, Motion::kDeformable, {1e7, -2e7, 3e7});
    const Quat turn = from_rotation_vector({0.3, -0.2, 0.9});
    scene.add_body(mesh, Motion::kHand, {5, 6, 7}, turn);
    const PictureSnapshot s = scene.snapshot();
    ASSERT_EQ(s.body.size(), 2u);
    for (uint32_t v = 0; v < s.body[0].vertices.count; ++v) {
        const Vec3d p = s.body[0].origin + s.position[s.body[0].vertices.first + v].cast<double>();
        EXPECT_EQ(p, vertex_position(scene.surfaces(), 0, v));
    }
    EXPECT_EQ(s.body[0].vertices.count, scene.meshes.info[mesh].vertices.count);  // no padding
    EXPECT_EQ(s.body[1].vertices.count, 0u);
    const Vec3d corner = scene.meshes.position[3];
    EXPECT_EQ(s.body[1].origin + rotate(s.body[1].orientation, corner), vertex_position(scene.surfaces(), 1, 3));
}

TEST(PictureSnapshot, KeepsTheDeepestContactOfEveryVertex) {
    PictureScene scene;
    const uint32_t mesh = scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.1, 1));
    for (int i = 0; i < 3; ++i) scene.add_body(mesh, Motion::kDeformable);
    scene.add_body(mesh, Motion::kStatic);
    scene.add_contact(0, {4, 4}, -0.002);
    scene.add_contact(0, {4, 4}, -0.005);
    scene.add_contact(0, {4, 7}, -0.003);  // an edge point counts for both its ends
    scene.add_contact(1, {2, 2}, 0.001);   // outside: no depth
    scene.add_contact(3, {5, 5}, -0.004);
    const PictureSnapshot s = scene.snapshot();
    const auto depth = [&](uint32_t body, uint32_t v) { return s.contact_depth[s.body[body].depths.first + v]; };
    ASSERT_EQ(s.body[0].depths.count, scene.meshes.info[mesh].vertices.count);
    for (uint32_t v = 0; v < s.body[0].depths.count; ++v) EXPECT_EQ(depth(0, v), v == 4 ? 0.005f : v == 7 ? 0.003f : 0.0f);
    EXPECT_EQ(s.body[1].depths.count, 0u);
    EXPECT_EQ(s.body[2].depths.count, 0u);
    ASSERT_EQ(s.body[3].depths.count, scene.meshes.info[mesh].vertices.count);
    EXPECT_EQ(depth(3, 5), 0.004f);
}

TEST(PictureSnapshot, CopiesWitnessesToolsAndTime) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.1, 1)), Motion::kDeformable);
    scene.add_contact(0, {1, 1}, -0.002);
    scene.add_contact(0, {2, 2}, -0.006);
    scene.penetrations.depth = {0.006, 0.5};
    scene.penetrations.witness = {1, kNone};  // the second pair has none
    scene.haptics.tool.resize(2);
    scene.haptics.state.resize(2);
    scene.haptics.tool[1].tip_radius = 0.003;
    scene.haptics.state[0].device.position = {1, 2, 3};
    scene.haptics.state[0].proxy = {9, 9, 9};  // not valid: must not show
    scene.haptics.state[1].proxy = {4, 5, 6};
    scene.haptics.state[1].proxy_valid = true;
    scene.haptics.state[1].output.force = {0, 3, 4};
    PictureSnapshot s;
    scene.write(s, 1.25);
    EXPECT_EQ(s.time, 1.25);
    ASSERT_EQ(s.witness.size(), 1u);
    EXPECT_EQ(s.witness[0].point, scene.contacts.point[1]);
    EXPECT_EQ(s.witness[0].closest, scene.contacts.closest[1]);
    EXPECT_EQ(s.depth, 0.5);
    ASSERT_EQ(s.tool.size(), 2u);
    EXPECT_EQ(s.tool[0].proxy, Vec3d(1, 2, 3));
    EXPECT_EQ(s.tool[1].proxy, Vec3d(4, 5, 6));
    EXPECT_EQ(s.tool[1].radius, 0.003);
    EXPECT_EQ(s.force, 5);
}

TEST(PictureSnapshot, BoxesHoldEveryFiniteVertexTightly) {
    PictureScene scene;
    const uint32_t mesh = scene.add_mesh(reference::make_box({-1, -2, -3}, {1, 2, 3}));
    scene.add_body(mesh, Motion::kDeformable, {10, 0, 0});
    scene.particles.offset[7].z = std::numeric_limits<float>::quiet_NaN();
    scene.particles.offset[6].x = std::numeric_limits<float>::infinity();
    scene.particles.offset[0].x = -4;
    PictureSnapshot s = scene.snapshot();
    EXPECT_EQ(s.body[0].box.min, Vec3d(-4, -2, -3));
    EXPECT_EQ(s.body[0].box.max, Vec3d(1, 2, 3));
}

TEST(PictureSnapshot, SkipsBodiesWithoutAMeshAndReusesItsCapacity) {
    PictureScene scene;
    const uint32_t mesh = scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.1, 2));
    scene.add_body(mesh, Motion::kDeformable);
    scene.add_body(mesh, Motion::kDeformable);
    scene.add_contact(0, {1, 1}, -0.002);
    PictureSnapshot s = scene.snapshot();
    const void *position = s.position.data(), *normal = s.normal.data(), *depth = s.contact_depth.data();
    scene.write(s);
    EXPECT_EQ(position, s.position.data());
    EXPECT_EQ(normal, s.normal.data());
    EXPECT_EQ(depth, s.contact_depth.data());
    scene.bodies.mesh[0] = kNone;
    scene.write(s);
    EXPECT_EQ(s.body[0].mesh, kNone);
    EXPECT_EQ(s.body[1].vertices.first, 0u);
    EXPECT_TRUE(s.contact_depth.empty());
}

}  // namespace
}  // namespace trocar
