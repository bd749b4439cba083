#include "systems/detect/broad/separating_axis_culling.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "engine/geometry/triangle_triangle.hpp"
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

Corners corners_of(const ContactScene& scene, uint32_t body, uint32_t triangle) {
    const Surfaces s = scene.surfaces();
    Corners corners;
    const Triangle& t = mesh_view(s.meshes, s.bodies.mesh[body]).triangle[triangle];
    for (int k = 0; k < 3; ++k) corners[k] = vertex_position(s, body, t[k]);
    return corners;
}

// Dropped and `beside` pairs are exactly disjoint; the others keep their order. Returns the number dropped.
size_t expect_only_parted_dropped(ContactScene& scene, const std::string& what) {
    scene.find_triangles();
    const CandidateTriangles before = scene.candidates;
    SeparatingAxisScratch scratch;
    cull_by_separating_axis(scene.inputs(), scratch, scene.candidates);
    const auto rows_of = [](const CandidateTriangles& c, uint32_t pair) {
        return std::span(c.triangle).subspan(c.pair[pair].first, c.pair[pair].count);
    };
    for (uint32_t pair = 0; pair < scene.pairs.a.size(); ++pair) {
        const auto kept = rows_of(scene.candidates, pair);
        auto next = kept.begin();
        for (const auto& row : rows_of(before, pair)) {
            if (next != kept.end() && *next == row) {
                ++next;
                continue;
            }
            EXPECT_EQ(meet_triangles(corners_of(scene, scene.pairs.a[pair], row[0]), corners_of(scene, scene.pairs.b[pair], row[1])),
                      Meeting::kDisjoint)
                << what << ": " << row[0] << " and " << row[1];
        }
        EXPECT_TRUE(next == kept.end()) << what << ": order, or a pair that was not there";
    }
    EXPECT_EQ(scene.candidates.near, before.near);
    EXPECT_EQ(scene.candidates.beside.size(), scene.candidates.triangle.size()) << what;
    for (uint32_t pair = 0; pair < scene.pairs.a.size(); ++pair) {
        const Range rows = scene.candidates.pair[pair];
        for (uint32_t row = rows.first; row < rows.end(); ++row) {
            if (!scene.candidates.beside[row]) continue;
            const auto& two = scene.candidates.triangle[row];
            EXPECT_EQ(meet_triangles(corners_of(scene, scene.pairs.a[pair], two[0]), corners_of(scene, scene.pairs.b[pair], two[1])),
                      Meeting::kDisjoint)
                << what << ": beside, " << two[0] << " and " << two[1];
        }
    }
    return before.triangle.size() - scene.candidates.triangle.size();
}

// Breaks when one corner's side of a plane is used for all, pairs of bodies write into each other's results,
// or the interval on the common line is measured from a corner that is not alone on its side.
TEST(SeparatingAxisCulling, OnlyTrianglesWithoutACommonPointAreDropped) {
    ContactScene scene({{make_noisy_sphere(10, 1, 0.1, 0), Motion::kDeformable, Vec3d(-0.9, -0.2, 0.1), {}},
                        {make_noisy_sphere(10, 1, 0.1, 1), Motion::kHand, Vec3d(0.9, 0, 0), turn({1, 1, 0}, 1)},
                        {make_noisy_sphere(14, 1, 0.1, 2), Motion::kDeformable, Vec3d(0, 0.8, -0.3), {}}});
    const size_t dropped = expect_only_parted_dropped(scene, "spheres");
    EXPECT_GT(dropped, scene.candidates.triangle.size()) << "most boxes that meet are of triangles that do not";
    EXPECT_GT(scene.candidates.triangle.size(), 100u);
    const auto& beside = scene.candidates.beside;
    EXPECT_GT(std::count(beside.begin(), beside.end(), 1), 100) << "of those that pass both planes most cross nowhere";
}

// Triangles with a common plane, corner or edge stay. Breaks when a plane through a corner separates.
TEST(SeparatingAxisCulling, TouchingTrianglesStay) {
    for (const double shift : {0.0, 0.25}) {
        ContactScene scene({{make_box({1, 1, 1}, {4, 4, 4}), Motion::kDeformable, Vec3d::Zero(), {}},
                            {make_box({1, 1, 1}, {4, 4, 4}), Motion::kDeformable, Vec3d(1, shift, 0), {}}});
        expect_only_parted_dropped(scene, "shifted by " + std::to_string(shift));
        EXPECT_GT(scene.candidates.triangle.size(), 32u);
    }
}

}  // namespace
}  // namespace trocar::test
