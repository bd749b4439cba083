#include "content/volume/marching_cubes.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

uint64_t mix(uint64_t x) {
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return x ^ x >> 31;
}

// Samples with the given signs and hashed magnitudes, inside a border of outside samples.
ScalarGrid padded_signs(uint32_t n, uint64_t seed, const std::vector<bool>& inside) {
    ScalarGrid grid{Vec3d::Zero(), Vec3d::Ones(), n + 2, n + 2, n + 2, {}};
    uint64_t state = seed;
    uint32_t row = 0;
    for (uint32_t z = 0; z < n + 2; ++z) {
        for (uint32_t y = 0; y < n + 2; ++y) {
            for (uint32_t x = 0; x < n + 2; ++x) {
                const bool core = x > 0 && y > 0 && z > 0 && x <= n && y <= n && z <= n;
                const float size = 0.02f + float(mix(++state) >> 40) * 0x1p-24f;
                grid.values.push_back(core && inside[row++] ? -size : size);
            }
        }
    }
    return grid;
}

ScalarGrid sphere_grid(double radius, uint32_t cells_a_radius) {
    const double h = radius / cells_a_radius;
    const uint32_t n = 2 * cells_a_radius + 4;
    ScalarGrid grid{Vec3d(-1.4, -1.3, -1.7) * h, Vec3d::Constant(h), n, n, n, {}};
    const Vec3d centre = Vec3d::Constant(radius);
    for (uint32_t z = 0; z < n; ++z) {
        for (uint32_t y = 0; y < n; ++y) {
            for (uint32_t x = 0; x < n; ++x) {
                grid.values.push_back(float((grid.origin + Vec3d(x, y, z) * h - centre).norm() - radius));
            }
        }
    }
    return grid;
}

// A wrong pairing on one face, a diagonal inside a face, or a reversed loop opens one of these surfaces or
// gives an edge four triangles.
TEST(MarchingCubes, EverySignPatternOfACellIsClosedManifoldOutwardAndFreeOfCrossings) {
    for (uint32_t signs = 1; signs < 256; ++signs) {
        std::vector<bool> inside(8);
        for (int c = 0; c < 8; ++c) inside[c] = signs >> c & 1;
        const Mesh mesh = contour(padded_signs(2, signs, inside), 0.0);
        const auto facts = reference::survey_surface(mesh);
        ASSERT_TRUE(facts.closed) << signs;
        ASSERT_TRUE(facts.one_fan) << signs;
        ASSERT_EQ(facts.unused_vertices, 0u) << signs;
        ASSERT_GT(facts.volume, 0.0) << signs;
        ASSERT_EQ(reference::count_crossings(mesh), 0u) << signs;
    }
}

TEST(MarchingCubes, RandomBlocksAreClosedManifoldAndOrientedOutward) {
    for (uint64_t seed = 0; seed < 4096; ++seed) {
        std::vector<bool> inside(27);
        bool any = false;
        for (int c = 0; c < 27; ++c) any |= inside[c] = mix(seed * 64 + c + 1) >> 7 & 1;
        if (!any) continue;
        const auto facts = reference::survey_surface(contour(padded_signs(3, seed, inside), 0.0));
        ASSERT_TRUE(facts.closed) << seed;
        ASSERT_TRUE(facts.one_fan) << seed;
        ASSERT_GT(facts.volume, 0.0) << seed;
    }
}

// The inside of the surface is the set of inside samples: checks every sample by a sum of solid angles.
TEST(MarchingCubes, EverySampleIsOnItsOwnSide) {
    for (uint64_t seed = 0; seed < 64; ++seed) {
        std::vector<bool> inside(27);
        for (int c = 0; c < 27; ++c) inside[c] = mix(seed * 64 + c + 1) >> 9 & 1;
        const ScalarGrid grid = padded_signs(3, seed, inside);
        const Mesh mesh = contour(grid, 0.0);
        for (uint32_t i = 0; i < grid.values.size(); ++i) {
            const Vec3d p(i % 5, i / 5 % 5, i / 25);
            double winding = 0;
            for (const Triangle& t : mesh.triangle) {
                const Vec3d a = mesh.position[t[0]] - p, b = mesh.position[t[1]] - p, c = mesh.position[t[2]] - p;
                const double la = a.norm(), lb = b.norm(), lc = c.norm();
                const double det = a.x() * (b.y() * c.z() - b.z() * c.y()) - a.y() * (b.x() * c.z() - b.z() * c.x()) +
                                   a.z() * (b.x() * c.y() - b.y() * c.x());
                winding += std::atan2(det, la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb) / (2 * M_PI);
            }
            ASSERT_NEAR(winding, grid.values[i] < 0 ? 1.0 : 0.0, 1e-9) << seed << " sample " << i;
        }
    }
}

// Linear interpolation on the edges converges with second order; taking edge midpoints, with first order.
TEST(MarchingCubes, SphereVolumeAndAreaConvergeWithTheSquareOfTheSpacing) {
    const double radius = 0.1;
    const double volume = 4.0 / 3.0 * M_PI * radius * radius * radius;
    const double area = 4.0 * M_PI * radius * radius;
    std::vector<double> volume_error, area_error;
    for (const uint32_t cells : {8u, 16u, 32u, 64u}) {
        const auto facts = reference::survey_surface(contour(sphere_grid(radius, cells), 0.0));
        EXPECT_TRUE(facts.closed);
        EXPECT_EQ(facts.euler, 2);
        volume_error.push_back(std::abs(facts.volume / volume - 1));
        area_error.push_back(std::abs(facts.area / area - 1));
    }
    for (int i = 0; i + 1 < 4; ++i) {
        EXPECT_NEAR(std::log2(volume_error[i] / volume_error[i + 1]), 2.0, 0.25) << i;
        EXPECT_NEAR(std::log2(area_error[i] / area_error[i + 1]), 2.0, 0.25) << i;
    }
    EXPECT_LT(volume_error.back(), 5e-4);
    EXPECT_LT(area_error.back(), 5e-4);
}

TEST(MarchingCubes, SamplesExactlyOnTheContourLeaveNoDegenerateTriangle) {
    ScalarGrid grid{Vec3d::Zero(), Vec3d(1, 2, 3), 7, 7, 7, {}};
    for (int i = 0; i < 343; ++i) {
        const int x = std::abs(i % 7 - 3), y = std::abs(i / 7 % 7 - 3), z = std::abs(i / 49 - 3);
        grid.values.push_back(float(x + y + z - 2));
    }
    const Mesh mesh = contour(grid, 0.0);
    EXPECT_TRUE(reference::survey_surface(mesh).closed);
    EXPECT_GT(reference::survey_shape(mesh).min_edge, 1e-4);
    EXPECT_GT(reference::survey_shape(mesh).min_angle, 1e-3);
}

TEST(MarchingCubes, AnEmptyOrFullGridGivesNothing) {
    ScalarGrid grid{Vec3d::Zero(), Vec3d::Ones(), 20, 3, 4, std::vector<float>(240, 1.0f)};
    EXPECT_TRUE(contour(grid, 0.0).triangle.empty());
    EXPECT_TRUE(contour(grid, 2.0).triangle.empty());
}

}  // namespace
}  // namespace trocar
