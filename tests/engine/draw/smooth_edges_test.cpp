#include "engine/draw/smooth_edges.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace trocar {
namespace {

// Half plane a x + b y < c, white on black; sub x sub samples per pixel.
Image half_plane(uint32_t size, double a, double b, double c, int sub) {
    Image image{size, size, std::vector<uint8_t>(size_t{4} * size * size, 255)};
    for (uint32_t y = 0; y < size; ++y)
        for (uint32_t x = 0; x < size; ++x) {
            int inside = 0;
            for (int i = 0; i < sub * sub; ++i) {
                const double px = x + (i % sub + 0.5) / sub, py = y + (i / sub + 0.5) / sub;
                inside += a * px + b * py < c;
            }
            const uint8_t level = static_cast<uint8_t>(std::lround(255.0 * inside / (sub * sub)));
            std::fill_n(&image.rgba[4 * (size_t{y} * size + x)], 3, level);
        }
    return image;
}

double mean_error(const Image& a, const Image& b) {
    double sum = 0;
    for (uint32_t y = 4; y + 4 < a.height; ++y)  // ends of the picture aside
        for (uint32_t x = 4; x + 4 < a.width; ++x) {
            const size_t i = 4 * (size_t{y} * a.width + x);
            sum += std::abs(int{a.rgba[i]} - int{b.rgba[i]});
        }
    return sum / (a.width * a.height);
}

// oracle: the fraction of each pixel that the half plane covers, by 16 x 16 samples. Shallow edges, whose
// jags are long and visible, must lose most of their error; steep ones some
TEST(SmoothEdges, BringsStraightEdgesNearTheirExactCoverage) {
    SmoothEdgesScratch scratch;
    for (const double slope : {0.07, 0.15, 0.3, 0.5, 0.8})
        for (const int turn : {0, 1, 2, 3}) {
            const double a = turn & 1 ? 1 : slope, b = turn & 1 ? slope : 1, sign = turn & 2 ? -1 : 1;
            const double c = sign * 0.5 * 96 * (a + b) + 0.3;
            Image jagged = half_plane(96, sign * a, sign * b, c, 1);
            const Image exact = half_plane(96, a * sign, b * sign, c, 16);
            const double before = mean_error(jagged, exact);
            smooth_edges(scratch, jagged);
            EXPECT_LT(mean_error(jagged, exact), (slope < 0.4 ? 0.4 : 0.7) * before) << slope << " turn " << turn;
        }
}

TEST(SmoothEdges, LeavesFlatPicturesAndAxisAlignedEdgesAlone) {
    SmoothEdgesScratch scratch;
    for (const auto& [a, b, c] : {std::array{0.0, 0.0, 1.0}, {1.0, 0.0, 48.0}, {0.0, 1.0, 48.0}}) {
        Image image = half_plane(96, a, b, c, 1);
        const Image before = image;
        smooth_edges(scratch, image);
        EXPECT_EQ(image.rgba, before.rgba);
    }
}

TEST(SmoothEdges, TakesPicturesOfAnySize) {
    SmoothEdgesScratch scratch;
    for (const uint32_t size : {0u, 1u, 2u, 3u, 4u, 17u}) {
        Image image = half_plane(size, 0.4, 1, 0.5 * size, 1);
        smooth_edges(scratch, image);
        EXPECT_EQ(image.rgba.size(), size_t{4} * size * size);
    }
}

}  // namespace
}  // namespace trocar
