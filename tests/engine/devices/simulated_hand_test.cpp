#include "engine/devices/simulated_hand.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace trocar {
namespace {

constexpr double kTick = 1e-3;  // s

DeviceState at(const Vec3d& position, const Vec3d& velocity = Vec3d::Zero()) {
    DeviceState state;
    state.position = position;
    state.velocity = velocity;
    return state;
}

// m x'' + b x' = F from rest: x = F/b (t - m/b (1 - e^{-bt/m})), exact per tick except for the drift between
// kicks.
TEST(SimulatedHand, DampedMassFollowsTheClosedForm) {
    HandModel hand;
    hand.mass = 0.1, hand.damping = 0.5;
    HandModelState state;
    step_hand(hand, at(Vec3d::Zero()), Vec3d::Zero(), kTick, state);
    const Vec3d force(0.3, -0.6, 0.2);
    for (int k = 1; k <= 2000; ++k) {
        step_hand(hand, at(Vec3d::Zero()), force, kTick, state);
        const double t = k * kTick, tau = hand.mass / hand.damping;
        const Vec3d v = force / hand.damping * -std::expm1(-t / tau);
        const Vec3d x = force / hand.damping * t - tau * v;
        ASSERT_NEAR((state.velocity - v).norm(), 0, 1e-12) << k;
        ASSERT_NEAR((state.position - x).norm(), 0, 1e-8 * (1 + x.norm())) << k;
    }
}

// With its arm it oscillates by m x'' + (b + c) x' + k x = 0: period and decay against the closed form.
TEST(SimulatedHand, ArmSwingsWithItsImpedance) {
    HandModel hand;
    hand.mass = 0.5, hand.damping = 0.4, hand.stiffness = 300, hand.arm_damping = 1.6;
    HandModelState state;
    step_hand(hand, at({0.02, 0, 0}), Vec3d::Zero(), kTick, state);
    const double decay = (hand.damping + hand.arm_damping) / (2 * hand.mass);
    const double rate = std::sqrt(hand.stiffness / hand.mass - decay * decay);
    for (int k = 1; k <= 1000; ++k) {
        step_hand(hand, at(Vec3d::Zero()), Vec3d::Zero(), kTick, state);
        const double t = k * kTick;
        const double x = 0.02 * std::exp(-decay * t) * (std::cos(rate * t) + decay / rate * std::sin(rate * t));
        // of second order: a phase of rate t (rate h)^2 / 24 with steps h of an eighth of a tick
        ASSERT_NEAR(state.position.x(), x, 1.1 * 0.02 * rate * t * std::pow(rate * kTick / 8, 2) / 24 + 1e-9) << k;
    }
    // under constant force the displacement tends to F/k
    for (int k = 0; k < 20'000; ++k) step_hand(hand, at(Vec3d::Zero()), {0, 1.5, 0}, kTick, state);
    EXPECT_NEAR(state.position.y(), 1.5 / 300, 1e-9);
}

TEST(SimulatedHand, FrictionHoldsBelowAndBrakesAbove) {
    HandModel hand;
    hand.mass = 0.2, hand.friction = 0.3;
    HandModelState state;
    step_hand(hand, at(Vec3d::Zero()), Vec3d::Zero(), kTick, state);
    for (int k = 0; k < 500; ++k) step_hand(hand, at(Vec3d::Zero()), {0.29, 0, 0}, kTick, state);
    EXPECT_EQ(state.position.norm(), 0);
    for (int k = 1; k <= 500; ++k) {
        step_hand(hand, at(Vec3d::Zero()), {0.5, 0, 0}, kTick, state);
        ASSERT_NEAR(state.velocity.x(), (0.5 - 0.3) / 0.2 * k * kTick, 1e-12);
    }
    // and after release it stops after v m / fc and stays
    const double stop = state.velocity.x() * hand.mass / hand.friction;
    for (int k = 0; k < static_cast<int>(std::ceil(stop / kTick)) + 1; ++k) step_hand(hand, at(Vec3d::Zero()), Vec3d::Zero(), kTick, state);
    EXPECT_EQ(state.velocity.norm(), 0);
}

TEST(SimulatedHand, ADelayIsWholeTicks) {
    for (uint32_t delay = 0; delay <= kMostHandDelay; ++delay) {
        HandModel hand;
        hand.mass = 1, hand.delay = delay;
        HandModelState state;
        step_hand(hand, at(Vec3d::Zero()), Vec3d::Zero(), kTick, state);
        uint32_t ticks = 0;
        for (; state.velocity.norm() == 0 && ticks < 20; ++ticks) step_hand(hand, at(Vec3d::Zero()), {1, 0, 0}, kTick, state);
        EXPECT_EQ(ticks, delay + 1);
    }
}

TEST(SimulatedHand, EncoderRoundsToItsStep) {
    HandModel hand;
    hand.mass = 0.1, hand.encoder = 0.055e-3;
    HandModelState state;
    step_hand(hand, at(Vec3d::Zero(), {0.01, 0, 0}), Vec3d::Zero(), kTick, state);
    double mean = 0;
    for (int k = 0; k < 2000; ++k) {
        step_hand(hand, at(Vec3d::Zero(), {0.01, 0, 0}), Vec3d::Zero(), kTick, state);
        const DeviceState report = hand_device_state(hand, {}, state);
        const double steps = report.position.x() / hand.encoder;
        ASSERT_NEAR(steps, std::round(steps), 1e-9);
        ASSERT_LE(std::abs(report.position.x() - state.position.x()), 0.5 * hand.encoder + 1e-15);
        if (k >= 1000) mean += report.velocity.x() / 1000;
    }
    EXPECT_NEAR(mean, 0.01, 1e-4);
}

TEST(SimulatedHand, AForceThatIsNoNumberIsNone) {
    HandModel hand;
    hand.mass = 0.1;
    HandModelState state;
    step_hand(hand, at(Vec3d::Zero()), Vec3d::Zero(), kTick, state);
    step_hand(hand, at(Vec3d::Zero()), {std::nan(""), 0, 0}, kTick, state);
    EXPECT_TRUE(state.position.allFinite());
    EXPECT_EQ(state.velocity.norm(), 0);
}

}  // namespace
}  // namespace trocar
