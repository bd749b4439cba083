// Smoke in pictures: optical depths in closed form, and pixels by Beer-Lambert.
#include "engine/draw/smoke.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
namespace trocar {
namespace {

View front_view() {
    View view;
    view.eye = Vec3d(0, -0.3, 0);
    view.forward = {0, 1, 0}, view.right = {1, 0, 0}, view.up = {0, 0, 1};
    view.tan_x = 0.4f, view.tan_y = 0.3f;
    view.near_plane = 0.01f, view.far_plane = 1;
    return view;
}

// The integral of the density along a ray, by the midpoint rule in double. Breaks when a puff dims by its mass instead of the column.
TEST(Smoke, OpticalDepthIsTheIntegralOfTheDensity) {
    const PicturePuff puff{Vec3d::Zero(), 0.01, 2e-4};
    for (const double aside : {0.0, 0.004, 0.015}) {
        for (const double along : {0.2, 0.01, 0.0, -0.02}) {
            double sum = 0;
            constexpr int n = 20000;
            constexpr double far = 0.4;
            for (int i = 0; i < n; ++i) {
                const double s = far * (i + 0.5) / n, r2 = aside * aside + (s - along) * (s - along);
                sum += far / n * puff.extinction * std::exp(-r2 / 2e-4) / std::pow(2 * std::numbers::pi * 1e-4, 1.5);
            }
            EXPECT_NEAR(optical_depth(puff, aside * aside, along), sum, 1e-4 * sum + 1e-9) << aside << " " << along;
        }
    }
}

// On the grid of a picture: the depth of two puffs is the sum of both, where each is; nothing where there is none.
TEST(Smoke, DepthsOfPuffsAddUp) {
    const View view = front_view();
    const std::vector<PicturePuff> puffs{{Vec3d(0.01, 0, 0.02), 0.012, 1e-3}, {Vec3d(-0.02, 0.1, 0), 0.02, 2e-3}};
    std::vector<SmokeVertex> vertex;
    std::vector<uint32_t> index;
    find_smoke(view, puffs, vertex, index);
    ASSERT_FALSE(index.empty());
    double most = 0;
    for (uint32_t r = 0; r < kSmokeRows; ++r) {
        for (uint32_t c = 0; c < kSmokeColumns; ++c) {
            const double x = 0.4 * (2.0 * c / (kSmokeColumns - 1) - 1), z = 0.3 * (2.0 * r / (kSmokeRows - 1) - 1);
            const Vec3d ray = Vec3d(x, 1, z).normalized();
            double sum = 0;
            for (const PicturePuff& puff : puffs) {
                const Vec3d at = puff.position - view.eye;
                const double along = at.dot(ray);
                sum += optical_depth(puff, at.squaredNorm() - along * along, along);
            }
            EXPECT_NEAR(static_cast<double>(vertex[r * kSmokeColumns + c].depth), sum, 3e-3 * sum + 4e-3) << r << " " << c;
            most = std::max(most, sum);
        }
    }
    EXPECT_GT(most, 0.5);
    EXPECT_EQ(vertex[0].depth, 0.0f);
    find_smoke(view, {}, vertex, index);
    EXPECT_TRUE(index.empty());
}

}  // namespace
}  // namespace trocar
