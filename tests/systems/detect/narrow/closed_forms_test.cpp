// Motions and shapes of mass-spring systems with closed forms: each with its error and, where the step
// matters, its order of convergence.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "tests/reference/cached_run.hpp"
#include "tests/reference/measures.hpp"
#include "tests/systems/advance/tissue/spring_graph.hpp"
namespace trocar {
namespace {

constexpr double kG = 9.81;

// Largest error of a run with a step of 1 ms / per_ms, over `ms` milliseconds; error(t) evaluates the scene.
template <typename Error>
double worst_over(AdvanceScene& s, uint32_t ms, uint32_t per_ms, const Error& error) {
    double worst = 0;
    for (uint32_t n = 1; n <= ms; ++n) {
        s.advance(1, per_ms);
        worst = std::max(worst, error(n * 1e-3));
    }
    return worst;
}

// x = a cos(omega t) of one mass between two fixed ones: second order in the step down to float rounding.
TEST(ClosedForms, OneMassSecondOrder) {
    double error[2];
    const double m = 0.02, k = 140, a = 0.01, omega = std::sqrt(2 * k / m);
    for (const uint32_t per_ms : {1u, 2u}) {
        AdvanceScene s;
        s.params.gravity.setZero();
        add_graph(s, {{{-1, 0, 0}, {a, 0, 0}, {1, 0, 0}}, {0, m, 0}, {{0, 1}, {1, 2}}, 1.0, k});
        error[per_ms - 1] = worst_over(s, 200, per_ms, [&](double t) { return std::abs(s.offset(0, 1).x() - a * std::cos(omega * t)); });
    }
    const double order = std::log2(error[0] / error[1]);
    std::printf("one mass: error %.3g, %.3g of the amplitude, order %.2f\n", error[0] / a, error[1] / a, order);
    EXPECT_NEAR(order, 2, 0.15);
    // phase error of the leapfrog: omega t (omega dt)^2 / 24
    EXPECT_NEAR(error[0] / a, omega * 0.2 * std::pow(omega * 1e-3, 2) / 24, 0.1 * error[0] / a);
}

// Damped: x = a exp(-c t / 2) (cos w t + c / (2 w) sin w t), w = sqrt(omega^2 - c^2 / 4), for a force -c v / mass.
TEST(ClosedForms, DampedMass) {
    double error[2];
    const double m = 0.02, k = 35, a = 0.01, c = 12, w = std::sqrt(2 * k / m - c * c / 4);
    for (const uint32_t per_ms : {1u, 2u}) {
        AdvanceScene s;
        s.params.gravity.setZero();
        add_graph(s, {{{-1, 0, 0}, {a, 0, 0}, {1, 0, 0}}, {0, m, 0}, {{0, 1}, {1, 2}}, 1.0, k});
        s.bodies.tissue[0].damping = c;
        error[per_ms - 1] = worst_over(s, 200, per_ms, [&](double t) {
            return std::abs(s.offset(0, 1).x() - a * std::exp(-0.5 * c * t) * (std::cos(w * t) + 0.5 * c / w * std::sin(w * t)));
        });
    }
    std::printf("damped mass: error %.3g, %.3g of the amplitude, order %.2f\n", error[0] / a, error[1] / a, std::log2(error[0] / error[1]));
    // damping half before and half after the kick keeps the leapfrog's own error, a relative frequency error
    // of (w dt)^2 / 24, and w t exp(-c t / 2) is largest at t = 2 / c
    EXPECT_NEAR(error[0] / a, 2 * w / (c * std::numbers::e) * w * w * 1e-6 / 24, 0.1 * error[0] / a);
    EXPECT_NEAR(std::log2(error[0] / error[1]), 2, 0.1);
}

// Free ends: omega_j = 2 sqrt(k/m) sin(j pi / 2N), shape cos((i + 1/2) j pi / N).
TEST(ClosedForms, ChainWithFreeEnds) {
    constexpr int kMasses = 9;
    for (const int mode : {1, 5, 8}) {
        AdvanceScene s;
        s.params.gravity.setZero();
        SpringGraph g{{}, std::vector<double>(kMasses, 0.02), {}, 0.1, 35};
        const double a = 1e-3, omega = 2 * std::sqrt(35 / 0.02) * std::sin(mode * std::numbers::pi / (2 * kMasses));
        const auto shape = [&](int i) { return a * std::cos((i + 0.5) * mode * std::numbers::pi / kMasses); };
        for (int i = 0; i < kMasses; ++i) {
            g.position.push_back({0.1 * i - 0.4 + shape(i), 0, 0});
            if (i > 0) g.edge.push_back({static_cast<uint32_t>(i - 1), static_cast<uint32_t>(i)});
        }
        add_graph(s, g);
        const double phase = 2 * std::asin(0.5 * omega * 1e-3);  // of the leapfrog, exactly
        for (int n = 1; n <= 200; ++n) {
            s.advance(1, 1);
            for (int i = 0; i < kMasses; ++i)
                EXPECT_NEAR(s.offset(0, i).x() - (0.1 * i - 0.4), shape(i) * std::cos(n * phase), 5e-3 * a) << mode << " " << n;
        }
    }
}

void settle(AdvanceScene& s, double damping, int seconds) {
    for (Tissue& t : s.bodies.tissue) t.damping = damping;
    for (int n = 0; n < 10 * seconds; ++n) s.advance(100, 100);
}

// Vertical chain of N masses under the first: the end sinks by m g N (N + 1) / 2k; a bar of the same weight and stiffness
// by rho g L^2 / 2E, the limit of many masses.
TEST(ClosedForms, HangingChainAndBar) {
    for (const uint32_t masses : {4u, 12u}) {
        AdvanceScene s;
        const double m = 0.02, k = 300;
        SpringGraph g{{{0, 0, 0}}, {0}, {}, 0.05, k};
        for (uint32_t i = 1; i <= masses; ++i) {
            g.position.push_back({0, 0, -0.05 * i});
            g.mass.push_back(m);
            g.edge.push_back({i - 1, i});
        }
        add_graph(s, g);
        settle(s, 15, 4);
        const double sunk = -0.05 * masses - s.offset(0, masses).z(), expected = m * kG / k * masses * (masses + 1) / 2;
        EXPECT_NEAR(sunk, expected, 1e-4 * expected);
        const double length = 0.05 * masses, rho = m * masses / length, modulus = k * 0.05;  // per area
        const double bar = rho * kG * length * length / (2 * modulus);
        EXPECT_NEAR(sunk / bar, 1 + 1.0 / masses, 2e-4);
        std::printf("hanging chain of %u: %.6g m, closed form %.6g m, bar %.6g m\n", masses, sunk, expected, bar);
    }
}

// Between two supports: the horizontal pull H is the same in all links, the slopes' tangents step by m g / H,
// and a link is as long as its pull makes it.
TEST(ClosedForms, DiscreteCatenary) {
    AdvanceScene s;
    constexpr uint32_t kLinks = 11;
    const double m = 0.01, k = 400, rest = 0.1;
    SpringGraph g{{}, {}, {}, rest, k};
    for (uint32_t i = 0; i <= kLinks; ++i) {
        g.position.push_back({0.085 * i - 0.5, 0, -0.2 * std::sin(std::numbers::pi * i / kLinks)});
        g.mass.push_back(i == 0 || i == kLinks ? 0 : m);
        if (i > 0) g.edge.push_back({i - 1, i});
    }
    add_graph(s, g);
    settle(s, 8, 8);
    double pull[kLinks], tangent[kLinks];
    for (uint32_t i = 0; i < kLinks; ++i) {
        const Vec3d d = s.offset(0, i + 1) - s.offset(0, i);
        const double tension = k * (d.norm() - rest);
        pull[i] = tension * d.x() / d.norm();
        tangent[i] = d.z() / d.x();
        const double vertical = pull[i] * tangent[i];
        EXPECT_NEAR(d.norm(), rest + std::sqrt(pull[i] * pull[i] + vertical * vertical) / k, 1e-7);
    }
    double mean = 0;
    for (const double h : pull) mean += h / kLinks;
    // positions are accurate to a few ulp of 0.5 m, 3e-8: the pull to k times that over the length's slope
    for (const double h : pull) EXPECT_NEAR(h, mean, 1e-3 * mean);
    for (uint32_t i = 0; i + 1 < kLinks; ++i) EXPECT_NEAR(tangent[i + 1] - tangent[i], m * kG / mean, 2e-3 * m * kG / mean) << i;
    std::printf("catenary: horizontal pull %.6g N, tangents step by %.5g, m g / H = %.5g\n", mean, tangent[5] - tangent[4], m * kG / mean);
}

// T = 4 sqrt(L/g) K(sin(theta / 2)): at 60 and 90 degrees. The rod is a stiff spring that carries the weight at rest.
TEST(ClosedForms, Pendulum) {
    const double m = 0.1, k = 2e5, length = 0.25;
    for (const double degrees : {60.0, 90.0}) {
        AdvanceScene s;
        const double angle = degrees * std::numbers::pi / 180;
        add_graph(s, {{{0, 0, 0}, {length * std::sin(angle), 0, -length * std::cos(angle)}}, {0, m}, {{0, 1}}, length, k});
        const double expected = 4 * std::sqrt(length / kG) * std::comp_ellint_1(std::sin(angle / 2));
        // two passages of the lowest point in the same direction, times interpolated
        double times[2], before = s.offset(0, 1).x();
        int passes = 0;
        for (int n = 1; passes < 2; ++n) {
            s.advance(1, 2);
            const double x = s.offset(0, 1).x();
            if (before > 0 && x <= 0) times[passes++] = (n - 1 + before / (before - x)) * 1e-3;
            before = x;
            ASSERT_LT(n, 5000);
        }
        std::printf("pendulum at %g degrees: T %.6f s, closed form %.6f s, T/T0 %.4f\n", degrees, times[1] - times[0], expected,
                    expected / (2 * std::numbers::pi * std::sqrt(length / kG)));
        // the rod is longer by at most 3 m g / k: 1.5e-5 of its length, half of it in the period; the step adds (omega dt)^2 / 24
        EXPECT_NEAR(times[1] - times[0], expected, 4e-5 * expected) << degrees;
    }
}

// M06. A mass a million times heavier: momentum is kept, and the heavy one does not move erratically.
TEST(ClosedForms, M06_MassRatioOfAMillion) {
    AdvanceScene s;
    s.params.gravity.setZero();
    const double light = 1e-5, heavy = 10, k = 0.5;
    add_graph(s, {{{0, 0, 0}, {0.101, 0, 0}}, {heavy, light}, {{0, 1}}, 0.1, k});
    s.set_velocity(0, 1, {0, 0.2, 0});
    for (int n = 0; n < 1000; ++n) s.advance(1, 1);
    const Vec3d momentum = heavy * s.velocity(0, 0) + light * s.velocity(0, 1);
    // one rounding of the heavy one's velocity per step
    EXPECT_NEAR(momentum.x(), 0, 1e-6 * light);
    EXPECT_NEAR(momentum.y(), 0.2 * light, 1e-4 * light);
    EXPECT_LT(s.offset(0, 0).norm(), 1e-6);
    EXPECT_EQ(s.report.nonfinite_particles, 0u);
}

// A million steps of a free, undamped block: no trend in energy, momentum to rounding.
TEST(LongClosedForms, M22_AMillionStepsKeepEnergyAndMomentum) {
    AdvanceScene s;
    s.params.gravity.setZero();
    SpringGraph g = block_graph(2, 0.1, 0.5, 50);
    std::fill(g.mass.begin(), g.mass.end(), 0.5 / 27);
    add_graph(s, g);
    for (uint32_t v = 0; v < 27; ++v)
        s.set_velocity(0, v, Vec3d(1, 3, 2).cross(g.position[v]) + Vec3d(g.position[v].x(), 0, -g.position[v].z()));
    s.open_energy_account();
    const Momentum start = measure_momentum(s.bodies, s.poses, s.particles, 0);
    const double energy = s.energy.kinetic + s.energy.elastic;
    double early = 0, late = 0, worst = 0;
    for (int block = 0; block < 1000; ++block) {
        s.advance(1000, 1000);
        s.measure();
        const double change = (s.energy.kinetic + s.energy.elastic) / energy - 1;
        worst = std::max(worst, std::abs(change));
        (block < 100 ? early : late) += block < 100 || block >= 900 ? change / 100 : 0;
    }
    const Momentum end = measure_momentum(s.bodies, s.poses, s.particles, 0);
    std::printf("a million steps: worst change of energy %.3g, drift %.3g; momentum %.2g N s, angular %.2g of it\n", worst, late - early,
                (end.linear - start.linear).norm(), (end.angular - start.angular).norm() / start.angular.norm());
    EXPECT_LT(worst, 0.01);
    EXPECT_LT(std::abs(late - early), 2e-3);
    EXPECT_LT((end.linear - start.linear).norm(), 1e-5 * 0.5);
    EXPECT_LT((end.angular - start.angular).norm(), 1e-2 * start.angular.norm());
}

// A free body drifts at 1 mm/s for 10 s, calls of 16 ms in steps of 0.5 ms: it arrives within 1e-4 of its 10
// mm, though a step is 67 units in the last place of its floats and a call rounds its positions once.
TEST(ClosedForms, TenSecondsAtAMillimetreASecond) {
    AdvanceScene s;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.1, 2)), Motion::kDeformable, Vec3d::Zero(), {}, AnchorFrame::kShape);
    s.bodies.tissue[body].damping = 0;
    s.params.gravity.setZero();
    const uint32_t count = s.meshes.info[0].vertices.count;
    const auto middle = [&] {
        Vec3d sum = Vec3d::Zero();
        for (uint32_t v = 0; v < count; ++v) sum += s.offset(body, v) / count;
        return sum;
    };
    for (uint32_t v = 0; v < count; ++v) s.set_velocity(body, v, Vec3d(1e-3, 0, 0));
    const Vec3d start = middle();
    for (int pass = 0; pass < 625; ++pass) s.advance(16, 32);
    const Vec3d displacement = middle() - start;
    std::printf("10 s at 1 mm/s: %.7f mm\n", displacement.x() * 1e3);
    EXPECT_NEAR(displacement.x(), 0.01, 1e-4 * 0.01);
    EXPECT_NEAR(displacement.y(), 0, 1e-4 * 0.01);
    EXPECT_NEAR(displacement.z(), 0, 1e-4 * 0.01);
}

