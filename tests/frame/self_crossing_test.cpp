#include "content/mend/self_crossing.hpp"

#include <gtest/gtest.h>

#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "frame/scenes_under_test.hpp"
#include "frame/written_scene.hpp"
#include "systems/output/self_crossings.hpp"

// What crosses itself is counted at the end of every displayed frame.
namespace trocar {
namespace {

Mesh present_surface(const World& w, uint32_t body) {
    Mesh mesh;
    const MeshView view = mesh_view(w.meshes, w.bodies.mesh[body]);
    mesh.triangle.assign(view.triangle.begin(), view.triangle.end());
    for (uint32_t v = 0; v < view.position.size(); ++v) mesh.position.push_back(vertex_in_frame(surfaces_of(w), body, v));
    return mesh;
}

// A slack loop of bowel collapses under its weight and through itself; the count is that of exact tests of all faces in double.
TEST(SelfCrossings, OfACollapsingLoopAreCounted) {
    const WrittenScene scene("loop", R"(
[[body]]
name = "table"
shape = "table"
[[body]]
name = "bowel"
shape = "bowel"
motion = "deformable"
anchor = "shape"
triangles = 800
position = [0, 0, 0.05]
[body.tissue]
youngs_modulus = 2e3
depth = 1e6
)");
    uint64_t most = 0, looks = 0;
    run(scene.build().world, 220, [&](const Frame& frame, int) {
        const World& w = frame.world();
        if (w.self_crossings.pairs.empty()) return;  // before the first picture
        const uint64_t found = w.self_crossings.pairs[1];
        EXPECT_EQ(w.self_crossings.pairs[0], 0u);
        if (frame.times().picture && found > 0) {
            EXPECT_EQ(found, count_self_crossings(present_surface(w, 1)).crossing);
            most = std::max(most, found), ++looks;
        }
        EXPECT_EQ(w.report.self_crossings, most);
    });
    EXPECT_GE(looks, 3u);
}

TEST(SelfCrossings, OrgansThatPressEachOtherHaveNone) {
    run(small_scene("kidney_on_liver").world, 80, [](const Frame& frame, int) { EXPECT_EQ(frame.world().report.self_crossings, 0u); });
}

// Closed bodies are looked at once in a round of frames, sheets in each.
TEST(SelfCrossings, AreCountedInTurn) {
    const WrittenScene scene("turns", R"(
gravity = [0, 0, 0]
[[body]]
name = "liver"
shape = "liver"
motion = "deformable"
triangles = 2000
[[body]]
name = "ball"
shape = "sphere"
motion = "deformable"
triangles = 900
position = [1, 0, 0]
[[body]]
name = "sheet"
shape = "surgical_mesh"
motion = "deformable"
triangles = 900
position = [2, 0, 0]
)");
    World world = scene.build().world;
    std::vector<uint64_t> right;
    for (uint32_t b = 0; b < 3; ++b) {
        for (uint32_t v = 0; v < world.bodies.particles[b].count; ++v) {
            Float4& at = world.particles.offset[world.bodies.particles[b].first + v];
            const auto far = [&](double k) { return static_cast<float>(world.meshes.info[b].mean_edge * std::sin(k * v * v)); };
            at.x += far(1), at.y += far(3), at.z += far(7);
        }
        right.push_back(count_self_crossings(present_surface(world, b)).crossing);
        EXPECT_GT(right[b], 10u);
    }
    right[2] *= kFramesBetweenLooks;
    CrossingFacesScratch scratch;
    std::vector<uint64_t> found(3);
    Report report;
    uint64_t most = 0;
    for (uint64_t picture = 3; picture < 3 + kFramesBetweenLooks; ++picture) {
        SelfCrossingCounts counts;
        count_self_crossings(picture, surfaces_of(world), {}, scratch, counts, report);
        for (size_t b = 0; b < 3; ++b) found[b] += counts.pairs[b];
        most = std::max(most, counts.pairs[0] + counts.pairs[1] + counts.pairs[2]);
    }
    EXPECT_EQ(found, right);
    EXPECT_EQ(report.self_crossings, most);
}

// A sheet thrown into itself at random; also all points in one place, where exact tests are bounded.
TEST(SelfCrossings, AreTheSameOnAnyThreads) {
    const WrittenScene scene("thrown", "[[body]]\nname = \"liver\"\nshape = \"liver\"\ntriangles = 4000\nmotion = \"deformable\"\n");
    const World w = scene.build().world;
    const MeshView view = mesh_view(w.meshes, w.bodies.mesh[0]);
    for (const float size : {0.0f, 1.0f, 3.0f}) {
        std::vector<Float4> position(w.particles.offset.begin(), w.particles.offset.begin() + static_cast<long>(view.position.size()));
        for (size_t i = 0; i < position.size(); ++i)
            position[i].x = size == 0 ? 0 : position[i].x + size * static_cast<float>(view.info->mean_edge * std::sin(double(i * i)));
        uint64_t alone = 0;
        for (const uint32_t threads : {1u, 2u, 5u}) {
            ThreadPool pool(threads);
            pool.run([&] {
                CrossingFacesScratch scratch;
                const uint64_t found = count_crossing_faces(view.triangle, position.data(), scratch);
                if (threads == 1) alone = found;
                EXPECT_EQ(found, alone);
                EXPECT_GT(found, 100u);
            });
        }
    }
}

}  // namespace
}  // namespace trocar
