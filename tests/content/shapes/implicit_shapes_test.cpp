#include "content/shapes/implicit_shapes.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/base/error.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

double unit(uint64_t key) { return double(mix_bits(key) >> 11) * 0x1p-53; }

Vec3d point_in(const Box& box, uint64_t key) {
    return box.min + (box.max - box.min).cwiseProduct(Vec3d(unit(3 * key), unit(3 * key + 1), unit(3 * key + 2)));
}

Vec3d slope_of(const ImplicitShape& shape, const Vec3d& p) {
    Vec3d slope;
    for (int k = 0; k < 3; ++k) {
        Vec3d d = Vec3d::Zero();
        d[k] = 1e-6;
        slope[k] = (shape.distance(p + d) - shape.distance(p - d)) / 2e-6;
    }
    return slope;
}

TEST(ImplicitShapes, EllipsoidIsZeroOnItsSurfaceWithUnitSlopeThere) {
    const Vec3d centre(0.1, -0.2, 0.3), radii(0.05, 0.02, 0.03);
    ImplicitShape shape;
    shape.distance = [&](const Vec3d& p) { return ellipsoid_distance(p, centre, radii); };
    for (uint64_t i = 0; i < 500; ++i) {
        const double z = 2 * unit(2 * i) - 1, turn = 2 * M_PI * unit(2 * i + 1), r = std::sqrt(1 - z * z);
        const Vec3d p = centre + radii.cwiseProduct(Vec3d(r * std::cos(turn), r * std::sin(turn), z));
        EXPECT_NEAR(shape.distance(p), 0.0, 1e-15);
        EXPECT_NEAR(slope_of(shape, p).norm(), 1.0, 1e-6);
    }
    EXPECT_EQ(ellipsoid_distance(centre, centre, radii), -0.02);
    // for a sphere the distance is exact everywhere outside
    EXPECT_NEAR(ellipsoid_distance(Vec3d(3, 4, 0), Vec3d::Zero(), Vec3d::Constant(2)), 3.0, 1e-15);
}

TEST(ImplicitShapes, CapsuleOfOneRadiusIsTheDistanceToItsSegment) {
    EXPECT_NEAR(capsule_distance({0.5, 3, 4}, {0, 0, 0}, {1, 0, 0}, 0.5, 0.5), 4.5, 1e-15);
    EXPECT_NEAR(capsule_distance({-3, 4, 0}, {0, 0, 0}, {1, 0, 0}, 0.5, 0.5), 4.5, 1e-15);
    EXPECT_NEAR(capsule_distance({1, 0, 2}, {0, 0, 0}, {1, 0, 0}, 0.5, 0.25), 1.75, 1e-15);
}

TEST(ImplicitShapes, BlendsAreTheSharpOperationsOutsideTheBandAndSymmetric) {
    for (double a = -2; a <= 2; a += 0.25) {
        for (double b = -2; b <= 2; b += 0.25) {
            const double joined = smooth_union(a, b, 0.5);
            EXPECT_EQ(joined, smooth_union(b, a, 0.5));
            EXPECT_LE(joined, std::min(a, b));
            EXPECT_GE(joined, std::min(a, b) - 0.5 / 6);
            if (std::abs(a - b) >= 0.5) {
                EXPECT_EQ(joined, std::min(a, b));
            }
            if (std::abs(a + b) >= 0.5) {
                EXPECT_EQ(smooth_subtraction(a, b, 0.5), std::max(a, -b));
            }
        }
    }
}

// The noise must not depend on a library: its bits must never change.
TEST(ImplicitShapes, NoiseIsBoundedContinuousAndTheSameEverywhere) {
    EXPECT_EQ(lattice_noise({3, 4, 5}, 1), lattice_noise({3, 4, 5}, 1));
    EXPECT_NE(lattice_noise({3, 4, 5}, 1), lattice_noise({3, 4, 5}, 2));
    double sum = 0;
    for (uint64_t i = 0; i < 4000; ++i) {
        const Vec3d p = 40 * Vec3d(unit(3 * i) - 0.5, unit(3 * i + 1) - 0.5, unit(3 * i + 2) - 0.5);
        const double value = lattice_noise(p, 7);
        sum += value;
        ASSERT_LE(std::abs(value), 1.0);
        // also across a lattice plane
        const Vec3d edge(std::floor(p.x()), p.y(), p.z());
        ASSERT_NEAR(lattice_noise(edge - Vec3d(1e-9, 0, 0), 7), lattice_noise(edge, 7), 1e-8);
    }
    EXPECT_NEAR(sum / 4000, 0.0, 0.03);
}

// sample_shape relies on this bound when it fills distant blocks.
TEST(ImplicitShapes, NoSlopeIsSteeperThanDeclared) {
    for (const ImplicitShape& shape : {liver_shape(1), liver_shape(5), kidney_shape(1), kidney_shape(5), stomach_shape(1)}) {
        double steepest = 0;
        for (uint64_t i = 0; i < 50000; ++i) {
            steepest = std::max(steepest, slope_of(shape, point_in(shape.box, i)).norm());
        }
        EXPECT_LT(steepest, 0.9 * shape.steepness) << shape.name;
        EXPECT_GT(steepest, 0.5) << shape.name;
    }
}

// A block filled although the surface passes through it would lose or move a piece of the surface.
TEST(ImplicitShapes, FillingFarBlocksChangesNothingOfTheSurface) {
    for (const ImplicitShape& shape : {kidney_shape(3), stomach_shape(3)}) {
        ScalarGrid grid = sample_shape(shape, 2.3e-3);
        const Mesh quick = contour(grid, 0.0);
        size_t filled = 0;
        for (size_t i = 0; i < grid.values.size(); ++i) {
            const Vec3d position(double(i % grid.nx), double(i / grid.nx % grid.ny), double(i / grid.nx / grid.ny));
            const float full = float(shape.distance(grid.origin + grid.spacing.cwiseProduct(position)));
            filled += grid.values[i] != full;
            grid.values[i] = full;
        }
        const Mesh slow = contour(grid, 0.0);
        EXPECT_GT(filled, grid.values.size() / 20) << shape.name;
        EXPECT_EQ(reference::hash_mesh(quick), reference::hash_mesh(slow)) << shape.name;
    }
}

TEST(ImplicitShapes, TheSurfaceStaysInsideItsBox) {
    for (uint64_t seed = 1; seed <= 8; ++seed) {
        for (const ImplicitShape& shape : {liver_shape(seed), kidney_shape(seed), stomach_shape(seed)}) {
            const auto facts = reference::survey_surface(contour(sample_shape(shape, 4e-3), 0.0));
            EXPECT_TRUE(facts.closed) << shape.name << seed;
            EXPECT_EQ(facts.components, 1u) << shape.name << seed;
            EXPECT_EQ(facts.euler, 2) << shape.name << seed;
        }
    }
}

TEST(ImplicitShapes, ProjectionReachesTheSurface) {
    const ImplicitShape shape = liver_shape(1);
    uint32_t near = 0;
    for (uint64_t i = 0; i < 4000; ++i) {
        const Vec3d p = point_in(shape.box, i);
        if (std::abs(shape.distance(p)) > 3e-3) continue;
        ++near;
        EXPECT_LT(std::abs(shape.distance(project_to_shape(shape, p, 0.01, 12))), 1e-9);
    }
    EXPECT_GT(near, 100u);
}

TEST(ImplicitShapes, AGridTooLargeForMemoryIsRefused) { EXPECT_THROW(sample_shape(liver_shape(1), 1e-5), InputError); }

}  // namespace
}  // namespace trocar
