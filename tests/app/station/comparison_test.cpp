#include "systems/app/station/comparison.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "engine/base/error.hpp"
#include "systems/app/station/exercise_file.hpp"
#include "systems/app/station/statistics.hpp"

// Statistics against published tables and closed forms; alignment against known maps of time.
namespace trocar {
namespace {
namespace fs = std::filesystem;

TEST(Statistics, AreaOfShiftedNormals) {
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    for (const double shift : {0.0, 0.5, 1.0, 2.0}) {
        std::vector<double> a(20000), b(20000);
        for (double& x : a) x = normal(random) + shift;
        for (double& x : b) x = normal(random);
        EXPECT_NEAR(area_under_curve(a, b), 0.5 * std::erfc(-shift / 2), 0.01) << shift;  // Phi(d / sqrt 2)
    }
    const std::vector<double> high{3, 4, 5}, low{1, 2}, tied{1, 3};
    EXPECT_EQ(area_under_curve(high, low), 1);
    EXPECT_EQ(area_under_curve(low, high), 0);
    EXPECT_EQ(area_under_curve(tied, tied), 0.5);
}

// Some 95 % of the intervals hold the true area.
TEST(Statistics, BootstrapIntervalsHoldTheTruth) {
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    int held = 0;
    constexpr int kTrials = 60;
    for (int k = 0; k < kTrials; ++k) {
        std::vector<double> a(30), b(30);
        for (double& x : a) x = normal(random) + 1;
        for (double& x : b) x = normal(random);
        const Interval i = bootstrap_area(a, b);
        EXPECT_LE(i.low, i.value);
        EXPECT_GE(i.high, i.value);
        const double truth = 0.5 * std::erfc(-0.5);
        held += i.low <= truth && truth <= i.high;
    }
    EXPECT_GE(held, 50);
    EXPECT_LT(held, kTrials);
}

// Table 2 of Shrout and Fleiss 1979: six targets, four judges; case 2 gives 0.29. Interval of McGraw and Wong's case: 0.02 to 0.76.
TEST(Statistics, IntraclassCorrelationOfThePublishedTable) {
    const std::vector<double> ratings{9, 2, 5, 8, 6, 1, 3, 2, 8, 4, 6, 8, 7, 1, 2, 6, 10, 5, 6, 9, 6, 2, 4, 7};
    const Interval icc = intraclass_correlation(ratings, 4);
    EXPECT_NEAR(icc.value, 0.2898, 5e-4);
    EXPECT_NEAR(icc.low, 0.0188, 2e-3);
    EXPECT_NEAR(icc.high, 0.7611, 2e-3);
    EXPECT_TRUE(std::isnan(intraclass_correlation({}, 0).value));
    const std::vector<double> same{1, 1, 2, 2, 3, 3};
    EXPECT_NEAR(intraclass_correlation(same, 2).value, 1, 1e-12);
}

// Exact tail of the signed-rank statistic: for n = 10 a sum of 8 has p = 0.0488 (two-sided), for n = 6 one of 0 has 2 / 64.
TEST(Statistics, SignedRankIsThatOfTheTables) {
    const std::vector<double> ten{-1, -3, -4, 2, 5, 6, 7, 8, 9, 10};
    EXPECT_NEAR(signed_rank_p(ten), 50.0 / 1024, 1e-12);
    const std::vector<double> six{1, 2, 3, 4, 5, 6};
    EXPECT_NEAR(signed_rank_p(six), 2.0 / 64, 1e-12);
    EXPECT_EQ(signed_rank_p(std::vector<double>{0, 0}), 1);
    // every choice of signs, counted, against the recurrence; and the normal approximation near it
    std::vector<double> mixed{-1, 2, -3, 4, 5, -6, 7, 8, 9, -10, 11, 12};
    double sum = 0;
    for (const double d : mixed) sum += d < 0 ? -d : 0;
    int ways = 0;
    for (unsigned signs = 0; signs < 4096; ++signs) {
        int below = 0;
        for (int r = 1; r <= 12; ++r) below += signs >> (r - 1) & 1 ? r : 0;
        ways += below <= sum;
    }
    EXPECT_NEAR(signed_rank_p(mixed), 2.0 * ways / 4096, 1e-12);
    mixed.push_back(13), mixed.push_back(13);  // a tie: by the approximation
    EXPECT_NEAR(signed_rank_p(mixed), 0.0388, 0.01);
}

TEST(Statistics, HolmCorrectsInOrder) {
    const std::vector<double> p{0.01, 0.04, 0.03, 0.005};
    const std::vector<double> q = holm(p);
    EXPECT_NEAR(q[3], 0.02, 1e-15);
    EXPECT_NEAR(q[0], 0.03, 1e-15);
    EXPECT_NEAR(q[2], 0.06, 1e-15);
    EXPECT_NEAR(q[1], 0.06, 1e-15);
}

TEST(Statistics, LearningFollowsAPowerLaw) {
    std::vector<double> trial, time;
    for (int k = 1; k <= 12; ++k) trial.push_back(k), time.push_back(90 * std::pow(k, -0.3));
    const PowerLaw law = fit_power_law(trial, time);
    EXPECT_NEAR(law.first, 90, 1e-9);
    EXPECT_NEAR(law.exponent, -0.3, 1e-12);
    time[3] = -1;
    EXPECT_TRUE(std::isnan(fit_power_law(trial, time).exponent));
}

// The least cost of all paths, by recursion over them.
double least_cost(const std::vector<double>& a, const std::vector<double>& b, size_t i, size_t j) {
    const double here = std::abs(a[i] - b[j]);
    if (i == 0 && j == 0) return here;
    double best = INFINITY;
    if (i > 0 && j > 0) best = std::min(best, least_cost(a, b, i - 1, j - 1));
    if (i > 0) best = std::min(best, least_cost(a, b, i - 1, j));
    if (j > 0) best = std::min(best, least_cost(a, b, i, j - 1));
    return here + best;
}

TEST(Warping, ShortSequencesLieOnTheCheapestPath) {
    const std::vector<double> a{0, 1, 3, 2, 2, 5}, b{0, 0, 1, 2, 3, 2, 5};
    const std::vector<double> map = warp_onto(a, b, 1, 1);
    ASSERT_EQ(map.size(), a.size());
    double cost = 0;  // of a path through the mean indices, which are whole where a sample has one partner
    for (size_t i = 0; i < a.size(); ++i) cost += std::abs(a[i] - b[static_cast<size_t>(std::lround(map[i]))]);
    EXPECT_EQ(least_cost(a, b, a.size() - 1, b.size() - 1), 1);
    EXPECT_LE(cost, 1);
    for (size_t i = 1; i < map.size(); ++i) EXPECT_GE(map[i], map[i - 1]);
    EXPECT_TRUE(warp_onto({}, b, 1).empty());
    EXPECT_EQ(warp_onto(std::vector<double>{1}, b, 1).size(), 1u);
    EXPECT_EQ(warp_onto(b, std::vector<double>{1}, 1).size(), b.size());
}

Exercise walk(double span, double rate, double (*map)(double), double first_touch) {
    Exercise e;
    e.tool = {"probe"}, e.has_turn = false, e.rate = rate;
    for (int k = 0; k <= static_cast<int>(span * rate); ++k) {
        ExerciseSample s;
        s.time = k / rate;
        const double u = map(s.time);  // along the way, 0 to 6
        s.tip = {0.02 * u, 0.03 * std::sin(1.7 * u), 0.01 * std::cos(2.9 * u)};
        s.hand = {0, 0, std::max(0.0, std::sin(u))}, s.hand_peak = s.hand.norm();
        e.sample.push_back(s);
    }
    if (first_touch > 0) e.event.push_back({first_touch, "touch", "", 0});
    return e;
}

// The same way walked with another rhythm is found back.
TEST(Warping, FindsAKnownMapOfTime) {
    const auto even = [](double t) { return t; };
    const auto uneven = [](double t) { return t < 4 ? 0.5 * t : 2 + 2 * (t - 4); };  // slow, then fast: 6 s
    const Exercise a = walk(6, 60, even, 0), b = walk(6, 60, uneven, 0);
    const Alignment found = align_runs(a, b);
    EXPECT_FALSE(found.by_phases);
    double worst = 0;
    for (size_t i = 0; i < found.time.size(); ++i) worst = std::max(worst, std::abs(uneven(found.other[i]) - found.time[i]));
    EXPECT_LT(worst, 0.08);
    EXPECT_LT(found.distance, 0.001);
    EXPECT_GT(found.raw_distance, 0.02);
    // with the first touch as a known pair of times
    const Alignment phased = align_runs(walk(6, 60, even, 2.0), walk(6, 60, uneven, 4.0));
    EXPECT_TRUE(phased.by_phases);
    EXPECT_LE(phased.distance, found.distance * 1.01);
    const auto at = std::ranges::find_if(phased.time, [](double t) { return t >= 2.0 - 1e-9; });
    EXPECT_NEAR(phased.other[static_cast<size_t>(at - phased.time.begin())], 4.0, 0.05);
}

TEST(Warping, RunsWithoutACommonToolAreNotAligned) {
    Exercise a = walk(
                 2, 60, [](double t) { return t; }, 0),
             b = a;
    b.tool = {"other"};
    EXPECT_TRUE(align_runs(a, b).time.empty());
}

class ComparisonFiles : public testing::Test {
 protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("trocar_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
        fs::remove_all(folder_), fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }
    fs::path write(const std::string& name, const std::string& text) const {
        fs::create_directories((folder_ / name).parent_path());
        std::ofstream(folder_ / name) << text;
        return folder_ / name;
    }
    fs::path folder_;
};

// Stage times with the same noise in both, one stage 10 % slower in the second run: found, and only that.
TEST_F(ComparisonFiles, TimesDifferWhereTheyDo) {
    std::mt19937 random(11);
    std::normal_distribution<double> normal;
    std::string a = "time_s,overlap_ms,advance_ms,picture_ms\n", b = a;
    double drift = 0;
    for (int k = 0; k < 400; ++k) {
        drift = 0.9 * drift + 0.1 * normal(random);  // neighbours depend on each other
        const double load = std::exp(0.1 * drift);
        const auto row = [&](double slower) {
            char text[128];
            std::snprintf(text, sizeof text, "%.3f,%.5f,%.5f,%s\n", k / 60.0, 1.0 * load * std::exp(0.05 * normal(random)),
                          slower * 3.0 * load * std::exp(0.05 * normal(random)), k % 2 ? "0" : "2");
            return std::string(text);
        };
        a += row(1), b += row(1.1);
    }
    write("a/stages.csv", a), write("b/stages.csv", b);
    const std::vector<StageComparison> stages = compare_times(folder_ / "a", folder_ / "b");
    ASSERT_EQ(stages.size(), 3u);
    EXPECT_EQ(stages[0].stage, "overlap");
    EXPECT_NEAR(stages[0].ratio, 1, 0.02);
    EXPECT_GT(stages[0].p, 0.05);
    EXPECT_NEAR(stages[1].ratio, 1.1, 0.02);
    EXPECT_LT(stages[1].p, 0.001);
    EXPECT_NEAR(stages[1].a_ms, 3.0, 0.3);
    EXPECT_EQ(stages[2].ratio, 1);
    EXPECT_EQ(stages[2].p, 1);
    write("c/stages.csv", a.substr(0, a.find('\n', 600) + 1));
    EXPECT_TRUE(compare_times(folder_ / "a", folder_ / "c").empty()) << "too few passes";
}

TEST_F(ComparisonFiles, ACohortIsReadAndItsErrorsAreNamed) {
    const std::vector<CohortLine> lines = read_cohort(write("study.csv", "run,group,subject,trial\nx,expert,E1,1\ny,novice,N1,2\n"));
    ASSERT_EQ(lines.size(), 2u);
    EXPECT_EQ(lines[1].run, folder_ / "y");
    EXPECT_EQ(lines[1].group, "novice");
    EXPECT_EQ(lines[1].trial, 2);
    const auto fault = [&](const std::string& text) {
        try {
            read_cohort(write("bad.csv", text));
        } catch (const InputError& e) {
            return std::string(e.what());
        }
        return std::string("none");
    };
    EXPECT_NE(fault("name\nx\n").find("bad.csv:1: column run is missing"), std::string::npos);
    EXPECT_NE(fault("run,trial\nx,1\ny,two\n").find("bad.csv:3: \"two\" in column trial"), std::string::npos);
    EXPECT_NE(fault("run,trial\nx,1,2\n").find("bad.csv:2: 3 fields, not 2"), std::string::npos);
    EXPECT_NE(fault("run,trial\nx,-1\n").find("bad.csv:2: trials count from 1"), std::string::npos);
}

// Two groups of three runs of known lengths, two trials a subject.
TEST(Cohorts, AreSummarised) {
    std::vector<ComparedRun> runs;
    const double path[] = {1, 2, 3, 4, 5, 6, 7, 8};
    for (int k = 0; k < 8; ++k) {
        ComparedRun r;
        r.group = k < 4 ? "expert" : "novice", r.subject = std::to_string(k / 2), r.trial = 1 + k % 2;
        r.score.all["path_m"] = path[k];
        runs.push_back(r);
    }
    const Cohort c = summarise_cohort(runs);
    ASSERT_EQ(c.group.size(), 2u);
    ASSERT_EQ(c.metric.size(), 1u);
    const MetricSummary& m = c.metric[0];
    EXPECT_EQ(m.quartiles[0], (std::array<double, 3>{1.75, 2.5, 3.25}));
    EXPECT_EQ(m.area.value, 0) << "every expert's way is shorter";
    EXPECT_EQ(c.subjects, 4u);
    EXPECT_EQ(c.trials, 2u);
    const std::vector<double> table{1, 2, 3, 4, 5, 6, 7, 8};
    EXPECT_EQ(m.reliability.value, intraclass_correlation(table, 2).value);
    EXPECT_EQ(m.median, (std::vector<double>{4, 5}));
}

// A page that needs no other file; names of runs are escaped.
TEST(Cohorts, APageHoldsEverything) {
    std::vector<ComparedRun> runs(3);
    for (size_t r = 0; r < runs.size(); ++r) {
        runs[r].name = r == 0 ? "<first>" : "run " + std::to_string(r);
        runs[r].exercise = walk(
            6, 60, [](double t) { return t; }, 2);
        runs[r].score = score_exercise(runs[r].exercise, {});
        runs[r].group = r < 2 ? "a" : "b";
    }
    const std::vector<Alignment> alignments{align_runs(runs[0].exercise, runs[1].exercise), align_runs(runs[0].exercise, runs[2].exercise)};
    const std::string page = comparison_html(runs, summarise_cohort(runs), alignments, {{"advance", 1, 2, 2, 0.001}});
    EXPECT_NE(page.find("&lt;first&gt;"), std::string::npos);
    EXPECT_EQ(page.find("<first>"), std::string::npos);
    for (const char* part : {"<code>sparc</code>", "Force on the hand at probe, aligned", "AUC", "slower", "phase by phase"})
        EXPECT_NE(page.find(part), std::string::npos) << part;
    EXPECT_EQ(page.find("http://"), page.find("http://www.w3.org/2000/svg")) << "no address but that of the drawings";
    EXPECT_EQ(page.find("https://"), std::string::npos);
}

}  // namespace
}  // namespace trocar
