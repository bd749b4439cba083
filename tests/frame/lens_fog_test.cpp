// A laparoscope in a whole scene: its lens fogs as the vapour of the cavity condenses, is wiped on tissue, and costs nothing elsewhere.
#include <gtest/gtest.h>

#include <cmath>

#include "frame/written_scene.hpp"
#include "systems/prepare/lens_fog.hpp"
namespace trocar {
namespace {

std::string scope_scene(const std::string& fog) {
    return R"(
gravity = [0.0, 0.0, 0.0]
[camera]
kind = "laparoscope"
follow = "scope"
position = [0.0, 0.0, 0.002]
optic_deg = 30.0
)" + fog + R"(
[[body]]
name = "liver"
shape = "sphere"
size = 0.06
triangles = 400
motion = "deformable"
anchor = "world"
[body.tissue]
youngs_modulus = 5e3
density = 1000.0
damping = 40.0
[[body]]
name = "scope"
shape = "sphere"
size = 0.004
triangles = 100
motion = "kinematic"
apart = "liver"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.06]
[[body.path]]
time = 1.0
position = [0.0, 0.0, 0.06]
[[body.path]]
time = 1.5
position = [0.0, 0.0, 0.0285]
[[body.path]]
time = 2.0
position = [0.0, 0.0, 0.06]
)";
}

// kg/m^3, of saturated vapour, by tables (Wexler 1976 with the ideal gas law). Within what the formula promises.
TEST(LensFog, VapourIsThatOfTables) {
    for (const auto& [celsius, gram] : {std::pair{0.0, 4.85}, {10.0, 9.40}, {20.0, 17.3}, {30.0, 30.4}, {37.0, 43.9}, {40.0, 51.1}})
        EXPECT_NEAR(1e3 * saturated_vapour(celsius), gram, 0.005 * gram) << celsius;
}

// The film against an integration of the same law in steps of a tenth of a millisecond; it grows, is wiped at the tissue, and grows
// again from nothing. Breaks with the sign, the time constant or the density of water.
TEST(LensFog, FilmGrowsByTheLawAndIsWiped) {
    const WrittenScene scene("fog", scope_scene("[camera.fog]\nlens = 12.0\ncavity = 37.0\nhumidity = 0.9\ntime_constant = 4.0\nwipe = 1e-3\n"));
    double film = 0, at_start = 0;
    bool wiped = false;
    run(scene.build().world, 150, [&](Frame& frame, int pass) {
        const Lens& lens = frame.world().lenses.lens[0];
        const auto grown = [](double from, double to) {
            double sum = 0;
            const double h = 1e-4;
            for (double t = from + 0.5 * h; t < to; t += h)
                sum += h * 8e-3 * (0.9 * saturated_vapour(37) - saturated_vapour(37 + (12 - 37.0) * std::exp(-t / 4))) / 1000;
            return sum;
        };
        const double now = (pass + 1) / 60.0;
        if (lens.touching) {
            wiped = true, at_start = now;
            EXPECT_EQ(lens.film, 0.0);
        }
        if (pass == 50) {
            film = lens.film;
            EXPECT_NEAR(film, grown(0, now), 2e-4 * film);
        }
        if (pass != 149) return;
        EXPECT_NEAR(lens.film, grown(at_start, now), 1e-3 * lens.film);
        EXPECT_NEAR(lens.temperature, 37 - 25 * std::exp(-now / 4), 1e-9);
        EXPECT_EQ(lens.wipes, 1u);
        PictureSnapshot picture = frame.snapshot_now();
        EXPECT_NEAR(picture.fog, 1 - std::pow(0.5, lens.film / 1.4e-6), 1e-12);
        EXPECT_EQ(find_fault(frame.world()), "");
    });
    EXPECT_TRUE(wiped);
    EXPECT_GT(film, 1e-8);
    // warmer than the dew point it stays clear, and a film goes
    World warm = std::move(WrittenScene("warm", scope_scene("[camera.fog]\nlens = 38.0\nhumidity = 0.9\n")).build().world);
    warm.lenses.lens[0].film = 1e-8;
    run(std::move(warm), 60, [&](Frame& frame, int pass) {
        if (pass == 0) {
            EXPECT_LT(frame.world().lenses.lens[0].film, 1e-8);
        }
        if (pass == 59) {
            EXPECT_EQ(frame.world().lenses.lens[0].film, 0.0);
        }
    });
}

TEST(LensFog, SameBitsForThreadsAndNoCostWithout) {
    const WrittenScene fogs("fog_bits", scope_scene("[camera.fog]\n"));
    expect_same_bits(fogs, 30, [](const Frame& frame) { EXPECT_GT(frame.world().lenses.lens[0].film, 0.0); });
    const WrittenScene clear("no_fog", scope_scene(""));
    run(clear.build().world, 1, [&](Frame& frame, int) {
        const auto names = frame.stage_names();
        EXPECT_EQ(std::count(names.begin(), names.end(), "lens fog"), 0);
    });
    EXPECT_EQ(clear.build().camera.body, 1u);
}

TEST(LensFog, WhatIsNoLaparoscopeIsRefused) {
    const auto error = [](const std::string& from, const std::string& to) {
        std::string text = scope_scene("");
        text.replace(text.find(from), from.size(), to);
        return WrittenScene("refused_scope", text).error();
    };
    EXPECT_EQ(error("optic_deg = 30.0", "optic_deg = 45.0"), "");
    EXPECT_NE(error("follow = \"scope\"", "follow = \"skope\"").find("no body is named"), std::string::npos);
    EXPECT_NE(error("follow = \"scope\"", "follow = \"liver\"").find("must be rigid"), std::string::npos);
    EXPECT_NE(error("kind = \"laparoscope\"", "kind = \"orbit\"").find("laparoscope"), std::string::npos);
    EXPECT_NE(error("optic_deg = 30.0", "up = [0.0, 0.0, 1.0]").find("up"), std::string::npos);
    EXPECT_NE(error("optic_deg = 30.0", "optic_deg = 100.0").find("optic_deg"), std::string::npos);
}

}  // namespace
}  // namespace trocar
