#include "systems/haptics/contact/device_motion.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <random>

namespace trocar {
namespace {

constexpr double kTick = 1e-3;                  // s
constexpr double kRate = 2 * std::numbers::pi;  // rad/s, of a hand that oscillates at 1 Hz
constexpr double kWay = 0.02;                   // m
const Vec3d kAxis = Vec3d(1, 2, -2) / 3;

// RMS error (m/s) of the estimated velocity of that hand over four periods. `sense` makes a sample from the
// true position and velocity at a time.
template <typename Sense>
double error_of_swing(const HapticParams& params, const Sense& sense) {
    ToolState state;
    double sum = 0;
    int count = 0;
    for (int k = 0; k < 5000; ++k) {
        const double time = k * kTick;
        const Vec3d position = kWay * std::sin(kRate * time) * kAxis, velocity = kWay * kRate * std::cos(kRate * time) * kAxis;
        EXPECT_TRUE(take_sample(params, sense(time, position, velocity), state)) << k;
        if (k < 1000) continue;
        sum += (foretold(state).velocity - velocity).squaredNorm();
        ++count;
    }
    return std::sqrt(sum / count);
}

DeviceState sample_of(double time, const Vec3d& position, const Vec3d& velocity) {
    DeviceState sample;
    sample.time = time;
    sample.position = position;
    sample.velocity = velocity;
    return sample;
}

// For exact positions the error is that of the filter's transfer function: backward difference, then 2 H -
// H^2 with the discrete low-pass H = share / (1 - (1 - share) / z).
TEST(DeviceMotion, ErrsAsItsFilterDoes) {
    const HapticParams params;
    const std::complex<double> back = std::polar(1.0, -kRate * kTick), s(0, kRate);
    const double share = -std::expm1(-kTick / params.motion_filter);
    const std::complex<double> low = share / (1.0 - (1 - share) * back);
    const std::complex<double> made = (1.0 - back) / kTick * (2.0 * low - low * low) / s;
    const double peak = kWay * kRate, expected = std::abs(made - 1.0) * peak / std::numbers::sqrt2;
    const double found = error_of_swing(params, sample_of);
    EXPECT_NEAR(found, expected, 1e-3 * expected);
    EXPECT_LT(found, 0.005 * peak);
}

// For any velocity that a device reports, and with an encoder of 20 um and packets up to 0.3 ms late, for
// which the difference of two positions alone has an error of a quarter.
TEST(DeviceMotion, HoldsWithCoarsePlacesAndAnyVelocity) {
    const HapticParams params;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> late(0, 3e-4), noise(-0.1, 0.1);
    const auto coarse = [](const Vec3d& p) { return Vec3d((p / 2e-5).array().round() * 2e-5); };
    const double peak = kWay * kRate;
    for (const double says : {0.0, 1.0, -1.0, 10.0}) {
        const double error = error_of_swing(params, [&](double time, const Vec3d& position, const Vec3d& velocity) {
            return sample_of(time + late(random), coarse(position), says * velocity + Vec3d(noise(random), noise(random), noise(random)));
        });
        std::printf("velocity said %+.0f times the true one: foretold %.2f %% off\n", says, 100 * error / peak);
        EXPECT_LT(error, 0.03 * peak) << says;
    }
}

// A repeated sample contains no information on the motion.
TEST(DeviceMotion, ARepeatedSampleChangesNothing) {
    const HapticParams params;
    ToolState state;
    for (int k = 0; k < 100; ++k)
        for (int again = 0; again < 3; ++again) take_sample(params, sample_of(k * kTick, k * 1e-4 * kAxis, Vec3d::Zero()), state);
    EXPECT_NEAR((foretold(state).velocity - 0.1 * kAxis).norm(), 0, 1e-5);
}

// No hand is that fast: such a sample is rejected like one that jumps.
TEST(DeviceMotion, AVelocityBeyondAnyHandIsRefused) {
    const HapticParams params;
    ToolState state;
    EXPECT_TRUE(take_sample(params, sample_of(0, Vec3d::Zero(), Vec3d::Zero()), state));
    EXPECT_FALSE(take_sample(params, sample_of(kTick, Vec3d::Zero(), -9e5 * kAxis), state));
    EXPECT_FALSE(take_sample(params, sample_of(kTick, Vec3d::Zero(), std::numeric_limits<double>::quiet_NaN() * kAxis), state));
    EXPECT_EQ(state.rejected_samples, 2u);
    EXPECT_EQ(foretold(state).velocity.norm(), 0);
    EXPECT_TRUE(take_sample(params, sample_of(2 * kTick, Vec3d::Zero(), 5 * kAxis), state));
}

}  // namespace
}  // namespace trocar
