#include "engine/mesh/near_features.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/folded_sheet.hpp"

namespace trocar {
namespace {

using namespace reference;

// Distance of two edges: the least of the ends from the other edge, or where they cross.
double edge_distance_in_double(const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b) {
    const auto from_edge = [](const Vec3d& x, const Vec3d& from, const Vec3d& to) {
        const Vec3d along = to - from;
        return (x - from - std::clamp((x - from).dot(along) / along.squaredNorm(), 0.0, 1.0) * along).norm();
    };
    double least = std::min({from_edge(p, a, b), from_edge(q, a, b), from_edge(a, p, q), from_edge(b, p, q)});
    Eigen::Matrix<double, 3, 2> m;
    m << q - p, a - b;
    const Eigen::Vector2d at = m.colPivHouseholderQr().solve(a - p);
    if (at.minCoeff() >= 0 && at.maxCoeff() <= 1) least = std::min(least, (p + at[0] * (q - p) - a - at[1] * (b - a)).norm());
    return least;
}

struct Surface {
    Meshes meshes;
    MeshView view;
    std::vector<Float4> position;
    FeatureTrees trees;

    explicit Surface(Mesh mesh) {
        order_for_locality(mesh);
        view = mesh_view(meshes, add_prototype(meshes, mesh, Admission::kSheet));
        for (const Vec3d& p : mesh.position)
            position.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 1});
        build_feature_trees(view, position.data(), trees);
    }
    Vec3d at(uint32_t v) const { return {position[v].x, position[v].y, position[v].z}; }
};

constexpr double kFar = 1e9;  // m, of what is not finite

// What is found nearer than a reach is what brute force in double finds; what else is found is hardly farther.
void expect_pairs(const Surface& a, const Surface& b, bool itself, float reach) {
    NearFeatures near;
    find_near_features(a.view, a.position.data(), a.trees, b.trees, itself, reach, near);
    ASSERT_TRUE(std::ranges::is_sorted(near.vertex_triangle) && std::ranges::is_sorted(near.edge_edge));
    const double most = reach + 0.004 * std::max(a.trees.longest, b.trees.longest);
    size_t within = 0, found = 0;
    const auto check = [&](const std::vector<uint64_t>& pairs, uint32_t first, uint32_t second, double distance) {
        const bool is_found = std::ranges::binary_search(pairs, uint64_t{first} << 32 | second);
        EXPECT_TRUE(is_found || distance >= reach) << first << " " << second << " at " << distance;
        EXPECT_TRUE(!is_found || distance < most) << first << " " << second << " at " << distance;
        within += distance < reach, found += is_found;
    };
    for (uint32_t v = 0; v < a.position.size(); ++v)
        for (uint32_t t = 0; t < b.view.triangle.size(); ++t) {
            const Triangle& c = b.view.triangle[t];
            if (itself && std::ranges::find(c, v) != c.end()) continue;
            const bool finite = a.at(v).allFinite() && b.at(c[0]).allFinite() && b.at(c[1]).allFinite() && b.at(c[2]).allFinite();
            check(near.vertex_triangle, v, t, finite ? exact_triangle_distance(a.at(v), b.at(c[0]), b.at(c[1]), b.at(c[2])) : kFar);
        }
    for (uint32_t e = 0; e < a.view.edge.size(); ++e)
        for (uint32_t f = itself ? e + 1 : 0; f < b.view.edge.size(); ++f) {
            const auto [v, w] = a.view.edge[e];
            const auto [x, y] = b.view.edge[f];
            if (itself && (v == x || v == y || w == x || w == y)) continue;
            const bool finite = a.at(v).allFinite() && a.at(w).allFinite() && b.at(x).allFinite() && b.at(y).allFinite();
            check(near.edge_edge, e, f, finite ? edge_distance_in_double(a.at(v), a.at(w), b.at(x), b.at(y)) : kFar);
        }
    EXPECT_EQ(found, near.vertex_triangle.size() + near.edge_edge.size());  // none twice, none that shares a vertex
    EXPECT_GT(within, 500u);
}

TEST(NearFeatures, AreThoseOfBruteForce) {
    uint64_t seed = 1;
    for (const double noise : {0.0, 3e-4, 2e-3}) {
        const Surface sheet(folded_sheet(24, 8, 2e-3, 8, 1e-3, noise, seed++));
        expect_pairs(sheet, sheet, true, 1.2e-3f);
    }
}

TEST(NearFeatures, OfTwoSurfacesAreThoseOfBruteForce) {
    const Surface sheet(folded_sheet(24, 8, 2e-3, 8, 2e-3, 2e-4, 4)), other(folded_sheet(17, 11, 2.7e-3, 17, 1e-3, 4e-4, 5));
    expect_pairs(sheet, other, false, 1.2e-3f);
}

// Slivers, points and what is not finite.
TEST(NearFeatures, OfBadTrianglesAreThoseOfBruteForce) {
    Surface sheet(folded_sheet(24, 8, 2e-3, 6, 1e-3, 2e-4, 6));
    for (uint32_t v = 0; v < sheet.position.size(); v += 3) sheet.position[v].y = 4e-3f;
    build_feature_trees(sheet.view, sheet.position.data(), sheet.trees);
    expect_pairs(sheet, sheet, true, 1.2e-3f);
    sheet.position[5].x = std::numeric_limits<float>::quiet_NaN(), sheet.position[7].z = std::numeric_limits<float>::infinity();
    build_feature_trees(sheet.view, sheet.position.data(), sheet.trees);
    expect_pairs(sheet, sheet, true, 1.2e-3f);
}

TEST(NearFeatures, AreTheSameForAnyNumberOfThreads) {
    const Surface sheet(folded_sheet(160, 40, 2e-3, 20, 1e-3, 3e-4, 7));
    NearFeatures one;
    find_near_features(sheet.view, sheet.position.data(), sheet.trees, sheet.trees, true, 1.2e-3f, one);
    for (const uint32_t threads : {2u, 5u}) {
        NearFeatures more;
        ThreadPool pool(threads);
        pool.run([&] { find_near_features(sheet.view, sheet.position.data(), sheet.trees, sheet.trees, true, 1.2e-3f, more); });
        EXPECT_EQ(one.vertex_triangle, more.vertex_triangle);
        EXPECT_EQ(one.edge_edge, more.edge_edge);
    }
}

}  // namespace
}  // namespace trocar
