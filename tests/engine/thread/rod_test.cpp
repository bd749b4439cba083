#include "engine/thread/rod.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
namespace trocar {
namespace {

constexpr double kWeightPerMass = 9.81;

// One thread of points at even distances along x.
struct TestRod {
    Thread thread;
    ThreadState state;
    RodScratch scratch;
    std::vector<Vec3d> place;  // m, of what holds it

    TestRod(uint32_t points, double spacing) {
        thread.spacing = spacing, thread.rows = {0, points + 60}, thread.most_bites = 10;
        state.count = {points};
        state.material.resize(thread.rows.count), state.held.resize(thread.rows.count, kNone),
            state.touching.resize(size_t{kTouchesPerPoint} * thread.rows.count, kNone);
        state.position.resize(thread.rows.count, Vec3d::Zero()), state.velocity.resize(thread.rows.count, Vec3d::Zero());
        for (uint32_t i = 0; i < points; ++i) state.material[i] = i * spacing, state.position[i] = Vec3d(i * spacing, 0, 0);
    }
    Rod rod() { return rod_of(thread, 0, state); }
    uint32_t last() const { return state.count[0] - 1; }
    uint32_t hold(const Vec3d& at, double stiffness, bool slides = false) {
        ThreadHold hold;
        hold.stiffness = stiffness, hold.slides = slides;
        state.hold.push_back(hold), place.push_back(at);
        return static_cast<uint32_t>(state.hold.size() - 1);
    }
    void hold_point(uint32_t i, double stiffness) { state.held[i] = hold(state.position[i], stiffness); }
    RodStep step(double dt, double gravity = kWeightPerMass) {
        return step_rod(thread, {0, 0, -gravity}, dt, rod(), state.hold, place, {}, scratch);
    }
    uint32_t row_of(uint32_t hold) const {
        for (uint32_t i = 0; i <= last(); ++i)
            if (state.held[i] == hold) return i;
        return kNone;
    }
    double energy(double gravity = kWeightPerMass) { return energy_of_rod(thread, rod(), state.hold, {0, 0, -gravity}).sum(); }
};

TEST(Rod, HangsAsACatenary) {
    TestRod t(101, 2e-3);
    // stretched by 0.06 %, and so thin that it bends over 1.5 mm
    t.thread.youngs_modulus = 1e7, t.thread.damping = 30, t.thread.density = 8000, t.thread.radius = 1e-5;
    t.hold_point(0, 10), t.hold_point(100, 10);
    for (int k = 0; k < 3000; ++k) {
        if (k < 500) t.place[1].x() = 0.2 - 0.05 * (k + 1) / 500.0;
        t.step(1e-3);
    }
    // span s and length l: 2 a sinh(s / 2a) = l
    double low = 0.01, high = 1;
    for (int k = 0; k < 100; ++k) {
        const double a = 0.5 * (low + high);
        (2 * a * std::sinh(0.075 / a) > 0.2 ? low : high) = a;
    }
    const double sag = low * (std::cosh(0.075 / low) - 1);
    EXPECT_NEAR(-t.state.position[50].z(), sag, 3e-3 * sag);
    EXPECT_NEAR(tension_of(t.thread, t.rod(), 50), low * mass_per_length(t.thread) * kWeightPerMass,
                5e-3 * low * mass_per_length(t.thread) * kWeightPerMass);
}

TEST(Rod, StretchesUnderItsOwnWeight) {
    TestRod t(51, 2e-3);
    t.thread.youngs_modulus = 1e6, t.thread.damping = 200;
    for (uint32_t i = 0; i < 51; ++i) t.state.position[i] = Vec3d(0, 0, -2e-3 * i);
    t.hold_point(0, 1e6);
    for (int k = 0; k < 3000; ++k) t.step(1e-3);
    const double length = 0.1, stretch = t.thread.density * kWeightPerMass * length * length / (2 * t.thread.youngs_modulus);
    EXPECT_NEAR(-t.state.position[50].z() - length, stretch, 1e-3 * stretch);
}

// A clamp holds two points: it is in the middle between them.
double tip_of_cantilever(double spacing, double load) {
    const auto pieces = static_cast<uint32_t>(std::lround(0.04 / spacing));
    TestRod t(pieces + 1, spacing);
    t.thread.damping = 200;
    t.hold_point(0, 1e7), t.hold_point(1, 1e7);
    const double gravity = load * flexural_rigidity(t.thread) / (mass_per_length(t.thread) * std::pow(0.04 - 0.5 * spacing, 3));
    for (int k = 0; k < 3000; ++k) t.step(1e-3, gravity);
    return -t.state.position[pieces].z() / (0.04 - 0.5 * spacing);
}

// Deflection of an inextensible cantilever under its own weight q: theta'' = q/B (l - s) cos theta, by shooting.
double elastica(double load) {
    const auto shoot = [&](double curvature, double* deflection) {  // unit length; returns the curvature at the tip
        constexpr int kSteps = 20000;
        const double h = 1.0 / kSteps;
        double theta = 0, rate = curvature, z = 0;
        for (int k = 0; k < kSteps; ++k) {
            const double s = (k + 0.5) * h, middle = theta + 0.5 * h * rate;
            rate -= h * load * (1 - s) * std::cos(middle);
            z += h * std::sin(middle);
            theta += h * rate;
        }
        if (deflection) *deflection = z;
        return rate;
    };
    double low = 0, high = load;
    for (int k = 0; k < 60; ++k) (shoot(0.5 * (low + high), nullptr) > 0 ? high : low) = 0.5 * (low + high);
    double z = 0;
    shoot(low, &z);
    return z;
}

TEST(Rod, BendsAsAnElastica) {
    for (const double load : {0.5, 8.0}) {  // q l^3 / B: small, and more than half of its length down
        const double expected = elastica(load);
        EXPECT_NEAR(tip_of_cantilever(1e-3, load), expected, 0.01 * expected) << load;
    }
    EXPECT_NEAR(elastica(0.1), 0.1 / 8, 1e-4);
}

TEST(Rod, BucklesAtEulersLoad) {
    TestRod t(41, 1e-3);
    t.thread.damping = 500;
    for (uint32_t i = 0; i < 41; ++i) t.state.position[i].y() = 1e-6 * std::sin(std::numbers::pi * i / 40.0);
    t.hold_point(0, 1e5), t.hold_point(40, 1e5);
    const double euler = std::numbers::pi * std::numbers::pi * flexural_rigidity(t.thread) / (0.04 * 0.04);
    for (int k = 0; k < 6000; ++k) {
        t.place[1].x() = 0.04 - 1e-4 * std::min(1.0, (k + 1) / 500.0);
        t.step(1e-3, 0);
    }
    const double load = -t.state.hold[0].stiffness * (t.state.position[0].x() - t.place[0].x());
    // after it the load grows with the rise a: 1 + (pi a / 2 l)^2 / 2, with a from the shortening
    EXPECT_NEAR(std::abs(load), euler, 5e-3 * euler);
    EXPECT_GT(t.state.position[20].y(), 5e-4);
}

// A thread over a bite at the origin that turns by `angle`; its first end hangs on a weak spring, and the other is drawn.
struct Capstan : TestRod {
    Vec3d out;
    uint32_t bite, far;
    Capstan(double friction, double angle) : TestRod(41, 1e-3) {
        thread.friction = friction;
        const Vec3d in(-std::cos(0.5 * angle), 0, -std::sin(0.5 * angle));
        out = Vec3d(std::cos(0.5 * angle), 0, -std::sin(0.5 * angle));
        for (uint32_t i = 0; i < 41; ++i) state.position[i] = i <= 20 ? Vec3d((20.5 - i) * 1e-3 * in) : Vec3d((i - 20.5) * 1e-3 * out);
        bite = hold(Vec3d::Zero(), 1e4, true);
        EXPECT_TRUE(add_bite(thread, 20.5e-3, Vec3d::Zero(), bite, rod()));
        hold_point(0, 30), hold_point(last(), 1e5);
        place[1] += 0.01 * in;  // T = 0.3 N and more
        far = 2;
    }
    double turn() {
        const uint32_t b = row_of(bite);
        const Vec3d lower = (state.position[b] - state.position[b - 1]).normalized(),
                    upper = (state.position[b + 1] - state.position[b]).normalized();
        return std::acos(lower.dot(upper));
    }
};

TEST(Rod, SlidesByTheCapstanEquation) {
    for (const double friction : {0.0, 0.15, 0.4})
        for (const double angle : {0.3, 1.0, 2.0, 3.0}) {
            Capstan t(friction, angle);
            const Vec3d start = t.place[t.far];
            const double length = t.state.material[t.last()];
            double work = 0;
            for (int k = 0; k < 400; ++k) {
                t.place[t.far] = start + 0.02e-3 * (k + 1) * t.out;
                work += t.step(1e-3, 0).friction_work;
                EXPECT_EQ(refine_rod(t.thread, t.rod(), t.state.hold), 0u);
            }
            const ThreadHold& bite = t.state.hold[t.bite];
            EXPECT_NEAR(t.turn(), angle, 0.01);
            EXPECT_NEAR(bite.upper / bite.lower, std::exp(friction * angle), 5e-3 * std::exp(friction * angle)) << friction << " " << angle;
            EXPECT_GT(bite.passed, 6e-3) << "six spacings";
            EXPECT_DOUBLE_EQ(t.state.material[t.last()], length);
            EXPECT_TRUE(friction > 0 ? work < 0 : work > -1e-12) << work;
            // it turns round: it sticks until the tension has changed by the square of the capstan's ratio
            const double lower = bite.lower, ratio = std::exp(friction * angle);
            const double passed = bite.passed;
            double stuck = bite.upper;
            for (int k = 0; k < 4000 && bite.passed > passed - 1e-7; ++k) {
                t.place[t.far] -= 0.4e-6 * t.out;
                stuck = bite.upper;
                t.step(1e-3, 0);
            }
            EXPECT_NEAR(stuck, lower / ratio, 0.02 * lower) << friction << " " << angle;
        }
}

TEST(Rod, AKnotHoldsAndAnEndSlipsOff) {
    for (const bool knot : {true, false}) {
        Capstan t(0.2, 1.0);
        t.thread.knot = knot;
        t.state.held[0] = kNone;  // its first end is free
        const Vec3d start = t.place[t.far];
        uint32_t off = 0;
        for (int k = 0; k < 2500 && off == 0; ++k) {
            t.place[t.far] = start + 0.01e-3 * (k + 1) * t.out;
            EXPECT_TRUE(t.step(1e-3, 0).finite);
            off += refine_rod(t.thread, t.rod(), t.state.hold);
        }
        EXPECT_EQ(off, knot ? 0u : 1u);
        EXPECT_EQ(t.state.hold[t.bite].left, !knot);
        EXPECT_EQ(t.row_of(t.bite) == kNone, !knot);
        EXPECT_TRUE(!knot || t.state.hold[t.bite].upper > 2.0) << "drawn tight";
    }
}

// A loop round two posts, closed by a knot between them; both ends hang on weak springs, or on nothing.
struct TiedLoop : TestRod {
    uint32_t knot = 0, post[2]{};
    TiedLoop(uint32_t throws, uint32_t squared, bool loose) : TestRod(83, 1e-3) {
        thread.friction = 0.15, thread.most_bites = 4;
        for (uint32_t i = 0; i < 83; ++i) {
            const double s = i * 1e-3;
            state.position[i] = i <= 20   ? Vec3d(0, 0, 20e-3 - s)
                                : i <= 30 ? Vec3d(20e-3 - s, 0, 0)
                                : i <= 51 ? Vec3d(s - 41e-3, 0, 0)
                                : i <= 62 ? Vec3d(62e-3 - s, 0, 0)
                                          : Vec3d(0, 0, s - 62e-3);
        }
        const uint32_t stays = hold(Vec3d::Zero(), 0), slides = hold(Vec3d::Zero(), 0, true);
        state.hold[stays].tied = slides, state.hold[slides].tied = stays;
        state.hold[slides].throws = throws, state.hold[slides].squared = squared;
        state.held[20] = stays, state.held[62] = slides;
        knot = slides;
        if (!loose) {
            hold_point(0, 30), place.back().z() += 0.01;
            hold_point(last(), 30), place.back().z() += 0.01;
        }
        for (const int side : {0, 1}) {
            const Vec3d at(side ? 10.5e-3 : -10.5e-3, 0, 0);
            post[side] = hold(at, 1e4, true);
            EXPECT_TRUE(add_bite(thread, side ? 51.5e-3 : 30.5e-3, at, post[side], rod()));
        }
    }
    void draw(double far) {  // moves each post outwards, m
        place[post[0]].x() -= far, place[post[1]].x() += far;
    }
};

TEST(Rod, AKnotSlipsAtTheTensionThatItsThrowsHold) {
    const struct { uint32_t throws, squared; } cases[] = {{1, 0}, {2, 0}, {3, 0}, {2, 1}};
    for (const auto& [throws, squared] : cases) {
        TiedLoop t(throws, squared, false);
        const ThreadHold& knot = t.state.hold[t.knot];
        for (int k = 0; k < 600 && knot.passed > -1e-3; ++k) {
            t.draw(15e-6);
            t.step(1e-3, 0), refine_rod(t.thread, t.rod(), t.state.hold);
        }
        // one turn lets exp(2 pi mu) through; what presses on the ends has passed the throws that are not squared
        const double one = std::exp(0.15 * 2 * std::numbers::pi), pinch = squared ? 2 * 0.15 * std::pow(one, squared) : 0;
        const double expected = std::pow(one, throws) / (1 - pinch);
        EXPECT_LT(knot.passed, -0.5e-3) << "the loop grew";
        EXPECT_NEAR(knot.lower / knot.upper, expected, 0.02 * expected) << throws << " " << squared;
    }
}

TEST(Rod, ThreeSquareThrowsHoldFiveNewtonAndOneSlips) {
    const struct { uint32_t throws, squared; } cases[] = {{1, 0}, {3, 2}, {3, 0}};
    for (const auto& [throws, squared] : cases) {
        TiedLoop t(throws, squared, true);
        const ThreadHold& knot = t.state.hold[t.knot];
        for (int k = 0; k < 220; ++k) {
            t.draw(15e-6);
            EXPECT_TRUE(t.step(1e-3, 0).finite);
            refine_rod(t.thread, t.rod(), t.state.hold);
        }
        if (squared == 2) {
            EXPECT_GT(knot.lower, 5.0);
            EXPECT_EQ(knot.passed, 0.0);
        } else {  // only the inertia of its ends holds it
            EXPECT_LT(knot.lower, 0.5) << throws;
            EXPECT_LT(knot.passed, -4e-3) << throws;
        }
    }
}

// Backward Euler: without a hand the energy falls.
TEST(Rod, ASwingingThreadOnlyLosesEnergy) {
    TestRod t(61, 2e-3);
    t.thread.damping = 0;
    t.hold_point(0, 1e4);
    double before = t.energy(), first = before;
    const auto sum = [&] { return t.energy() + 0.5 * 1e4 * (t.state.position[0] - t.place[0]).squaredNorm(); };
    for (int k = 0; k < 500; ++k) {
        const RodStep step = t.step(1e-3);
        EXPECT_LT(step.iterations, 40u);
        const double now = sum();
        EXPECT_LE(now, before + 1e-9 * std::abs(first)) << k;
        before = now;
    }
    EXPECT_LT(before, first - 1e-7);
}

TEST(Rod, NumbersThatAreNoneAreTakenBack) {
    TestRod t(11, 1e-3);
    t.hold_point(0, 1e4);
    t.place[0].x() = std::nan("");
    const std::vector<Vec3d> before = t.state.position;
    EXPECT_FALSE(t.step(1e-3).finite);
    EXPECT_EQ(t.state.position, before);
}

}  // namespace
}  // namespace trocar
