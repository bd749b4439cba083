#include "content/scene/plausibility.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "content/scene/build_scene.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> warnings_of(const std::string& text) {
    return build_scene(read_scene_text(text, fs::path(testing::TempDir()) / "plausible.toml", {}), Looks::kPlain).warnings;
}

std::string liver(const std::string& keys, const std::string& tissue = "youngs_modulus = 5e3") {
    return "[[body]]\nname = \"liver\"\nshape = \"liver\"\ntriangles = 500\nmotion = \"deformable\"\n" + keys + "\n[body.tissue]\n" +
           tissue + "\n";
}

std::string probe(const std::string& place) {
    return "[[body]]\nname = \"probe\"\nshape = \"probe\"\ntriangles = 300\nmotion = \"hand\"\nposition = " + place +
           "\n[[tool]]\nbody = \"probe\"\ntip_radius = 0.0065\npath = [{time = 0.0, position = " + place + "}]\n";
}

TEST(Plausibility, SoundScenesAreNotDoubted) {
    EXPECT_EQ(warnings_of(liver("fixed_below = -0.03") + probe("[0.02, 0.0, 0.09]")), std::vector<std::string>{});
}

TEST(Plausibility, WhatIsProbablyNotMeantIsNamed) {
    const auto only = [](const std::string& text, const std::string& expected) {
        const auto warnings = warnings_of(text);
        ASSERT_EQ(warnings.size(), 1u) << text;
        EXPECT_NE(warnings[0].find(expected), std::string::npos) << warnings[0];
    };
    only("seconds = 1.0\n", "no [[body]]");
    only(liver("fixed_below = -30.0"), "fixes nothing: its lowest point is at -0.0");
    only(liver("fixed_below = 30.0"), "fixes all of it");
    only(liver("", "youngs_modulus = 410.0"), "410 Pa is softer than any organ");
    only(liver("") + probe("[0.02, 0.0, 9.0]"), "the tool \"probe\" stays 8.9");
}

// A liver in millimetres whose scale was forgotten, and one scaled twice.
TEST(Plausibility, FilesOfAnotherUnit) {
    const fs::path file = fs::path(testing::TempDir()) / "plausible_cube.obj";
    std::ofstream(file) << "v 0 0 0\nv 200 0 0\nv 0 200 0\nv 0 0 200\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    const auto scaled = [&](const char* scale) {
        return warnings_of(std::string("[[body]]\nname = \"cube\"\nfile = \"") + file.string() + "\"\nscale = " + scale + "\n");
    };
    EXPECT_EQ(scaled("0.001").size(), 0u);
    ASSERT_EQ(scaled("1.0").size(), 1u);
    EXPECT_NE(scaled("1.0")[0].find("body \"cube\" is 200 m large"), std::string::npos);
    ASSERT_EQ(scaled("1e-6").size(), 1u);
    fs::remove(file);
}

}  // namespace
}  // namespace trocar
