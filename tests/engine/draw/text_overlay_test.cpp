#include "engine/draw/text_overlay.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/draw/depth_colours.hpp"

namespace trocar {
namespace {

Image black(uint32_t width, uint32_t height) { return {width, height, std::vector<uint8_t>(size_t{4} * width * height, 0)}; }

uint32_t ink(const Image& image) {
    uint32_t sum = 0;
    for (size_t i = 0; i < image.rgba.size(); i += 4) sum += image.rgba[i];
    return sum;
}

// an I is a column of seven pixels with two bars of three: 11 pixels of ink at scale 1, 4 times as many at scale 2
TEST(TextOverlay, DrawsGlyphsAtScale) {
    Image one = black(5, 7), two = black(10, 14);
    draw_text(one, 0, 0, 1, {}, "I");
    EXPECT_NEAR(ink(one), 11u * 255, 2 * 255);
    EXPECT_EQ(one.rgba[4 * (3 * 5 + 2)], 255);  // middle of the column
    EXPECT_EQ(one.rgba[4 * (3 * 5 + 0)], 0);
    draw_text(two, 0, 0, 2, {}, "I");
    EXPECT_NEAR(ink(two), 44u * 255, 8 * 255);  // corners are rounded
}

TEST(TextOverlay, HasTheCharactersItIsUsedFor) {
    Image question = black(5, 7);
    draw_text(question, 0, 0, 1, {}, "?");
    for (const char c : std::string_view("0123456789.,:-+/%()=abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ")) {
        Image image = black(5, 7);
        draw_text(image, 0, 0, 1, {}, std::string_view(&c, 1));
        EXPECT_GT(ink(image), 0u) << c;
        EXPECT_NE(image.rgba, question.rgba) << c;
    }
    Image unknown = black(5, 7);
    draw_text(unknown, 0, 0, 1, {}, "\x01");
    EXPECT_EQ(unknown.rgba, question.rgba);
}

// a p is an o with a stem that extends below the line; capitals and digits stay above it
TEST(TextOverlay, HangsDescendersBelowTheLine) {
    for (const char c : std::string_view("gjpqyaAx0(")) {
        Image image = black(5, 9);
        draw_text(image, 0, 0, 1, {}, std::string_view(&c, 1));
        uint32_t below = 0;
        for (size_t i = size_t{4} * 5 * 7; i < image.rgba.size(); i += 4) below += image.rgba[i];
        EXPECT_EQ(below > 0, std::string_view("gjpqy").find(c) != std::string_view::npos) << c;
    }
}

TEST(TextOverlay, CutsOffWhatLiesOutside) {
    Image image = black(20, 10);
    for (const int32_t x : {-1000, -7, 18, 1000})
        for (const int32_t y : {-1000, -3, 8, 1000}) {
            draw_text(image, x, y, 3, {}, "depth");
            draw_panel(image, x, y, 40, 30, 4, {255, 0, 0, 100});
        }
    EXPECT_EQ(image.rgba.size(), 800u);
}

TEST(TextOverlay, PanelsBlendByOpacity) {
    Image image = black(4, 4);
    draw_panel(image, 0, 0, 2, 4, 0, {200, 100, 0, 51});
    EXPECT_EQ(image.rgba[0], 40);
    EXPECT_EQ(image.rgba[1], 20);
    EXPECT_EQ(image.rgba[4 * 2], 0);
}

// perceptual: lightness (CIE L* of the luminance) falls in nearly equal steps
TEST(DepthColours, DarkenEvenly) {
    const auto lightness = [](double t) {
        const auto c = depth_colour(t);
        return 116 * std::cbrt(0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]) - 16;
    };
    const double mean = (lightness(0) - lightness(1)) / 20;
    EXPECT_GT(mean, 2.5);
    for (int i = 0; i < 20; ++i) {
        const double step = lightness(i / 20.0) - lightness((i + 1) / 20.0);
        EXPECT_GT(step, 0.4 * mean) << i;
        EXPECT_LT(step, 1.6 * mean) << i;
    }
    EXPECT_EQ(depth_colour(-3), depth_colour(0));
    EXPECT_EQ(depth_colour(7), depth_colour(1));
    EXPECT_EQ(depth_colour(std::nan("")), depth_colour(0));
}

// values of the standard
TEST(DepthColours, EncodeAsSrgb) {
    EXPECT_EQ(srgb_byte(0), 0);
    EXPECT_EQ(srgb_byte(1), 255);
    EXPECT_EQ(srgb_byte(0.212231), 127);
    EXPECT_EQ(srgb_byte(0.215861), 128);
    EXPECT_EQ(srgb_byte(0.0031308), 10);
    EXPECT_EQ(srgb_byte(2), 255);
}

}  // namespace
}  // namespace trocar
