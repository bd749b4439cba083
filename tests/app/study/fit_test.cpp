#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "systems/app/study/curve.hpp"
#include "systems/app/study/least_squares.hpp"
#include "tests/app/run_program.hpp"

namespace trocar {
namespace {

namespace fs = std::filesystem;

// Published two-sided 95 % quantiles.
TEST(Fit, StudentsT) {
    EXPECT_NEAR(students_t(5), 2.570582, 1e-3);
    EXPECT_NEAR(students_t(10), 2.228139, 1e-4);
    EXPECT_NEAR(students_t(30), 2.042272, 1e-5);
    EXPECT_NEAR(students_t(1e9), 1.959964, 1e-6);
}

// y = a exp(-b x) at 21 points.
std::vector<double> decay(double a, double b) {
    std::vector<double> y;
    for (int i = 0; i <= 20; ++i) y.push_back(a * std::exp(-b * 0.1 * i));
    return y;
}
Residuals against(const std::vector<double>& measured) {
    return [&measured](const std::vector<std::vector<double>>& rows) {
        std::vector<std::vector<double>> out;
        for (const auto& p : rows) {
            out.push_back(decay(p[0], p[1]));
            for (size_t i = 0; i < measured.size(); ++i) out.back()[i] -= measured[i];
        }
        return out;
    };
}
const std::vector<FitParameter> kBounds{{"a", 0.1, 1000}, {"b", 0.01, 10}};

TEST(Fit, ExactDataGiveExactParameters) {
    const std::vector<double> y = decay(37, 0.7);
    const Fit fit = fit_least_squares(kBounds, against(y));
    EXPECT_TRUE(fit.converged);
    EXPECT_NEAR(fit.parameter[0].value, 37, 1e-4);
    EXPECT_NEAR(fit.parameter[1].value, 0.7, 1e-5);
    EXPECT_LT(fit.rms, 1e-4);
}

// Of 200 noisy data sets 95 % of the intervals contain the truth: 180 to 199 lie within three standard deviations of 190.
TEST(Fit, IntervalsCoverTheTruthAsOftenAsTheySay) {
    std::mt19937 random(4);
    std::normal_distribution<double> noise(0, 0.5);
    int covered[2] = {0, 0};
    for (int k = 0; k < 200; ++k) {
        std::vector<double> y = decay(37, 0.7);
        for (double& v : y) v += noise(random);
        const Fit fit = fit_least_squares(kBounds, against(y));
        covered[0] += fit.parameter[0].low < 37 && 37 < fit.parameter[0].high;
        covered[1] += fit.parameter[1].low < 0.7 && 0.7 < fit.parameter[1].high;
    }
    for (const int c : covered) {
        EXPECT_GE(c, 180);
        EXPECT_LE(c, 199);
    }
}

TEST(Fit, WhatLiesBeyondABoundIsSaid) {
    const std::vector<double> y = decay(5000, 0.7);
    const Fit fit = fit_least_squares(kBounds, against(y));
    EXPECT_TRUE(fit.parameter[0].at_bound);
    EXPECT_LE(fit.parameter[0].value, 1000 * (1 + 1e-12));
}

class FitCommand : public testing::Test {
 protected:
    void SetUp() override {
        folder_ =
            fs::path(testing::TempDir()) / (std::string("trocar_fit_") + testing::UnitTest::GetInstance()->current_test_info()->name());
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        std::ofstream(folder_ / "poke.toml")
            << "seconds = 0.3\ngravity = [0.0, 0.0, 0.0]\n[contact]\nrate = 240\n[[body]]\nname = \"block\"\nshape = \"sphere\"\nsize = "
               "0.08\n"
               "triangles = 600\nmotion = \"deformable\"\nmodel = \"solid\"\nskin = true\ncells = 6\nfixed_below = -0.02\n[body.tissue]\n"
               "youngs_modulus = 5e3\ndamping = 60.0\n[[body]]\nname = \"probe\"\nshape = \"probe\"\ntriangles = 300\nmotion = \"hand\"\n"
               "[[tool]]\nbody = \"probe\"\npath = [{time = 0.0, position = [0.0, 0.0, 0.048]}, {time = 0.1, position = [0.0, 0.0, "
               "0.037]}, "
               "{time = 0.15, position = [0.0, 0.0, 0.041]}, {time = 0.25, position = [0.0, 0.0, 0.035]}]\n";
    }
    void TearDown() override { fs::remove_all(folder_); }
    Outcome run(const std::string& arguments) const { return run_program(arguments, folder_, folder_); }
    // The curve of the scene with other tissue.
    void measure(bool by_depth) const {
        const SceneFile scene =
            read_scene_file(folder_ / "poke.toml", {{"block.tissue.youngs_modulus", "9e3"}, {"block.tissue.damping", "95"}});
        const ForceCurve curve = simulate_curve(scene, "probe", by_depth, 0.25);
        std::ofstream file(folder_ / "curve.csv");
        file.precision(12);
        file << (by_depth ? "depth_m" : "time_s") << ",force_n\n";
        for (size_t i = 0; i < curve.at.size(); ++i) file << curve.at[i] << "," << curve.force[i] << "\n";
    }
    fs::path folder_;
};

TEST_F(FitCommand, FindsModulusAndDampingOfAMadeCurve) {
    measure(false);
    const std::string command =
        "fit poke.toml --curve curve.csv --parameter block.tissue.youngs_modulus=1e3..1e5 --parameter block.tissue.damping=5..500 --out "
        "out --json";
    const Outcome outcome = run(command);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const auto j = nlohmann::json::parse(outcome.out);
    EXPECT_NEAR(j["parameters"][0]["value"].get<double>(), 9e3, 0.01 * 9e3);
    EXPECT_NEAR(j["parameters"][1]["value"].get<double>(), 95, 0.01 * 95);
    EXPECT_GT(j["runs"].get<int>(), 10);
    // every run was kept: the same command needs none, and one that was cut off in its last line only that
    auto again = nlohmann::json::parse(run(command).out);
    EXPECT_EQ(again["runs"], 0);
    EXPECT_EQ(again["parameters"], j["parameters"]);
    fs::resize_file(folder_ / "out/trials.jsonl", fs::file_size(folder_ / "out/trials.jsonl") - 20);
    again = nlohmann::json::parse(run(command).out);
    EXPECT_EQ(again["runs"], 1);
    EXPECT_EQ(again["parameters"], j["parameters"]);
}

TEST_F(FitCommand, TakesDepthAndRefusesWhatIsNoCurve) {
    measure(true);
    const std::string fit = "fit poke.toml --curve curve.csv --parameter block.tissue.youngs_modulus=1e3..1e5";
    const Outcome outcome = run(fit + " --set block.tissue.damping=95 --json");
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_NEAR(nlohmann::json::parse(outcome.out)["parameters"][0]["value"].get<double>(), 9e3, 0.01 * 9e3);
    const auto refused = [&](const std::string& curve, const std::string& why) {
        std::ofstream(folder_ / "curve.csv") << curve;
        const Outcome o = run(fit);
        EXPECT_EQ(o.code, 2);
        EXPECT_NE(o.err.find(why), std::string::npos) << o.err;
    };
    refused("depth,force_n\n0,1\n1,2\n", "curve.csv:1: a curve has the column force_n and one of time_s and depth_m");
    refused("time_s,force_n\n0.1,1\n0.1,2\n", "curve.csv:3: time_s must ascend");
    refused("depth_m,force_n\n0.001,1\n0.5,2\n0.6,2\n", "the run reaches depths (m)");
    EXPECT_NE(run("fit poke.toml --curve curve.csv --parameter block.tissue.youngs_modulus=5").err.find("write KEY=LOW..HIGH"),
              std::string::npos);
    EXPECT_NE(run("fit poke.toml --curve curve.csv --parameter block.tissue.softness=1..2").err.find("softness"), std::string::npos);
}

}  // namespace
}  // namespace trocar
