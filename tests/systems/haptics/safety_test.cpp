#include "systems/haptics/safety.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/devices/simulated_hand.hpp"
#include "systems/haptics/tool.hpp"
#include "tests/reference/local_patches.hpp"

// Cases T01 to T05 and T13 to T16 for the whole tick: the command to the device, with failing devices and
// hands that would oscillate. The other cases, and the same for contact alone: HapticTick.T01 and T06 to T16;
// LiveDevice.T15.
namespace trocar {
namespace {

constexpr double kTick = 1e-3;    // s
constexpr double kRadius = 3e-3;  // m

// A hand on a simulated device against the plane z = 0, ticked as in a live run.
struct WallRig {
    HapticParams params;
    LocalContactModel model = reference::make_patch(reference::make_plane());
    HandTool tool;
    std::vector<HapticEffect> effects;
    HapticScratch scratch;
    ToolState state;
    HandModelState hand;
    double time = 0, energy = 0;  // s; J, work of the device's force on the hand
    Vec3d before = Vec3d::Zero();

    explicit WallRig(double stiffness) {
        params.model_timeout = 1e9;
        tool.tip_radius = kRadius;
        tool.friction = 0;
        tool.coupling_stiffness = stiffness;
        tool.coupling_damping = 0;
        tool.max_force = 1e3;
        tool.limits.force_slew = 1e9;
    }
    // One tick with the hand's intended position; `elapsed` since the last one.
    void tick(const DeviceState& intended, double elapsed = kTick) {
        const Vec3d force = state.output.force;
        DeviceState sample = hand_sample(tool, intended, elapsed, state.output, hand);
        if (state.ticks > 0) energy += force.dot(sample.position - before);
        before = sample.position;
        time += elapsed;
        sample.time = time;
        tick_tool(params, model, time, tool, effects, sample, scratch, state);
    }
    void sample(const DeviceState& device) {
        time += kTick;
        tick_tool(params, model, time, tool, effects, device, scratch, state);
    }
    DeviceState at(const Vec3d& position) const {
        DeviceState s;
        s.time = time + kTick;
        s.position = position;
        return s;
    }
    Vec3d force() const { return state.output.force; }
};

DeviceState pose_at(const Vec3d& position) {
    DeviceState s;
    s.position = position;
    return s;
}

// ---- limits ----

// T16: breaks when components are clamped separately or the scaled force exceeds the limit.
TEST(HapticSafety, T16_ACommandAboveTheLimitsKeepsItsDirection) {
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    DeviceLimits limits;
    limits.force_slew = limits.torque_slew = 1e12;
    for (int k = 0; k < 200; ++k) {
        SafetyState state;
        DeviceCommand wanted, output;
        wanted.force = 10 * Vec3d(normal(random), normal(random), normal(random));
        wanted.torque = Vec3d(normal(random), normal(random), normal(random));
        wanted.stiffness[0] = 100;
        limit_command(limits, 3.3, kTick, false, wanted, state, output);
        EXPECT_LE(output.force.norm(), 3.3);
        EXPECT_LE(output.torque.norm(), limits.torque);
        EXPECT_NEAR((output.force.normalized() - wanted.force.normalized()).norm(), 0, 1e-12);
        EXPECT_NEAR((output.torque.normalized() - wanted.torque.normalized()).norm(), 0, 1e-12);
        EXPECT_NEAR(output.stiffness[0], 100 * output.force.norm() / wanted.force.norm(), 1e-9);
        EXPECT_EQ(state.limiting, wanted.force.norm() > 3.3 || wanted.torque.norm() > limits.torque);
    }
}

TEST(HapticSafety, ForceAndTorqueChangeNoFasterThanTheirSlew) {
    DeviceLimits limits;
    limits.force_slew = 500, limits.torque_slew = 20;
    SafetyState state;
    DeviceCommand wanted, output;
    wanted.force = {0, 3, 0};
    wanted.torque = {0.1, 0, 0};
    for (int k = 1; k <= 10; ++k) {
        limit_command(limits, 10, kTick, false, wanted, state, output);
        EXPECT_NEAR(output.force.y(), std::min(3.0, 0.5 * k), 1e-9);
        EXPECT_NEAR(output.torque.x(), std::min(0.1, 0.02 * k), 1e-12);
    }
    wanted.force = {0, -3, 0};
    const Vec3d last = output.force;
    limit_command(limits, 10, kTick, false, wanted, state, output);
    EXPECT_NEAR((output.force - last).norm(), 0.5, 1e-9);
    // by default from zero to the largest in 3 ms
    DeviceCommand fresh;
    wanted.force = {9, 0, 0};
    for (int k = 0; k < 3; ++k) limit_command({}, 9, kTick, false, wanted, state, fresh);
    EXPECT_NEAR(fresh.force.x(), 9, 1e-6);
}

TEST(HapticSafety, WhatIsNoNumberBecomesNoForce) {
    SafetyState state;
    DeviceCommand output;
    output.force = {1, 2, 3};
    for (int field = 0; field < 4; ++field) {
        DeviceCommand wanted;
        wanted.force = {1, 0, 0};
        if (field == 0) wanted.force.y() = std::nan("");
        if (field == 1) wanted.torque.z() = 1e300 * 1e300;
        if (field == 2) wanted.at.x() = std::nan("");
        if (field == 3) wanted.stiffness[4] = std::nan("");
        limit_command({}, 3, kTick, false, wanted, state, output);
        EXPECT_EQ(output.force.norm(), 0);
        EXPECT_EQ(output.torque.norm(), 0);
        EXPECT_TRUE(output.at.allFinite());
    }
    EXPECT_EQ(state.safe_ticks, 4u);
}

// ---- a device that fails ----

// Presses 3 mm deep, then `fault` corrupts the samples. Returns the time in ms from the first corrupt sample
// until the hand gets no force. A spring that pulls sideways shows whether effects fall too.
template <typename Fault>
int ms_to_safe(Fault&& fault, WallRig* rig_out = nullptr) {
    WallRig rig(600);
    rig.tool.max_force = 3.3;
    rig.tool.limits = {};
    HapticEffect spring;
    spring.kind = EffectKind::kSpringPoint;
    spring.stiffness = 50;
    spring.point = {0.02, 0, 0};
    rig.effects = {spring};
    for (int k = 0; k <= 200; ++k) rig.sample(rig.at({0, 0, 0.005 - std::min(k, 100) * 5e-5}));
    EXPECT_GT(rig.force().z(), 1.0);
    EXPECT_GT(rig.force().x(), 0.5);
    int safe = -1;
    for (int ms = 0; ms < 40; ++ms) {
        DeviceState s = rig.at({0, 0, 0});
        fault(ms, s);
        rig.sample(s);
        if (rig.force().norm() == 0 && safe < 0) safe = ms + 1;
        if (rig.force().norm() > 0) safe = -1;
        EXPECT_TRUE(rig.force().allFinite());
        EXPECT_LE(rig.force().norm(), 3.3);
    }
    if (rig_out) *rig_out = rig;
    return safe;
}

// T14: NaN, and 100 mm in one tick: zero force at the very next output.
TEST(HapticSafety, T14_NanAndGlitchGiveNoForceAtOnce) {
    EXPECT_EQ(ms_to_safe([](int, DeviceState& s) { s.position.x() = std::nan(""); }), 1);
    EXPECT_EQ(ms_to_safe([](int, DeviceState& s) { s.velocity.z() = 1e300 * 1e300; }), 1);
    EXPECT_EQ(ms_to_safe([](int, DeviceState& s) { s.orientation.w = std::nan(""); }), 1);
    EXPECT_EQ(ms_to_safe([](int, DeviceState& s) { s.position.x() += 0.1; }), 1);
    EXPECT_EQ(ms_to_safe([](int, DeviceState& s) { s.time -= 1; }), 1);
    // a single bad sample: a millisecond without force, then back over rise_time
    WallRig rig(0);
    EXPECT_EQ(ms_to_safe([](int ms, DeviceState& s) { s.position.x() += ms == 39 ? 0.1 : 0; }, &rig), 40);
    rig.sample(rig.at({0, 0, 0}));
    EXPECT_GT(rig.force().norm(), 0);
    EXPECT_LE(rig.force().norm(), 3.3 * kTick / rig.params.rise_time + 1e-9);
}

// T15: unplugged or stalled, so that the last sample only becomes older: zero force within 20 ms (13 with the
// present settings).
TEST(HapticSafety, T15_AStalledDeviceGivesNoForceWithin20Ms) {
    double frozen = 0;
    WallRig rig(0);
    const int ms = ms_to_safe(
        [&](int k, DeviceState& s) {
            if (k == 0) frozen = s.time - kTick;
            s.time = frozen;
        },
        &rig);
    EXPECT_GT(ms, 0);
    EXPECT_LE(ms, 13);
    // and when it comes back the force rises over rise_time, never by more than the corresponding fraction in
    // a tick
    double last = 0;
    for (int k = 0; k < 100; ++k) {
        rig.sample(rig.at({0, 0, 0}));
        EXPECT_LE(rig.force().norm() - last, 3.3 * kTick / rig.params.rise_time + 1e-9);
        last = rig.force().norm();
    }
    EXPECT_GT(last, 1.5);
}

// T04: 1 to 50 ticks are missing while the hand continues to press. Up to `silence` the device held its
// force, then it dropped it: no jump when the ticks come back, and finally the full force.
TEST(HapticSafety, T04_MissedTicksComeBackWithoutAKick) {
    for (int missed = 1; missed <= 50; ++missed) {
        WallRig rig(600);
        rig.tool.max_force = 3.3;
        rig.tool.limits = {};
        for (int k = 0; k <= 200; ++k) rig.sample(rig.at({0, 0, 0.005 - std::min(k, 100) * 5e-5}));
        const double before = rig.force().norm();
        rig.time += missed * kTick;
        const bool let_go = (missed + 1) * kTick > rig.params.silence + 1e-9;
        double last = let_go ? 0 : before;
        for (int k = 0; k < 120; ++k) {
            rig.sample(rig.at({0, 0, 0}));
            const double step = std::abs(rig.force().norm() - last);
            ASSERT_LE(step, let_go ? 3.3 * kTick / rig.params.rise_time + 1e-9 : 1e-9) << missed << " missed, tick " << k;
            last = rig.force().norm();
        }
        EXPECT_NEAR(last, before, 1e-6);
    }
}

// T13: the tool begins 8 mm inside: no force until it has been outside once, then normal contact.
TEST(HapticSafety, T13_AToolThatStartsInsideIsLeftAlone) {
    WallRig rig(600);
    for (int k = 0; k < 300; ++k) {
        rig.sample(rig.at({0, 0, -0.005 + 5e-5 * std::min(k, 280)}));
        ASSERT_EQ(rig.force().norm(), 0) << k;
    }
    for (int k = 0; k < 200; ++k) rig.sample(rig.at({0, 0, 0.009 - 5e-5 * k}));
    EXPECT_GT(rig.force().z(), 1);
}

// ---- passivity ----

// A device pressed against a wall by 1 N and disturbed by a short knock.
struct Knock {
    double early = 0, late = 0;  // m/s, highest speed in the first and in the last quarter of the run
};
Knock knock(double stiffness, uint32_t delay, double dissipation, double speed, double seconds, double encoder = 0, double friction = 0) {
    WallRig rig(stiffness);
    rig.model = reference::make_patch(reference::make_plane(2));
    rig.tool.hand = {};
    rig.tool.hand.mass = 0.1, rig.tool.hand.damping = 0.5, rig.tool.hand.delay = delay;
    rig.tool.hand.encoder = encoder, rig.tool.hand.friction = friction;
    rig.tool.limits.dissipation = dissipation;
    rig.params.force_slew = 1e12;
    rig.params.device_speed = 1e3;
    // the arm presses with a force: a far path position at the end of a soft spring
    rig.tool.hand.stiffness = 1e-6;
    DeviceState push = pose_at({0, 0, -1e6});
    // touches from outside, held until it is at the equilibrium of forces
    HandTool held = rig.tool;
    std::swap(rig.tool.hand.mass, held.hand.mass);
    for (int k = 0; k <= 200; ++k) rig.tick(pose_at({0, 0, kRadius + 1e-3 - std::min(k, 100) * 1e-2 * (1e-3 + 1 / stiffness)}));
    rig.tool.hand.mass = held.hand.mass = 0.1;
    rig.hand.placed = true;
    rig.hand.position = rig.hand.reported = {0, 0, kRadius - 1 / stiffness};
    rig.hand.velocity = {0, 0, speed};
    rig.hand.force.fill(rig.force());
    Knock found;
    const int ticks = static_cast<int>(seconds / kTick);
    for (int k = 0; k < ticks; ++k) {
        rig.tick(push);
        if (k < ticks / 4) found.early = std::max(found.early, rig.hand.velocity.norm());
        if (k >= 3 * ticks / 4) found.late = std::max(found.late, rig.hand.velocity.norm());
    }
    return found;
}

// T01: the stiffest wall for which a device of mass m and damping b is stable under a period T and a delay
// t_d is b / (T/2 + t_d) (Colgate & Schenkel; Gil 2009): below it a small disturbance decays, above it it
// grows. The limit is found by bisection for the whole tick.
TEST(HapticSafety, T01_ZWidthIsThatOfTheory) {
    for (const uint32_t delay : {0u, 1u, 2u}) {
        const double theory = 0.5 / (0.5e-3 + delay * 1e-3);
        const auto grows = [&](double share) {
            const Knock k = knock(share * theory, delay, 0, 1e-4, 1.6);
            return k.late > k.early;
        };
        EXPECT_FALSE(grows(0.5)) << delay;
        EXPECT_TRUE(grows(2)) << delay;
        double quiet = 0.5, loud = 2;
        for (int k = 0; k < 9; ++k) {
            const double middle = 0.5 * (quiet + loud);
            (grows(middle) ? loud : quiet) = middle;
        }
        std::printf("delay %u: stiffest quiet wall %.1f N/m, theory %.1f\n", delay, quiet * theory, theory);
        EXPECT_GT(quiet, 0.95) << delay;
        EXPECT_LT(quiet, 1.05) << delay;
    }
}

// and above it the controller takes back the energy that sampling generates: the oscillation stays a fraction
// of the uncontrolled one.
TEST(HapticSafety, T01_TheControllerLimitsShakingBeyond) {
    for (const uint32_t delay : {0u, 1u, 2u}) {
        const double stiffness = 2 * 0.5 / (0.5e-3 + delay * 1e-3);
        const double alone = knock(stiffness, delay, 0, 0.05, 6).late, limited = knock(stiffness, delay, 10, 0.05, 6).late;
        std::printf("2 x theory, delay %u: %.4f m/s alone, %.4f with the controller\n", delay, alone, limited);
        EXPECT_LT(limited, 0.1 * alone) << delay;
    }
}

// T02: with encoder and dry friction, walls up to min(2 b / T, 2 fc / step) are quiet (Abbott & Okamura
// 2005).
TEST(HapticSafety, T02_EncoderStepsBelowTheFrictionLimitAreQuiet) {
    const double step = 0.055e-3, friction = 0.02;
    const double quiet = std::min(2 * 0.5 / kTick, 2 * friction / step);
    for (const double share : {0.5, 0.9}) {
        const Knock k = knock(share * quiet, 0, 0, 0.02, 6, step, friction);
        EXPECT_LT(k.late, 1e-3) << share;
        EXPECT_GT(k.early, 0.005) << share;
    }
}

// An encoder without dry friction: up to half of b / (T/2 + t_d) the device shakes by at most its encoder's step.
TEST(HapticSafety, T02_AnEncoderWithoutFrictionCostsHalf) {
    for (const double step : {2e-5, 5e-5, 1e-4})
        for (const uint32_t delay : {0u, 1u, 3u}) {
            const double stiffness = 0.5 * 0.5 / (0.5e-3 + delay * 1e-3), rate = std::sqrt(stiffness / 0.1);
            EXPECT_LT(knock(stiffness, delay, 0, 0.02, 12, step).late, step * rate) << step << " m, delay " << delay;
        }
}

// Beyond that a hand gets energy back. Encoder steps hide it from a velocity; the observer, which sees only reported
// positions, books what the device really got.
TEST(HapticSafety, TheObserverBooksWhatEncodersReport) {
    for (const double stiffness : {4000.0, 6000.0, 8000.0}) {
        WallRig rig(stiffness);
        rig.model = reference::make_patch(reference::make_plane(2));
        rig.params.device_speed = 1e3, rig.params.force_slew = 1e12;
        HandModel& hand = rig.tool.hand = {};
        hand.mass = 0.1, hand.damping = 0.5, hand.stiffness = 300, hand.encoder = 5e-5;
        double given = 0, most = 0;
        for (int k = 0; k < 4000; ++k) {
            const Vec3d force = rig.state.output.force, before = rig.hand.position;
            rig.tick(pose_at({0, 0, kRadius + 0.002 - 6e-5 * std::min(k, 200)}));
            if (k > 0) most = std::max(most, given += force.dot(rig.hand.position - before));
        }
        std::printf("%.0f N/m: the hand got %.2f mJ, %.2f mJ booked\n", stiffness, 1e3 * most, -1e3 * rig.state.safety.lowest_energy);
        EXPECT_GT(-rig.state.safety.lowest_energy, 0.8 * most) << stiffness;
    }
}

// Poking for a while with an arm: the energy that the device's force gives the hand never exceeds a
// millijoule.
TEST(HapticSafety, PokingStaysPassive) {
    WallRig rig(600);
    rig.tool.hand = {};
    rig.tool.hand.mass = 0.2, rig.tool.hand.damping = 0.5, rig.tool.hand.stiffness = 150, rig.tool.hand.arm_damping = 4;
    rig.tool.coupling_damping = 2;
    rig.tool.max_force = 3.3;
    double given = 0;
    for (int k = 0; k < 60'000; ++k) {
        const double angle = 2 * M_PI * 1.3 * k * kTick;
        DeviceState intended = pose_at({0.01 * std::sin(0.3 * angle), 0, 0.002 + 0.008 * std::cos(angle)});
        intended.velocity = {0.003 * 2 * M_PI * 1.3 * std::cos(0.3 * angle), 0, -0.008 * 2 * M_PI * 1.3 * std::sin(angle)};
        rig.tick(intended);
        given = std::max(given, rig.energy);
    }
    std::printf("60 s of poking: at most %.4f mJ given, observer's least %.4f mJ\n", given * 1e3, rig.state.safety.lowest_energy * 1e3);
    EXPECT_LT(given, 1e-3);
    EXPECT_GT(rig.state.safety.lowest_energy, -1e-3);
}

// T03: the same with ticks up to a fifth of a period early or late.
TEST(HapticSafety, T03_JitterOfAFifthStaysPassive) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> jitter(0.8, 1.2);
    WallRig rig(600);
    rig.tool.hand = {};
    rig.tool.hand.mass = 0.2, rig.tool.hand.damping = 0.5, rig.tool.hand.stiffness = 150, rig.tool.hand.arm_damping = 4;
    double given = 0, contacts = 0, phase = 0;
    for (int k = 0; k < 30'000; ++k) {
        const double elapsed = kTick * jitter(random);
        phase += 2 * M_PI * 1.3 * elapsed;
        DeviceState intended = pose_at({0, 0, 0.002 + 0.008 * std::cos(phase)});
        intended.velocity = {0, 0, -0.008 * 2 * M_PI * 1.3 * std::sin(phase)};
        rig.tick(intended, elapsed);
        contacts += rig.state.contacts > 0;
        given = std::max(given, rig.energy);
    }
    EXPECT_GT(contacts, 5000);
    EXPECT_LT(given, 1e-3);
    EXPECT_GT(rig.state.safety.lowest_energy, -1e-3);
}

// The same for ten minutes of simulated time.
TEST(HapticSafety, LongTenMinutesOfPokingStayPassive) {
    WallRig rig(600);
    rig.model = reference::make_patch(reference::make_plane(2));
    rig.tool.hand = {};
    rig.tool.hand.mass = 0.2, rig.tool.hand.damping = 0.5, rig.tool.hand.stiffness = 150, rig.tool.hand.arm_damping = 4;
    rig.tool.max_force = 3.3;
    double given = 0;
    for (int k = 0; k < 600'000; ++k) {
        const double angle = 2 * M_PI * 1.3 * k * kTick;
        DeviceState intended = pose_at({0, 0, 0.002 + 0.008 * std::cos(angle)});
        intended.velocity = {0, 0, -0.008 * 2 * M_PI * 1.3 * std::sin(angle)};
        rig.tick(intended);
        given = std::max(given, rig.energy);
    }
    std::printf("600 s of poking: at most %.4f mJ given, observer's least %.4f mJ\n", given * 1e3, rig.state.safety.lowest_energy * 1e3);
    EXPECT_LT(given, 1e-3);
    EXPECT_GT(rig.state.safety.lowest_energy, -1e-3);
}

// T05: the simulation publishes 33, 66 or 100 ms late. A surface at constant velocity is felt at its true
// position; an accelerating one has the position error of constant-velocity extrapolation: force error =
// stiffness acceleration age^2 / 2.
TEST(HapticSafety, T05_ALateSimulationErrsAsMuchAsTheSurfaceAccelerated) {
    const double rate = 0.01, acceleration = 0.2;  // m/s, m/s^2
    for (const double late : {0.033, 0.066, 0.1}) {
        for (const double gain : {0.0, acceleration}) {
            WallRig rig(600);
            rig.params.greatest_age = 0.2;
            double worst = 0;
            for (int k = 0; k < 400; ++k) {
                const double now = rig.time + kTick, from = std::max(0.0, now - late);
                const double speed = rate + gain * from;
                rig.model = reference::make_patch(reference::make_plane(2));
                rig.model.time = from;
                for (Vec3d& p : rig.model.position) p.z() = rate * from + 0.5 * gain * from * from;
                rig.model.velocity.assign(rig.model.position.size(), Vec3d(0, 0, speed));
                group_triangles(rig.model);
                const double true_height = rate * now + 0.5 * gain * now * now;
                rig.sample(rig.at({0, 0, std::max(true_height + kRadius - 1e-3, 0.01 - 1e-4 * k)}));
                if (k < 250) continue;
                const double true_force = 600 * std::max(0.0, true_height + kRadius - rig.state.device.position.z());
                worst = std::max(worst, std::abs(rig.force().z() - true_force));
            }
            EXPECT_NEAR(worst, 600 * 0.5 * gain * late * late, 1e-6 + 0.02 * worst) << late << " s late";
        }
    }
}

// The observer against its own energy accounting: a spring that is released later than it was loaded
// generates energy, and the controller takes it back in proportion to speed, never beyond its limit.
TEST(HapticSafety, TheObserverCountsWhatACouplingGives) {
    const Vec3d z = Vec3d::UnitZ(), still = Vec3d::Zero();
    // the force is the coupling's
    const auto tick = [&](double damping, const Vec3d& device, const Vec3d& velocity, const Vec3d& proxy, const Vec3d& force,
                          SafetyState& state) {
        return dissipate({damping, 1e9}, kTick, {device, velocity, proxy}, force, force, state);
    };
    SafetyState state;
    tick(10, still, still, still, still, state);
    tick(10, -1e-3 * z, still, still, 2 * z, state);  // 1 mm in without force, then 2 N
    EXPECT_EQ(state.energy, 0);
    Vec3d f = tick(10, still, 0.5 * z, still, z, state);  // back out under 2 N: 2 mJ generated
    EXPECT_NEAR(state.lowest_energy, -2e-3, 1e-15);
    EXPECT_NEAR(f.z(), 1 - 2e-3 / (kTick * 0.25) * 0.5, 1e-12);
    EXPECT_NEAR(state.dissipated, 2e-3, 1e-15);
    tick(10, 0.5e-3 * z, still, still, still, state);  // back once the device reports the way that it damped
    EXPECT_NEAR(state.energy, -2e-3 - f.z() * 0.5e-3, 1e-15);
    // 8 mJ would need more damping than allowed: the rest stays a debt
    SafetyState deep;
    tick(10, -4e-3 * z, still, still, 2 * z, deep);
    f = tick(10, still, 0.5 * z, still, z, deep);
    EXPECT_NEAR(f.z(), 1 - 10 * 0.5, 1e-12);
    EXPECT_NEAR(deep.energy, -8e-3, 1e-15);
    // and energy that the command limit prevents from being taken back stays too: 1 N more of 3.5 is all that
    // 2.5 N of limit allows
    SafetyState weak;
    const auto weak_tick = [&](const Vec3d& device, const Vec3d& velocity, const Vec3d& force) {
        return dissipate({10, 2.5}, kTick, {device, velocity, still}, force, force, weak);
    };
    weak_tick(-4e-3 * z, still, 2 * z);
    f = weak_tick(still, -0.5 * z, 1.5 * z);
    EXPECT_NEAR(f.z(), 2.5, 1e-9);
    EXPECT_NEAR(weak.dissipated, 1 * 0.5 * kTick, 1e-12);
    // a spring whose surface suddenly disappears gives its energy to the surface, and none to the hand
    SafetyState gone;
    for (int k = 0; k <= 1000; ++k) tick(0, -1e-6 * k * z, still, still, 600 * 1e-6 * k * z, gone);
    EXPECT_NEAR(gone.energy, 0.5 * 600 * 1e-6, 1e-6 * 600 * 1e-3);
    tick(0, -1e-3 * z, still, -1e-3 * z, still, gone);
    EXPECT_NEAR(gone.lowest_energy, 0, 1e-6);
    // a surface that moves with the hand generates nothing: the proxy's displacement counts too
    SafetyState moving;
    tick(10, still, still, z * 1e-3, 2 * z, moving);
    for (int k = 1; k < 100; ++k) tick(10, k * 1e-3 * z, z, (k + 1) * 1e-3 * z, 2 * z, moving);
    EXPECT_NEAR(moving.energy, 0, 1e-15);
}

// A force that lags: the coupling's spring relaxes with a surface that retreats under a resting hand, and the
// felt force follows later. The surface gets the spring's energy and the hand none, so none is generated. A
// hand that then moves out under the lagging force gets the energy of the lag, which counts. Breaks when both
// ends are accounted with one force.
TEST(HapticSafety, TheObserverBooksEachEndWithItsOwnForce) {
    const Vec3d z = Vec3d::UnitZ(), still = Vec3d::Zero();
    constexpr double k = 600, depth = 5e-3;
    SafetyState state;
    for (int i = 0; i <= 1000; ++i) {  // pressed in: k d^2 / 2 is stored
        const double d = depth * i / 1000;
        dissipate({0, 1e9}, kTick, {-d * z, still, still}, k * d * z, k * d * z, state);
    }
    for (int i = 1; i <= 10; ++i) {  // the surface retreats in 10 ms, the felt force falls by 0.1 N per ms
        const double d = depth * (10 - i) / 10;
        dissipate({0, 1e9}, kTick, {-depth * z, still, (-depth + d) * z}, k * d * z, (k * depth - 0.1 * i) * z, state);
    }
    const double step = depth / 1000;
    EXPECT_NEAR(state.lowest_energy, -1000 * 0.5 * k * step * step, 1e-12) << "what holding the force for each tick made";
    const double before = state.energy, lag = k * depth - 1;
    dissipate({0, 1e9}, kTick, {(1e-3 - depth) * z, still, (1e-3 - depth) * z}, still, (lag - 0.1) * z, state);
    EXPECT_NEAR(state.energy, before - lag * 1e-3, 1e-12);
}

}  // namespace
}  // namespace trocar
