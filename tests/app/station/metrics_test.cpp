#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <random>

#include "systems/app/station/score.hpp"
#include "systems/app/station/smooth_path.hpp"

// Metrics of motion and force against closed forms.
namespace trocar {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

struct Samples {
    std::vector<double> time;
    std::vector<Vec3d> place;
    std::vector<Quat> turn;
};

// Samples of a curve over [0, span] at a rate in whole milliseconds, as contact passes begin.
template <typename Curve>
Samples sample(double span, double rate, const Curve& curve) {
    Samples s;
    for (int k = 0; std::floor(k * 1000 / rate) <= span * 1000 + 1e-9; ++k) {
        const double t = std::floor(k * 1000 / rate) / 1000;
        s.time.push_back(t), s.place.push_back(curve(t));
    }
    return s;
}

// 100 mm in a second with the least jerk (Flash and Hogan 1985).
Vec3d stroke(double t) {
    t = std::clamp(t, 0.0, 1.0);
    return {0.1 * t * t * t * (10 - 15 * t + 6 * t * t), 0, 0};
}
Vec3d circle(double t) { return {0.05 * std::cos(kTurn * t), 0.05 * std::sin(kTurn * t), 0}; }
Vec3d helix(double t) { return {0.03 * std::cos(kTurn * t), 0.03 * std::sin(kTurn * t), 0.02 * t}; }

Exercise exercise_of(const Samples& s) {
    Exercise e;
    e.tool = {"tool"}, e.rate = 60, e.has_turn = !s.turn.empty();
    for (size_t i = 0; i < s.time.size(); ++i) {
        ExerciseSample row;
        row.time = s.time[i], row.tip = s.place[i];
        if (e.has_turn) row.turn = s.turn[i];
        e.sample.push_back(row);
    }
    return e;
}

void add_noise(Samples& s, double deviation) {
    std::mt19937 random(7);
    std::normal_distribution<double> noise(0, deviation);
    for (Vec3d& p : s.place) p += Vec3d(noise(random), noise(random), noise(random));
}

TEST(Metrics, AMinimumJerkStrokeHasItsClosedForm) {
    for (const double rate : {60.0, 120.0, 1000.0}) {
        const MetricValues m = score_exercise(exercise_of(sample(1, rate, stroke)), {}).all;
        EXPECT_NEAR(m.at("path_m"), 0.1, 1e-4) << rate;
        EXPECT_NEAR(m.at("ldlj"), -std::log(204.8), 1e-3 * std::log(204.8)) << rate;
        EXPECT_NEAR(m.at("economy"), 1, 1e-3) << rate;
        EXPECT_NEAR(m.at("time_s"), 1, 1e-9) << rate;
    }
    EXPECT_NEAR(std::exp(-score_exercise(exercise_of(sample(1, 1000, stroke)), {}).all.at("ldlj")), 204.8, 0.2048);
}

TEST(Metrics, CirclesAndHelicesHaveTheirLengths) {
    for (const double rate : {60.0, 1000.0}) {
        const MetricValues round = score_exercise(exercise_of(sample(3, rate, circle)), {}).all;
        EXPECT_NEAR(round.at("path_m"), 3 * 0.05 * kTurn, 1e-3 * 3 * 0.05 * kTurn) << rate;
        EXPECT_NEAR(round.at("economy"), 0, 1e-3) << rate;
        const double length = 3 * std::hypot(0.03 * kTurn, 0.02);
        const MetricValues up = score_exercise(exercise_of(sample(3, rate, helix)), {}).all;
        EXPECT_NEAR(up.at("path_m"), length, 1e-3 * length) << rate;
        EXPECT_NEAR(up.at("economy"), 0.06 / length, 1e-3) << rate;
        // speed v and jerk v w^2 are constant: T^3 / v^2 * T v^2 w^4
        EXPECT_NEAR(round.at("ldlj"), -4 * std::log(3 * kTurn), 1e-3 * 4 * std::log(3 * kTurn)) << rate;
    }
}

// An encoder's noise of 20 um at 1 kHz.
TEST(Metrics, EncoderNoiseChangesThemLittle) {
    const auto differ = [](Samples s, const char* key) {
        const double clean = score_exercise(exercise_of(s), {}).all.at(key);
        add_noise(s, 20e-6);
        return std::abs(score_exercise(exercise_of(s), {}).all.at(key) / clean - 1);
    };
    for (const char* key : {"path_m", "sparc", "ldlj"}) {
        EXPECT_LT(differ(sample(1, 1000, stroke), key), 0.02) << key;
        EXPECT_LT(differ(sample(3, 1000, circle), key), 0.02) << key;
        EXPECT_LT(differ(sample(3, 1000, helix), key), 0.02) << key;
    }
}

// The definition summed term by term: the spectrum at every frequency of the padded transform, without a fast algorithm.
TEST(Metrics, SpectralArcLengthIsThatOfItsDefinition) {
    std::vector<double> speed;
    const double rate = 100;
    for (int k = 0; k <= 120; ++k) {
        const double t = k / 120.0;
        speed.push_back(30 * t * t * (1 - t) * (1 - t) + 0.2 * std::sin(9 * kTurn * t) * std::sin(9 * kTurn * t));
    }
    const size_t size = 128 * 16;
    std::vector<double> amplitude;
    for (size_t k = 0; static_cast<double>(k) * rate / static_cast<double>(size) <= 10; ++k) {
        std::complex<double> sum = 0;
        for (size_t n = 0; n < speed.size(); ++n)
            sum += speed[n] * std::polar(1.0, -kTurn * static_cast<double>(k) * static_cast<double>(n) / static_cast<double>(size));
        amplitude.push_back(std::abs(sum));
    }
    const double largest = amplitude[0];  // speeds are positive
    size_t last = 0;
    for (size_t k = 0; k < amplitude.size(); ++k)
        if (amplitude[k] / largest >= 0.05) last = k;
    ASSERT_GT(last, 10u);
    double length = 0;
    for (size_t k = 0; k < last; ++k) length += std::hypot(1.0 / static_cast<double>(last), (amplitude[k + 1] - amplitude[k]) / largest);
    EXPECT_NEAR(spectral_arc_length(speed, rate), -length, 1e-9);
    EXPECT_LT(spectral_arc_length(speed, rate), -1);
}

// Faster or larger is as smooth; two strokes with a pause between them are less.
TEST(Metrics, SmoothnessHasNoUnit) {
    const MetricValues one = score_exercise(exercise_of(sample(1, 1000, stroke)), {}).all;
    const MetricValues slow = score_exercise(exercise_of(sample(3, 1000, [](double t) { return Vec3d(2 * stroke(t / 3)); })), {}).all;
    EXPECT_NEAR(slow.at("ldlj"), one.at("ldlj"), 1e-3 * 5.3);
    EXPECT_NEAR(slow.at("sparc"), one.at("sparc"), 0.01 * 1.5);
    const MetricValues two =
        score_exercise(exercise_of(sample(2.4, 1000, [](double t) { return Vec3d(stroke(t) + stroke(t - 1.4)); })), {}).all;
    EXPECT_LT(two.at("ldlj"), one.at("ldlj") - 1);
    EXPECT_LT(two.at("sparc"), one.at("sparc") - 0.1);
}

TEST(Metrics, TurnsAddUp) {
    Samples s = sample(2, 60, [](double) { return Vec3d(0.1, 0.2, 0.3); });
    for (const double t : s.time) {
        const double half = 0.5 * 1.3 * t;
        s.turn.push_back({std::cos(half), 0, std::sin(half), 0});
        if (s.turn.size() % 2 == 0) s.turn.back() = {-s.turn.back().w, 0, -s.turn.back().y, 0};  // the same rotation
    }
    const MetricValues m = score_exercise(exercise_of(s), {}).all;
    EXPECT_NEAR(m.at("turn_rad"), 2.6, 2.6e-3);
    EXPECT_EQ(m.at("idle_share"), 1);
}

// One tool moves for the first 4 s of 10, the other one from 2 s to 6 s.
TEST(Metrics, IdleShareAndBimanualOverlap) {
    Exercise e;
    e.tool = {"left", "right"}, e.has_turn = false;
    for (int k = 0; k <= 1000; ++k) {
        const double t = k / 100.0;
        ExerciseSample s;
        s.time = t, s.tip = {0.05 * std::clamp(t, 0.0, 4.0), 0, 0};
        e.sample.push_back(s);
        s.tool = 1, s.tip = {0, 0.05 * std::clamp(t, 2.0, 6.0), 0};
        e.sample.push_back(s);
    }
    const Score score = score_exercise(e, {});
    EXPECT_NEAR(score.all.at("idle_share"), 0.4, 0.01);
    EXPECT_NEAR(score.all.at("bimanual_overlap"), 2.0 / 6, 0.01);
    EXPECT_NEAR(score.tool[0].at("idle_share"), 0.6, 0.01);
    EXPECT_NEAR(score.all.at("path_m"), 0.4, 1e-3);
}

// A force that rises evenly to 8 N in 4 s and stays for 4 s.
TEST(Metrics, ForcesPerOrganAndAboveTheDamageThreshold) {
    Exercise e;
    e.tool = {"grasper"}, e.organ = {"small bowel", "liver"}, e.has_turn = false;
    for (int k = 0; k <= 800; ++k) {
        ExerciseSample s;
        s.time = k / 100.0;
        const double force = std::min(8.0, 2 * s.time);
        s.hand = {0, 0, force}, s.hand_peak = force + 0.5, s.contacts = force > 0;
        s.organs = {static_cast<uint32_t>(e.organ_force.size()), force > 0 ? 1u : 0u};
        if (force > 0) e.organ_force.push_back({0, force});
        e.sample.push_back(s);
    }
    ScoreOptions options;
    options.damage["liver"] = 3;
    Score score = score_exercise(e, options);
    EXPECT_NEAR(score.all.at("impulse_ns"), 16 + 32, 0.05);
    EXPECT_NEAR(score.all.at("peak_force_n"), 8.5, 1e-12);
    EXPECT_NEAR(score.organ[0].at("impulse_ns"), 48, 0.1);
    EXPECT_NEAR(score.organ[0].at("peak_n"), 8, 1e-12);
    EXPECT_NEAR(score.organ[0].at("damage_n"), 1.5, 1e-12);
    EXPECT_NEAR(score.organ[0].at("over_damage_share"), 1 - 0.75 / 8, 2e-3);
    EXPECT_FALSE(score.organ[1].contains("peak_n"));
    options.damage["small bowel"] = 6;
    score = score_exercise(e, options);
    EXPECT_NEAR(score.organ[0].at("over_damage_share"), 5.0 / 8, 2e-3);
}

TEST(Metrics, PhasesBeginWithEvents) {
    Exercise e = exercise_of(sample(4, 60, circle));
    e.event = {{0.5, "touch", "", 0}, {1.0, "attach", "tack 1"}, {1.0, "limit", "", 0}, {2.0, "detach", "tack 1"}, {3.0, "touch", "", 0}};
    const std::vector<ExercisePhase> phases = phases_of(e);
    ASSERT_EQ(phases.size(), 4u);
    EXPECT_EQ(phases[0].name, "approach");
    EXPECT_EQ(phases[1].name, "contact");
    EXPECT_EQ(phases[2].name, "tack 1");
    EXPECT_EQ(phases[3].name, "after tack 1");
    EXPECT_EQ(phases[2].from, 1.0);
    EXPECT_EQ(phases[2].to, 2.0);
    EXPECT_EQ(phases[3].to, 4.0);
    double path = 0;
    for (const auto& [phase, values] : score_exercise(e, {}).phase) path += values.at("path_m");
    EXPECT_NEAR(path, 4 * 0.05 * kTurn, 0.02 * 4 * 0.05 * kTurn);  // the gaps between phases are one sample wide
}

TEST(Metrics, QuantilesLieBetweenValues) {
    EXPECT_EQ(quantile_between({4, 1, 3, 2}, 0.5), 2.5);
    EXPECT_EQ(quantile_between({4, 1, 3, 2}, 0.25), 1.75);
    EXPECT_EQ(quantile_between({5}, 0.95), 5);
    EXPECT_TRUE(std::isnan(quantile_between({}, 0.5)));
}

TEST(Metrics, OfNothingAndOfOneSampleAreNone) {
    EXPECT_TRUE(score_exercise({}, {}).all.empty());
    Exercise one = exercise_of(sample(0, 60, circle));
    ASSERT_EQ(one.sample.size(), 1u);
    EXPECT_FALSE(score_exercise(one, {}).all.contains("path_m"));
}

}  // namespace
}  // namespace trocar
