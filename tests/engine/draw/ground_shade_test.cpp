#include "engine/draw/ground_shade.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace trocar {
namespace {

// The formula of the header, in double.
double light_past(const GroundShadow& s, double x, double y) {
    const double dx = x - double{s.x}, dy = y - double{s.y};
    const double q = double{s.xx} * dx * dx + 2 * double{s.xy} * dx * dy + double{s.yy} * dy * dy;
    return 1 - double{s.darkness} / double{kDarkest} * std::pow(std::max(1 - q / 6.25, 0.0), 3);
}

double darkness_at(const std::vector<GroundShadow>& shadows, double x, double y) {
    double light = 1;
    for (const GroundShadow& s : shadows) light *= light_past(s, x, y);
    return double{kDarkest} * (1 - light);
}

GroundShadow ellipse(double x, double y, double along, double across, double angle, double darkness) {
    const double c = std::cos(angle), s = std::sin(angle), a = 1 / (along * along), b = 1 / (across * across);
    const auto f = [](double d) { return static_cast<float>(d); };
    return {f(x), f(y), f(a * c * c + b * s * s), f((a - b) * c * s), f(a * s * s + b * c * c), f(darkness)};
}

double worst_error(const std::vector<GroundShadow>& shadows, const GroundShade& shade) {
    double worst = 0;
    for (uint32_t row = 0; row < shade.rows; ++row)
        for (uint32_t column = 0; column < shade.columns; ++column) {
            const double x = shade.x + (column + 0.5) * shade.cell, y = shade.y + (row + 0.5) * shade.cell;
            worst = std::max(worst, std::abs(shade.darkness[size_t{row} * shade.columns + column] - darkness_at(shadows, x, y)));
        }
    return worst;
}

// Breaks when an ellipse is rotated in the wrong direction, clipped too early or combined by another rule.
TEST(GroundShade, CellsHaveTheProductOfAllShadows) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> u(0, 1);
    std::vector<GroundShadow> shadows;
    for (int i = 0; i < 40; ++i)
        shadows.push_back(
            ellipse(2 * u(random) - 1, u(random), 0.05 + 0.3 * u(random), 0.05 + 0.1 * u(random), 3 * u(random), 0.8 * u(random)));
    GroundShade shade;
    make_ground_shade(shadows, 10, shade);
    EXPECT_GT(shade.columns, 100u);
    EXPECT_LT(worst_error(shadows, shade), 1e-5);
}

// Breaks when a shadow extends beyond the rectangle, or when it has too few cells.
TEST(GroundShade, RectangleHoldsAShadowInTwelveCellsAcross) {
    const std::vector<GroundShadow> shadows = {ellipse(0.3, -0.2, 0.4, 0.1, 0.5, 0.6)};
    GroundShade shade;
    make_ground_shade(shadows, 10, shade);
    EXPECT_NEAR(shade.cell, 2.5 * 0.1 / 6, 1e-6);
    for (int i = 0; i < 360; ++i) {
        const double a = i * 3.14159265 / 180, x = 0.3 + 3 * std::cos(a), y = -0.2 + 3 * std::sin(a);
        const bool inside = x > shade.x && y > shade.y && x < shade.x + shade.cell * shade.columns && y < shade.y + shade.cell * shade.rows;
        EXPECT_TRUE(inside || darkness_at(shadows, x, y) == 0);
    }
    for (uint32_t column = 0; column < shade.columns; ++column) EXPECT_LT(shade.darkness[column], 0.01);
}

// Breaks when a crowd's shadows add up to black.
TEST(GroundShade, ManyShadowsLeaveSomeLight) {
    const std::vector<GroundShadow> shadows(1000, ellipse(0, 0, 1, 1, 0, 0.5));
    GroundShade shade;
    make_ground_shade(shadows, 10, shade);
    for (const float d : shade.darkness) EXPECT_LE(d, kDarkest);
    EXPECT_NEAR(*std::max_element(shade.darkness.begin(), shade.darkness.end()), kDarkest, 1e-6);
}

// Breaks when a runaway body makes the table huge, or NaN spreads.
TEST(GroundShade, WhatIsFarOrNoNumberIsLeftOut) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const std::vector<GroundShadow> bad = {ellipse(nan, 0, 1, 1, 0, 0.5), ellipse(0, 0, nan, 1, 0, 0.5),     {0, 0, 0, 0, 0, 0.5f},
                                           ellipse(0, 0, 1, 1, 0, nan),   ellipse(0, 0, 1e30, 1e30, 0, 0.5), ellipse(1e9, 0, 1, 1, 0, 0.5)};
    GroundShade shade;
    make_ground_shade(bad, 3, shade);
    EXPECT_EQ(shade.columns, 0u);
    std::vector<GroundShadow> mixed = bad;
    mixed.push_back(ellipse(2.9, 0, 1e-4, 1, 0, 0.5));
    make_ground_shade(mixed, 3, shade);
    ASSERT_GT(shade.columns, 0u);
    EXPECT_LE(shade.columns, 385u);
    EXPECT_LE(shade.rows, 385u);
    EXPECT_LE(shade.x + shade.cell * shade.columns, 3 + shade.cell);
    for (const float d : shade.darkness) EXPECT_TRUE(std::isfinite(d));
    make_ground_shade({}, 3, shade);
    EXPECT_EQ(shade.columns, 0u);
}

}  // namespace
}  // namespace trocar
