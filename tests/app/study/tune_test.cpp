#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/app/run_program.hpp"

namespace trocar {
namespace {

namespace fs = std::filesystem;

// trocar tune on two small organs that part.
class TuneCommand : public testing::Test {
 protected:
    void SetUp() override {
        folder_ =
            fs::path(testing::TempDir()) / (std::string("trocar_tune_") + testing::UnitTest::GetInstance()->current_test_info()->name());
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        std::ofstream(folder_ / "pair.toml")
            << "# a comment\nseconds = 0.2\ngravity = [0.0, 0.0, 0.0]\n[contact]\nrate = 240 # Hz\n[[body]]\nname = \"a\"\nshape = "
               "\"sphere\"\nsize = 0.06\n"
               "triangles = 200\nmotion = \"deformable\"\n[[body]]\nname = \"b\"\nshape = \"sphere\"\nsize = 0.06\ntriangles = 200\n"
               "motion = \"deformable\"\nposition = [0.05, 0.004, 0.001]\n";
    }
    void TearDown() override { fs::remove_all(folder_); }
    trocar::Outcome run(const std::string& arguments) const { return run_program(arguments, folder_, folder_); }
    fs::path folder_;
};

TEST_F(TuneCommand, ChoosesWhatKeepsBothLimitsAndGoesOn) {
    const std::string command = "tune pair.toml --budget-ms 1000 --error-mm 0.5 --trials trials.jsonl --out tuned.toml --json";
    const trocar::Outcome outcome = run(command);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const auto j = nlohmann::json::parse(outcome.out);
    EXPECT_TRUE(j["keeps_limits"]);
    EXPECT_LE(j["chosen"]["rms_mm"].get<double>(), 0.5);
    EXPECT_GT(j["chosen"]["rms_mm"].get<double>(), 0);
    EXPECT_GT(j["runs"].get<int>(), 10);
    // the front: dearer choices are more accurate
    double before = 1e9, dearest = 0;
    for (const auto& t : j["front"]) {
        EXPECT_LT(t["rms_mm"].get<double>(), before);
        EXPECT_GE(t["ms_per_frame"].get<double>(), dearest);
        before = t["rms_mm"], dearest = t["ms_per_frame"];
    }
    // nothing on the front that keeps the error is cheaper by more than the noise of times
    for (const auto& t : j["front"]) {
        if (t["rms_mm"].get<double>() > 0.5) continue;
        EXPECT_GE(t["ms_per_frame"].get<double>(), 0.96 * j["chosen"]["ms_per_frame"].get<double>());
    }
    const auto again = nlohmann::json::parse(run(command).out);
    EXPECT_EQ(again["runs"], 0);
    EXPECT_EQ(again["chosen"], j["chosen"]);
    // the scene that was written is the one that was chosen
    std::string sets;
    for (const auto& [key, value] : j["chosen"]["set"].items()) sets += " --set " + key + "=" + value.get<std::string>();
    const auto hash = [&](const std::string& scene) {
        return nlohmann::json::parse(run("run " + scene + " --no-render --json").out)["state_hash"];
    };
    EXPECT_EQ(hash("tuned.toml"), hash("pair.toml" + sets));
}

TEST_F(TuneCommand, SaysWhenNothingKeepsTheLimits) {
    const trocar::Outcome outcome = run("tune pair.toml --budget-ms 1e-6 --error-mm 1e-9 --seconds 0.05 --json");
    EXPECT_EQ(outcome.code, 1) << outcome.err;
    EXPECT_FALSE(nlohmann::json::parse(outcome.out)["keeps_limits"]);
    EXPECT_EQ(run("tune pair.toml --error-mm 0").code, 2);
}

}  // namespace
}  // namespace trocar