// The cached reference is used only if it is complete and of the same run.
TEST(CachedReference, IsCheckedByItsHashAndItsParameters) {
    const std::filesystem::path folder = std::filesystem::temp_directory_path() / ("trocar_cached_" + std::to_string(getpid()));
    std::filesystem::remove_all(folder);
    AdvanceScene s;
    const SpringGraph graph = block_graph(2, 0.05, 0.1, 50);
    add_graph(s, graph);
    reference::Run run{"block", double_copy(s, 0, graph), 1e-4, 10, 5, [](double t) { return 9.81 * std::min(1.0, 100 * t); }};
    bool worked_out = false;
    const auto frames = [&] { return reference::cached_frames(folder, run, &worked_out); };
    const reference::Frames first = frames();
    EXPECT_TRUE(worked_out);
    EXPECT_LT(first.back()[0].z(), graph.position[0].z() - 1e-6) << "it moves";
    EXPECT_EQ(frames(), first);
    EXPECT_FALSE(worked_out);
    run.body.stiffness *= 1.01;
    EXPECT_NE(frames(), first);
    EXPECT_TRUE(worked_out);
    run.body.stiffness = 50;
    run.weight = [](double t) { return 9.81 * std::min(1.0, 101 * t); };
    EXPECT_NE(frames(), first);
    EXPECT_TRUE(worked_out);
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
        file.seekp(200);
        file.put('x');
    }
    const reference::Frames again = frames();
    EXPECT_TRUE(worked_out) << "a flipped byte is seen";
    EXPECT_EQ(frames(), again);
    EXPECT_FALSE(worked_out);
    std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace trocar
