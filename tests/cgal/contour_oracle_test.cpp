#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/intersections.h>
#include <gtest/gtest.h>

#include <map>
#include <random>

#include "engine/geometry/triangle_triangle.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// CGAL's exact kernel as oracle of which triangles meet and where.
namespace trocar::test {
namespace {

using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;

struct Count {
    uint32_t pairs = 0, apart = 0, touching = 0, crossing = 0;
};

Kernel::Point_3 exact(const Vec3d& p) { return {p.x(), p.y(), p.z()}; }
Vec3d rounded(const Kernel::Point_3& p) { return {CGAL::to_double(p.x()), CGAL::to_double(p.y()), CGAL::to_double(p.z())}; }

// For every pair of triangles of two bodies our exact test says disjoint exactly if CGAL does; a contour
// segment lies between the ends that CGAL constructs, exists wherever the triangles cross properly and
// nowhere if they are disjoint.
void compare(ContactScene& scene, Count& count) {
    scene.run_with_regions();
    std::map<std::array<uint32_t, 2>, uint32_t> segment;
    for (uint32_t i = 0; i < scene.contours.triangle.size(); ++i) segment[scene.contours.triangle[i]] = i;
    const Vec3d base = scene.poses.origin[0];
    std::array<std::vector<Corners>, 2> corners;
    for (uint32_t body = 0; body < 2; ++body) {
        const BodyPoints points(scene.surfaces(), body, base);
        for (const Triangle& t : mesh_view(scene.meshes, body).triangle)
            corners[body].push_back({points.point(t[0]), points.point(t[1]), points.point(t[2])});
    }
    for (uint32_t i = 0; i < corners[0].size(); ++i) {
        const Kernel::Triangle_3 a(exact(corners[0][i][0]), exact(corners[0][i][1]), exact(corners[0][i][2]));
        for (uint32_t j = 0; j < corners[1].size(); ++j) {
            const Kernel::Triangle_3 b(exact(corners[1][j][0]), exact(corners[1][j][1]), exact(corners[1][j][2]));
            ++count.pairs;
            const Meeting ours = meet_triangles(corners[0][i], corners[1][j]);
            const bool meet = CGAL::do_intersect(a, b);
            ASSERT_EQ(ours != Meeting::kDisjoint, meet) << i << " " << j;
            const auto found = segment.find({i, j});
            if (!meet) {
                ++count.apart;
                ASSERT_TRUE(found == segment.end());
                continue;
            }
            const auto common = CGAL::intersection(a, b);
            ASSERT_TRUE(bool(common));
            const Kernel::Segment_3* line = boost::get<Kernel::Segment_3>(&*common);
            const bool proper = ours == Meeting::kCrossing && line != nullptr;
            ++(proper ? count.crossing : count.touching);
            if (!proper) continue;
            ASSERT_TRUE(found != segment.end()) << i << " " << j;
            const auto& end = scene.contours.end[found->second];
            const Vec3d p = scene.contours.point[end[0]] - base, q = scene.contours.point[end[1]] - base;
            const Vec3d s = rounded(line->source()), t = rounded(line->target());
            const double apart = std::min(std::max((p - s).norm(), (q - t).norm()), std::max((p - t).norm(), (q - s).norm()));
            EXPECT_LT(apart, 1e-12) << i << " " << j;
        }
    }
}

TEST(CgalOracle, BumpySpheres) {
    Count count;
    for (const uint32_t seed : {1u, 2u, 3u, 4u}) {
        ContactScene scene(
            {{make_noisy_sphere(5, 0.1, 0.2, seed), Motion::kHand, Vec3d(1, 2, 3), turn({1, 2, 3}, seed)},
             {make_noisy_sphere(6, 0.1, 0.2, 2 * seed), Motion::kHand, Vec3d(1.06, 2.05, 3.03), turn({3, 1, 2}, 2.0 * seed)}});
        compare(scene, count);
    }
    EXPECT_GT(count.crossing, 300u);
    EXPECT_GT(count.apart, 100'000u);
}

// Corners at small integers: shared corners, edges in faces, common planes.
TEST(CgalOracle, TetrahedraOnAGrid) {
    std::mt19937 random(17);
    std::uniform_int_distribution<int> position(0, 3);
    Count count;
    for (int trial = 0; trial < 3000; ++trial) {
        std::array<std::array<Vec3d, 4>, 2> p;
        bool flat = false;
        for (auto& corners : p) {
            for (Vec3d& x : corners) x = Vec3d(position(random), position(random), position(random));
            flat |= (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(corners[3] - corners[0]) == 0;
        }
        if (flat) continue;
        ContactScene scene(
            {{make_tetrahedron(p[0]), Motion::kHand, Vec3d::Zero(), {}}, {make_tetrahedron(p[1]), Motion::kHand, Vec3d::Zero(), {}}});
        compare(scene, count);
    }
    EXPECT_GT(count.touching, 5000u);
    EXPECT_GT(count.crossing, 5000u);
    std::printf("[          ] %u pairs: %u apart, %u touching, %u crossing\n", count.pairs, count.apart, count.touching, count.crossing);
}

}  // namespace
}  // namespace trocar::test
