#include "content/mend/smoothing.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "content/shapes/shape_library.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

double roughness(const Mesh& sphere) {
    double sum = 0;
    for (const Vec3d& p : sphere.position) sum += (p.norm() - 0.5) * (p.norm() - 0.5);
    return std::sqrt(sum / double(sphere.position.size()));
}

// Without the second, inflating step the volume would fall by several per cent.
TEST(Smoothing, TakesNoiseOffASphereAndKeepsItsVolume) {
    Mesh mesh = make_shape("sphere", 10000);
    for (size_t v = 0; v < mesh.position.size(); ++v) {
        mesh.position[v] *= 1 + 0.02 * (double(mix_bits(v) >> 11) * 0x1p-52 - 1);
    }
    const double before = roughness(mesh);
    const double volume = reference::survey_surface(mesh).volume;
    smooth_taubin({.rounds = 20}, mesh.triangle, mesh.position);
    EXPECT_LT(roughness(mesh), 0.35 * before);
    EXPECT_NEAR(reference::survey_surface(mesh).volume / volume, 1.0, 0.003);
}

// One step by hand on a pyramid: the apex has four neighbours.
TEST(Smoothing, OneRoundIsAPairOfStepsToTheMeanOfTheNeighbours) {
    const std::vector<Triangle> triangle{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 1}, {1, 3, 2}, {1, 4, 3}};
    std::vector<Vec3d> position{{0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}, {9, 9, 9}};
    smooth_taubin({.rounds = 1, .lambda = 0.5, .mu = 0}, triangle, position);
    EXPECT_NEAR((position[0] - Vec3d(0, 0, 0.5)).norm(), 0, 1e-15);
    // neighbours of vertex 2 are 0, 1 and 3
    EXPECT_NEAR((position[2] - (Vec3d(0, 1, 0) + Vec3d(0, 0, 1.0 / 3)) / 2).norm(), 0, 1e-15);
    EXPECT_EQ(position[5], Vec3d(9, 9, 9));
}

}  // namespace
}  // namespace trocar
