#include "systems/app/commands/soak.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/app/run_program.hpp"
namespace trocar {
namespace {

// The address sanitizer's malloc reports no statistics.
#if defined(__SANITIZE_ADDRESS__)
constexpr bool kHeapIsCounted = false;
#else
constexpr bool kHeapIsCounted = true;
#endif

TEST(Drift, OfALineIsItsSlopeWhateverFewOutliersSay) {
    std::vector<double> x, y;
    for (int i = 0; i < 101; ++i) x.push_back(0.1 * i), y.push_back(2.5 * x.back() - 4);
    EXPECT_NEAR(theil_sen(x, y).slope, 2.5, 1e-12);
    for (int i = 0; i < 101; i += 10) y[i] = 1e6;  // a tenth of the points are outliers
    EXPECT_NEAR(theil_sen(x, y).slope, 2.5, 1e-12);
    EXPECT_FALSE(theil_sen(std::span(x).first(7), std::span(y).first(7)).known);
}

// Breaks when the interval is too narrow (false alarms) or so wide that it detects nothing.
TEST(Drift, IntervalHoldsTheTrueSlopeNineteenTimesInTwenty) {
    std::mt19937 random(7);
    std::normal_distribution<double> noise(0, 1);
    int held = 0, sees = 0;
    constexpr int kRuns = 400;
    for (int run = 0; run < kRuns; ++run) {
        std::vector<double> x, y;
        for (int i = 0; i < 60; ++i) x.push_back(i), y.push_back(0.1 * i + noise(random));
        const Drift d = theil_sen(x, y);
        held += d.low <= 0.1 && d.high >= 0.1;
        sees += d.low > 0;
    }
    EXPECT_GE(held, kRuns * 0.92);
    EXPECT_LE(held, kRuns * 0.985);
    EXPECT_EQ(sees, kRuns);
}

Soak quiet_soak() {
    Soak soak;
    soak.minutes = 10;
    std::mt19937 random(1);
    for (int i = 0; i < 200; ++i) {
        Episode e;
        e.minute = 0.05 * i, e.resident = 60 + 0.01 * static_cast<double>(random() % 100), e.heap = 6,
        e.median_ms = 1 + 0.001 * static_cast<double>(random() % 100);
        e.hash = 5, e.descriptors = 6, e.passes = 100, e.energy_share = 0.001;
        soak.episode.push_back(e);
    }
    return soak;
}
std::string verdict(Soak soak) {
    for (const Episode& e : soak.episode) judge_episode(e, soak.episode.front(), soak);
    judge_drifts(measure_drifts(soak), soak);
    return soak.broken.substr(0, soak.broken.find(':'));
}

TEST(Soak, S07_EveryRuleBreaksByItsName) {
    EXPECT_EQ(verdict(quiet_soak()), "");
    Soak soak = quiet_soak();
    for (Episode& e : soak.episode) e.resident += 0.5 * e.minute;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    EXPECT_EQ(verdict(soak), "") << "sanitizers keep freed memory";
    return;
#endif
    EXPECT_EQ(verdict(soak), "memory");
    soak = quiet_soak();
    for (Episode& e : soak.episode) e.heap += 0.1 * e.minute;
    EXPECT_EQ(verdict(soak), "heap");
    soak = quiet_soak();
    soak.episode.back().descriptors = 7;
    EXPECT_EQ(verdict(soak), "descriptors");
    soak = quiet_soak();
    for (Episode& e : soak.episode) e.median_ms += 0.1 * e.minute;
    EXPECT_EQ(verdict(soak), "time");
    soak = quiet_soak();
    soak.episode[90].hash = 6;
    EXPECT_EQ(verdict(soak), "hash");
    soak = quiet_soak();
    soak.episode[90].energy_share = 0.03;
    EXPECT_EQ(verdict(soak), "energy");
    soak = quiet_soak();
    soak.episode[90].lost = 1;
    EXPECT_EQ(verdict(soak), "particles");
    soak.episode[90].with_fault = true;
    EXPECT_EQ(verdict(soak), "") << "particles that a fault loses are no news";
    soak.episode[90].of_device = true;
    EXPECT_EQ(verdict(soak), "particles") << "but no device may lose any";
    soak = quiet_soak();
    soak.episode[90].with_fault = soak.episode[90].of_device = true, soak.episode[90].hash = 6;
    EXPECT_EQ(verdict(soak), "") << "another hand, another end";
    soak.episode[90].over_force = 0.1;
    EXPECT_EQ(verdict(soak), "force");
}

TEST(Soak, MemoryOfTheWarmUpIsNotHeldAgainstIt) {
    Soak soak = quiet_soak();
    for (Episode& e : soak.episode) e.resident -= 30 * std::max(0.0, 0.9 - e.minute);
    EXPECT_EQ(verdict(soak), "");
}

TEST(SoakCommand, S01_FaultsAreSurvivedAndEveryEpisodeEndsTheSame) {
    const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "trocar_soak";
    std::filesystem::create_directories(folder);
    const Outcome outcome = run_program(
        "soak probe_on_liver --minutes 0.03 --seconds 0.5 --set liver.triangles=600 --faults nan,blast --out out --json", folder, folder);
    EXPECT_EQ(outcome.code, 0) << outcome.out << outcome.err;
    const nlohmann::json json = nlohmann::json::parse(outcome.out);
    EXPECT_TRUE(json["sound"]);
    EXPECT_GT(json["faults_injected"], 0);
    EXPECT_EQ(json["not_judged"], nlohmann::json::array());
    EXPECT_GT(json["particles_restored"], 0);
    EXPECT_TRUE(std::filesystem::exists(folder / "out/soak.html"));
    EXPECT_EQ(run_program("soak probe_on_liver --faults rust", folder, folder).code, 2);
}

// A hand that stands still and is elsewhere then, and one that jumps by what it does in a quarter of a second, both on random ways.
TEST(SoakCommand, DevicesThatFailHarmNoHandAndNoTissue) {
    const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "trocar_soak_devices";
    std::filesystem::create_directories(folder);
    const Outcome outcome = run_program(
        "soak probe_on_liver --minutes 0.05 --seconds 2 --set liver.triangles=600 --set probe.triangles=300 --faults dropout,jump --hands "
        "3 "
        "--out out --json",
        folder, folder);
    EXPECT_EQ(outcome.code, 0) << outcome.out << outcome.err;
    const nlohmann::json json = nlohmann::json::parse(outcome.out);
    EXPECT_TRUE(json["sound"]);
    EXPECT_GE(json["faults_injected"], 2);
    EXPECT_EQ(json["particles_restored"], 0);
}

// Faults are injected one after the other: a soak that ended early has not tried the later ones. Breaks when
// the first stands for all, or when time outside of passes is not reported.
TEST(Soak, FaultsNotTriedAreNamed) {
    Soak soak = quiet_soak();
    soak.faults_wanted = {"nan", "blast", "pause"};
    soak.faults = 1;
    EXPECT_EQ(not_judged(soak, measure_drifts(soak)), (std::vector<std::string>{"fault blast", "fault pause"}));
    soak.faults = 4;
    EXPECT_TRUE(not_judged(soak, measure_drifts(soak)).empty());
}

// Breaks when the last line is printed twice: at its minute and at the end.
TEST(SoakCommand, TheEndIsToldOnceWithTimeOutsidePassesAndMemory) {
    const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "trocar_told_soak";
    std::filesystem::create_directories(folder);
    const std::string soak = "soak probe_on_liver --minutes 0.01 --seconds 0.1 --set liver.triangles=600";
    const nlohmann::json json = nlohmann::json::parse(run_program(soak + " --threads 1 --json", folder, folder).out);
    EXPECT_EQ(json["threads"], 1);
    EXPECT_GT(json["resident_mib_end"], 1.0);
    if (kHeapIsCounted) {
        EXPECT_GT(json["heap_mib_end"], 0.5);
    }
    EXPECT_GT(json["minutes_in_passes"], 0.0);
    EXPECT_LE(json["minutes_in_passes"], json["minutes"]);
    const std::string text = run_program(soak, folder, folder).out;
    EXPECT_EQ(text.find(" min "), text.rfind(" min ")) << text;
    EXPECT_NE(text.find("minutes was spent in passes"), std::string::npos) << text;
}

// In lockstep a pause between two passes changes nothing: such an episode must end like all others. Breaks
// when these episodes are exempt from that comparison.
TEST(SoakCommand, APauseIsJudgedLikeAnyEpisode) {
    const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "trocar_pause_soak";
    std::filesystem::create_directories(folder);
    const Outcome outcome = run_program(
        "soak probe_on_liver --minutes 0.02 --seconds 0.1 --set liver.triangles=600 --faults pause --out out --json", folder, folder);
    EXPECT_EQ(outcome.code, 0) << outcome.out << outcome.err;
    const nlohmann::json json = nlohmann::json::parse(outcome.out);
    EXPECT_GT(json["faults_injected"], 0);
    EXPECT_TRUE(json.contains("median_p99_pass_ms"));
    std::ifstream table(folder / "out/soak.csv");
    size_t rows = 0;
    std::string line;
    for (std::getline(table, line); std::getline(table, line); ++rows) {
        const size_t hash = line.rfind(','), flag = line.rfind(',', hash - 1);
        EXPECT_EQ(line.substr(flag + 1, hash - flag - 1), "0") << line;
    }
    EXPECT_GE(rows, 3u);
}

// One episode shows neither drift nor that the next ends the same, and holds no fault: that is said. Breaks when "sound" stands alone.
TEST(SoakCommand, SaysWhatWasTooShortToJudge) {
    const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "trocar_short_soak";
    std::filesystem::create_directories(folder);
    const std::string soak = "soak probe_on_liver --minutes 0.0001 --seconds 30 --set liver.triangles=600 --faults nan";
    const nlohmann::json json = nlohmann::json::parse(run_program(soak + " --json", folder, folder).out);
    EXPECT_EQ(json["not_judged"], (nlohmann::json{"drift", "that episodes end the same", "fault nan"}));
    const std::string text = run_program(soak, folder, folder).out;
    EXPECT_NE(text.find("no rule broken; too short to judge drift, that episodes end the same, fault nan"), std::string::npos) << text;
}

}  // namespace
}  // namespace trocar
