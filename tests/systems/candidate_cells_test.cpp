#include "systems/candidate_cells.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/reference/brute_force_contact.hpp"
#include "tests/systems/contact_scene.hpp"
namespace trocar::test {
namespace {

using PairList = std::vector<std::array<uint32_t, 2>>;

// Triangles of one side of a list of pairs, each once, ascending.
std::vector<uint32_t> one_side(const PairList& pairs, int side) {
    std::vector<uint32_t> out;
    for (const auto& pair : pairs) out.push_back(pair[side]);
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
}

template <typename List>
void expect_between(const List& found, const List& least, const List& most, const std::string& what) {
    EXPECT_TRUE(std::is_sorted(found.begin(), found.end())) << what;
    EXPECT_TRUE(std::adjacent_find(found.begin(), found.end()) == found.end()) << what << ": reported twice";
    EXPECT_TRUE(std::includes(found.begin(), found.end(), least.begin(), least.end())) << what << ": missed";
    EXPECT_TRUE(std::includes(most.begin(), most.end(), found.begin(), found.end())) << what << ": too many";
}

// Every triangle pair whose boxes meet and every triangle whose enlarged box meets one of the other body is there once,
// in order; what is there besides meets when the boxes are a rounding of the packed floats larger.
void expect_all_pairs(const ContactScene& scene, const std::string& what) {
    for (uint32_t pair = 0; pair < scene.pairs.a.size(); ++pair) {
        const uint32_t a = scene.pairs.a[pair], b = scene.pairs.b[pair];
        const reference::Surface of_a(scene.surfaces(), a), of_b(scene.surfaces(), b);
        double size = 0;
        for (const Vec3d& p : of_a.position) size = std::max(size, (p - scene.screened.origin).cwiseAbs().maxCoeff());
        const double slack = 1e-6 * size;
        const auto meeting = [&](double reach_a, double reach_b) {
            return reference::meeting_triangles(of_a, of_b, reach_a, reach_b);
        };
        const Range rows = scene.candidates.pair[pair];
        const auto* first = scene.candidates.triangle.data() + rows.first;
        expect_between(PairList(first, first + rows.count), meeting(0, 0), meeting(slack, slack), what + ", crossing");

        const double reach_a = reach_of(scene.bodies, scene.boxes, a), reach_b = reach_of(scene.bodies, scene.boxes, b);
        const PairList least = meeting(reach_a, reach_b), most = meeting(reach_a + slack, reach_b + slack);
        for (const uint32_t side : {0, 1}) {
            std::vector<uint32_t> near;
            for (uint32_t i = 0; i < scene.candidates.side[2 * pair + side].count; ++i) {
                const auto& [own, across] = scene.candidates.near[scene.candidates.side[2 * pair + side].first + i];
                near.push_back(own);
                const std::array<uint32_t, 2> partner{side == 0 ? own : across, side == 0 ? across : own};
                EXPECT_TRUE(std::binary_search(most.begin(), most.end(), partner)) << what << ": not near its partner";
            }
            expect_between(near, one_side(least, side), one_side(most, side), what + ", near");
        }
    }
}

// Any cell size, from many cells a triangle to all triangles in one cell.
TEST(CandidateCells, H16_H18_EqualBruteForceForAnyCellSize) {
    ContactScene scene({{make_noisy_sphere(10, 1, 0.1, 0), Motion::kDeformable, Vec3d(-0.9, -0.2, 0.1), {}},
                        {make_noisy_sphere(10, 1, 0.1, 1), Motion::kHand, Vec3d(0.9, 0, 0), turn({1, 1, 0}, 1)},
                        {make_noisy_sphere(14, 1, 0.1, 2), Motion::kDeformable, Vec3d(0, 0.8, -0.3), {}}});
    for (const double edges : {0.01, 0.3, 0.5, 1.0, 1.7, 2.5, 4.0, 8.0, 20.0, 100.0}) {
        scene.params.cell_edges = edges;
        scene.find_triangles();
        ASSERT_EQ(scene.pairs.a.size(), 3u);
        ASSERT_GT(scene.candidates.triangle.size(), 500u);
        expect_all_pairs(scene, "cell of " + std::to_string(edges) + " edges");
    }
}

// Breaks when the far frame's rounding loses a pair.
TEST(CandidateCells, EqualBruteForceFarFromTheOrigin) {
    const Vec3d far(1e4, -2e4, 3e4);
    ContactScene scene(
        {{make_noisy_sphere(10, 0.1, 0.1, 0), Motion::kDeformable, far, {}},
         {make_noisy_sphere(10, 0.1, 0.1, 1), Motion::kHand, far + Vec3d(0.15, 0.03, 0), turn({1, 1, 0}, 1)}});
    scene.find_triangles();
    ASSERT_GT(scene.candidates.triangle.size(), 100u);
    expect_all_pairs(scene, "far");
}

// Huge triangles against tiny ones, both on the oversize path and beside it.
TEST(CandidateCells, OversizeTrianglesLoseNothing) {
    for (const double edges : {0.1, 0.3, 1.0, 2.5}) {
        ContactScene scene({{make_box({4, 4, 1}), Motion::kStatic, Vec3d(0, 0, -0.5), turn({1, 2, 3}, 0.1)},
                            {make_noisy_sphere(12, 0.3, 0.1, 0), Motion::kDeformable, Vec3d(0.1, 0.2, 0.2), {}},
                            {make_box({3, 0.1, 0.1}, {1, 1, 1}), Motion::kDeformable, Vec3d(0.1, 0.2, 0.02), {}}});
        scene.params.cell_edges = edges;
        scene.find_triangles();
        ASSERT_EQ(scene.pairs.a.size(), 3u);
        if (edges < 0.5) {
            ASSERT_GT(scene.occupancy.oversize.size(), 1u);
        }
        expect_all_pairs(scene, "oversize " + std::to_string(edges));
    }
}

// Flat boxes on the faces of each other; the unit cubes share the plane x = 0.5.
TEST(CandidateCells, H15_FlatAndCoplanarTrianglesAreFound) {
    ContactScene scene({{make_box({1, 1, 1}, {4, 4, 4}), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_box({1, 1, 1}, {4, 4, 4}), Motion::kDeformable, Vec3d(1, 0.25, 0), {}}});
    scene.find_triangles();
    ASSERT_GT(scene.candidates.triangle.size(), 32u);
    expect_all_pairs(scene, "coplanar");
}

// Excluded pairs share cells but get no triangle pairs.
TEST(CandidateCells, OnlyCandidatePairsCount) {
    const Mesh ball = make_noisy_sphere(8, 1, 0.1, 0);
    ContactScene scene({{ball, Motion::kDeformable, Vec3d(0, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(0.5, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(0, 0.5, 0), {}}});
    scene.excluded = {{0, 2}};
    scene.find_triangles();
    ASSERT_EQ(scene.pairs.a.size(), 2u);
    expect_all_pairs(scene, "excluded");
}

}  // namespace
}  // namespace trocar::test
