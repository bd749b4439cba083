#include "systems/detect/broad/refit_trees.hpp"

#include <gtest/gtest.h>

#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

// Breaks when a body in a pair keeps its old surface, or when one in no pair is refitted.
TEST(RefitTrees, OnlyDeformableBodiesInAPair) {
    const Mesh ball = make_noisy_sphere(4, 1, 0.1, 0);
    ContactScene scene({{ball, Motion::kDeformable, Vec3d(0, 0, 0), {}},
                        {ball, Motion::kHand, Vec3d(1.5, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(90, 0, 0), {}}});
    for (Float4& p : scene.particles.offset) p.z += 0.25f;
    compute_body_boxes({scene.period, scene.surfaces()}, scene.boxes);
    find_broad_phase_pairs(scene.bodies, scene.boxes, {}, scene.frame.scratch.pairs, scene.pairs);
    ASSERT_EQ(scene.pairs.a.size(), 1u);
    refit_trees(scene.bodies, scene.particles, scene.pairs, scene.frame.scratch.refit, scene.trees);
    for (uint32_t v = 0; v < ball.position.size(); ++v) {
        EXPECT_EQ(scene.trees[0]->vertex(v), vertex_in_frame(scene.surfaces(), 0, v));
        EXPECT_EQ(scene.trees[1]->vertex(v), ball.position[v]);
        EXPECT_NE(scene.trees[2]->vertex(v), vertex_in_frame(scene.surfaces(), 2, v));
    }
}

}  // namespace
}  // namespace trocar::test
