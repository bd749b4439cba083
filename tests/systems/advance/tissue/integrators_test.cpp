#include <gtest/gtest.h>

#include <cstring>

#include "engine/base/cpu.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/tissue/stable_step.hpp"
#include "tests/reference/dense.hpp"
#include "tests/reference/measures.hpp"
#include "tests/systems/advance/tissue/spring_graph.hpp"
namespace trocar {
namespace {

void choose(AdvanceScene& s, Integrator integrator, uint32_t iterations, double step, double tolerance = 1e-6) {
    s.bodies.stepping.assign(s.bodies.mesh.size(), {integrator, iterations, tolerance, step});
}

bool same_state(const AdvanceScene& a, const AdvanceScene& b) {
    return 0 == std::memcmp(a.particles.offset.data(), b.particles.offset.data(), a.particles.offset.size() * sizeof(Float4)) &&
           a.particles.velocity_x == b.particles.velocity_x && a.particles.velocity_y == b.particles.velocity_y &&
           a.particles.velocity_z == b.particles.velocity_z;
}

// A sheet of springs of different lengths, its rim fixed, stretched evenly in its plane: every inner mass of
// a regular lattice is at rest by symmetry.
SpringGraph stretched_sheet(double stretch) {
    SpringGraph g = sheet_graph(9, 0.08, 0.02, 50);
    for (uint32_t j = 0; j < 9; ++j)
        for (uint32_t i = 0; i < 9; ++i) g.mass[9 * j + i] = i % 8 == 0 || j % 8 == 0 ? 0.0 : 0.02 / 81;
    if (stretch == 1) return g;
    for (Vec3d& p : g.position) p *= stretch;
    return g;
}

// Steps the body 400 times: true if no mass leaves by more than a hundredth of a spring.
bool stays_calm(const SpringGraph& graph, double stretch, double dt) {
    AdvanceScene s;
    s.params.gravity.setZero();
    add_graph(s, graph);
    for (float& rest : s.springs.rest_length) rest = static_cast<float>(rest / stretch);
    std::mt19937 random(5);
    std::uniform_real_distribution<float> shake(-1e-6f, 1e-6f);
    for (Float4& o : s.particles.offset) {
        if (o.w > 0) o.x += shake(random), o.y += shake(random), o.z += shake(random);
    }
    const uint32_t ticks = static_cast<uint32_t>(std::ceil(400 * dt * 1e3));
    s.advance(ticks, static_cast<uint32_t>(std::lround(ticks * 1e-3 / dt)));
    if (s.report.nonfinite_particles > 0) return false;
    for (uint32_t v = 0; v < graph.position.size(); ++v) {
        if ((s.offset(0, v) - graph.position[v]).norm() > 1e-4) return false;
    }
    return true;
}

// At rest and stretched by 30 %: the step is stable at 0.99 of the measured limit and not at 1.05, the
// measured limit matches the stiffest mode of the double Hessian, and the predicted step is 0.8 to 1 of it.
TEST(StableStep, PredictedAgainstMeasured) {
    for (const double stretch : {1.0, 1.3}) {
        const SpringGraph graph = stretched_sheet(stretch);
        AdvanceScene s;
        add_graph(s, graph);
        reference::DoubleBody b = double_copy(s, 0, graph);
        for (double& rest : b.rest_length) rest /= stretch;
        const double limit = 2 / std::sqrt(reference::stiffest_mode(b));
        EXPECT_TRUE(stays_calm(graph, stretch, 0.99 * limit)) << stretch;
        EXPECT_FALSE(stays_calm(graph, stretch, 1.05 * limit)) << stretch;
        const double predicted = s.bodies.stable_dt[0];
        EXPECT_LE(predicted, limit) << stretch;
        EXPECT_GE(predicted, 0.8 * limit) << stretch;
        std::printf("stretch %.1f: predicted / measured %.3f\n", stretch, predicted / limit);
    }
}

// The scalar bound against its dense matrix: Lanczos finds the largest eigenvalue, Gershgorin must not win.
TEST(StableStep, LanczosFindsTheLargestEigenvalue) {
    const SpringGraph graph = block_graph(5, 0.1, 1, 80);
    AdvanceScene s;
    add_graph(s, graph);
    const int n = static_cast<int>(graph.position.size());
    std::vector<double> diagonal(s.particles.offset.size());
    for (int i = 0; i < n; ++i) diagonal[i] = 3.0 * (i % 11);
    Eigen::MatrixXd k = Eigen::MatrixXd::Zero(n, n);
    for (int i = 0; i < n; ++i) k(i, i) = diagonal[i];
    for (const auto& [i, j] : graph.edge) k(i, i) += 80, k(j, j) += 80, k(i, j) -= 80, k(j, i) -= 80;
    double gershgorin = 0;
    for (int i = 0; i < n; ++i) {
        const double w = s.particles.offset[i].w;
        gershgorin = std::max(gershgorin, (2 * k(i, i) - diagonal[i]) * w);
        k.row(i) *= std::sqrt(w), k.col(i) *= std::sqrt(w);
    }
    const double expected = reference::largest_eigenvalue(k);
    const double found = stiffest_mode({s.springs.slice_column, s.springs.neighbour.data(), nullptr, 80, diagonal, s.particles.offset});
    EXPECT_NEAR(found, expected, 0.01 * expected);
    EXPECT_LE(found, expected * (1 + 1e-9));
    EXPECT_LT(found, 0.95 * gershgorin);
}

// M08. With damping c before the kick the header's formula is below the limit of a mass on two springs.
TEST(StableStep, M08_DampedLimit) {
    for (const double share : {0.98, 1.05}) {
        AdvanceScene s;
        s.params.gravity.setZero();
        const double omega = 2000, c = 300, m = 0.01;
        const uint32_t body =
            add_graph(s, {{{-1, 0, 0}, {0.0001, 0, 0}, {1, 0, 0}}, {0, m, 0}, {{0, 1}, {1, 2}}, 1.0, 0.5 * m * omega * omega});
        s.bodies.tissue[body].damping = c;
        update_stable_dt(s.springs, body, s.particles, s.anchors, s.bodies);
        const double explicit_limit = (std::sqrt(c * c + 4 * omega * omega) - c) / (omega * omega);
        EXPECT_NEAR(s.bodies.stable_dt[body], kStableShare * explicit_limit, 1e-6 * explicit_limit);
        // damping acts as exp(-c dt / 2) on the velocity before and after the kick: the recursion's limit is
        // (omega dt)^2 = 4 cosh(c dt / 2)
        double low = 0, high = 2e-3;
        for (int i = 0; i < 60; ++i) {
            const double t = 0.5 * (low + high);
            (omega * omega * t * t < 4 * std::cosh(0.5 * c * t) ? low : high) = t;
        }
        EXPECT_GE(low, explicit_limit);
        double most = 0;
        for (int n = 0; n < 20; ++n) {
            s.advance(10, static_cast<uint32_t>(std::lround(10e-3 / (share * low))));
            most = std::max(most, std::abs(s.offset(body, 1).x()));
        }
        EXPECT_EQ(most > 1e-3 || s.report.runaway_bodies > 0, share > 1) << share << " " << most;
    }
}

// M05: a body a million times stiffer gets a step a thousand times shorter, less what keeps the stiffer one from being heated by rounding,
// and is stable with it.
TEST(StableStep, M05_StiffnessRatioOfAMillion) {
    double dt[2];
    for (int i = 0; i < 2; ++i) {
        SpringGraph graph = block_graph(2, 0.1, 1, i ? 50e6 : 50);
        AdvanceScene s;
        s.params.gravity.setZero();
        const uint32_t body = add_graph(s, graph);
        dt[i] = s.bodies.stable_dt[body];
        s.particles.offset[0].x += 1e-5f;
        s.advance(10, static_cast<uint32_t>(std::ceil(10e-3 / dt[i])));
        EXPECT_EQ(s.report.nonfinite_particles, 0u);
        for (uint32_t v = 0; v < graph.position.size(); ++v) EXPECT_LT((s.offset(body, v) - graph.position[v]).norm(), 1e-4);
    }
    EXPECT_NEAR(dt[0] / dt[1], 1000 * kStableShare / kStiffShare, 1e-3);
}

// Along its springs the solution of an oscillator is known exactly: v' = (v - h w^2 x) / (1 + (h w)^2), x' = x + h v'.
TEST(BackwardEuler, OscillatorFollowsItsRecursionAtAnyStep) {
    for (const uint32_t ticks : {1u, 5u, 20u, 100u}) {
        AdvanceScene s;
        s.params.gravity.setZero();
        const double m = 0.02, k = 35, a = 0.01, omega2 = 2 * k / m, h = ticks * 1e-3;
        const uint32_t body = add_graph(s, {{{-1, 0, 0}, {a, 0, 0}, {1, 0, 0}}, {0, m, 0}, {{0, 1}, {1, 2}}, 1.0, k});
        choose(s, Integrator::kBackwardEuler, 10, 1);
        s.open_energy_account();
        const double energy = s.energy.kinetic + s.energy.elastic;
        EXPECT_NEAR(energy, k * a * a, 1e-5 * energy);
        double x = a, v = 0;
        for (int n = 1; n <= 200; ++n) {
            s.advance(ticks, 1);
            v = (v - h * omega2 * x) / (1 + h * h * omega2), x += h * v;
            ASSERT_NEAR(s.offset(body, 1).x(), x, 1e-4 * a) << ticks << " ms, step " << n;
        }
        s.measure();
        EXPECT_NEAR(s.energy.work_numeric, s.energy.kinetic + s.energy.elastic - energy, 1e-6 * energy);
        EXPECT_NEAR(s.energy.balance, 0, 1e-6 * energy);
        EXPECT_EQ(s.report.implicit_steps, 200u);
    }
}

// Errors of halved steps against a tiny double leapfrog: second order and first.
TEST(Integrators, ConvergeWithTheirOrder) {
    const SpringGraph graph = block_graph(4, 0.1, 0.5, 60);
    AdvanceScene first;
    add_graph(first, graph);
    reference::DoubleBody truth = double_copy(first, 0, graph);
    truth.gravity = Vec3d(0, 0, -9.81);
    for (int i = 0; i < 48000; ++i) reference::step(truth, 1e-6);
    const auto error = [&](Integrator integrator, uint32_t iterations, uint32_t substeps) {
        AdvanceScene s;
        add_graph(s, graph);
        choose(s, integrator, iterations, 1);
        s.advance(48, substeps);
        double sum = 0;
        for (uint32_t v = 0; v < graph.position.size(); ++v) sum += (s.offset(0, v) - truth.position[v]).squaredNorm();
        return std::sqrt(sum / static_cast<double>(graph.position.size()));
    };
    const struct {
        Integrator integrator;
        uint32_t iterations, substeps;
        double order, most;  // m; the block sinks by millimetres
    } cases[] = {{Integrator::kLeapfrog, 1, 24, 2, 1e-5}, {Integrator::kBackwardEuler, 100, 48, 1, 2e-4}};
    for (const auto& c : cases) {
        const double coarse = error(c.integrator, c.iterations, c.substeps), fine = error(c.integrator, c.iterations, 2 * c.substeps);
        const double order = std::log2(coarse / fine);
        std::printf("%d: %.3g m, %.3g m, order %.2f\n", static_cast<int>(c.integrator), coarse, fine, order);
        EXPECT_NEAR(order, c.order, 0.25);
        EXPECT_LT(coarse, c.most);
    }
}

// A free body falls with g under every integrator: following anchors must not hold it. It keeps its momentum.
TEST(Integrators, FreeBodyFallsAndKeepsItsMomentum) {
    AdvanceScene s;
    Tissue tissue;
    tissue.damping = 3;
    const uint32_t body =
        s.add_body(s.add_mesh(subdivided_sphere(0.05, 2, 0.1)), Motion::kDeformable, Vec3d::Zero(), tissue, AnchorFrame::kShape);
    choose(s, Integrator::kBackwardEuler, 30, 1);
    for (uint32_t v = 0; v < 162; ++v) {
        const Vec3d x = s.offset(body, v);
        s.set_velocity(body, v, Vec3d(1, 0.5, 2).cross(x) + Vec3d(0.1 * x.x(), 0, 0));
    }
    const Momentum start = measure_momentum(s.bodies, s.poses, s.particles, body);
    double mass = 0;
    for (const Float4& o : s.particles.offset)
        if (o.w > 0) mass += 1.0 / o.w;
    for (int n = 0; n < 50; ++n) s.advance(2, 1);
    const Momentum end = measure_momentum(s.bodies, s.poses, s.particles, body);
    EXPECT_NEAR((end.linear - start.linear).z(), -9.81 * 0.1 * mass, 1e-4 * mass);
    EXPECT_NEAR((end.linear - start.linear).head<2>().norm(), 0, 1e-5 * mass);
    EXPECT_NEAR(end.angular.z(), start.angular.z(), 0.02 * start.angular.norm());
}

// A stiff held block under its weight: backward Euler at 10 ms, 45 times the explicit limit, ends as leapfrog.
TEST(Integrators, SameRestWhoeverSteps) {
    const SpringGraph graph = block_graph(4, 0.1, 1, 5000);
    std::vector<Vec3d> rest[2];
    int which = 0;
    for (const Integrator integrator : {Integrator::kLeapfrog, Integrator::kBackwardEuler}) {
        AdvanceScene s;
        add_graph(s, graph);
        s.bodies.tissue[0].damping = 60;
        choose(s, integrator, 60, 1);
        const uint32_t per_10_ms = integrator == Integrator::kLeapfrog ? 50 : 1;
        for (int n = 0; n < 150; ++n) s.advance(10, per_10_ms);
        for (uint32_t v = 0; v < graph.position.size(); ++v) rest[which].push_back(s.offset(0, v));
        ++which;
    }
    for (size_t v = 0; v < graph.position.size(); ++v) {
        EXPECT_LT((rest[1][v] - rest[0][v]).norm(), 2e-6) << v;
    }
    EXPECT_GT((rest[0][0] - graph.position[0]).norm(), 1e-4);
}

// Three bodies of several chunks in one island, with different numbers of solves.
std::unique_ptr<AdvanceScene> mixed_scene(uint32_t threads, bool avx2) {
    auto s = std::make_unique<AdvanceScene>();
    ThreadPool pool(threads);
    pool.run([&] {
        force_avx2(avx2);
        const uint32_t mesh = s->add_mesh(subdivided_sphere(0.05, 5, 0.002));
        for (int i = 0; i < 3; ++i)
            s->add_body(mesh, Motion::kDeformable, Vec3d(i, 0, 0), {}, i == 1 ? AnchorFrame::kWorld : AnchorFrame::kShape);
        s->bodies.stepping = {
            {Integrator::kBackwardEuler, 8, 1e-6, 1}, {Integrator::kBackwardEuler, 8, 1e-6, 1}, {Integrator::kBackwardEuler, 3, 0, 1}};
        for (uint32_t b = 0; b < 3; ++b)
            for (uint32_t v = 0; v < 10242; ++v) s->set_velocity(b, v, Vec3d(1, 2, 3).cross(s->offset(b, v)) * 10.0);
        s->advance(10, 5);
        force_avx2(false);
    });
    return s;
}
TEST(Integrators, ThreadsAndInstructionSetsGiveTheSameBits) {
    const auto one = mixed_scene(1, false), three = mixed_scene(3, false), narrow = mixed_scene(2, true);
    EXPECT_TRUE(same_state(*one, *three));
    EXPECT_TRUE(same_state(*one, *narrow));
    EXPECT_EQ(one->energy.work_numeric, three->energy.work_numeric);
    EXPECT_EQ(one->energy.work_numeric, narrow->energy.work_numeric);
    EXPECT_EQ(one->report.implicit_iterations, narrow->report.implicit_iterations);
    EXPECT_EQ(one->report.nonfinite_particles, 0u);
}

// One step from a strained state against Newton's method in double.
TEST(BackwardEuler, OneStepAgreesWithNewtonsMethod) {
    SpringGraph graph = block_graph(2, 0.1, 0.4, 700);
    graph.rest = 0.045;  // all springs stretched: the minimum is the only one
    AdvanceScene s;
    add_graph(s, graph);
    for (uint32_t v = 0; v < 27; ++v) s.anchors.stiffness[v] = static_cast<float>(3 + v % 4);
    for (uint32_t v = 0; v < 27; ++v) s.anchors.rest_x[v] = 0.01f * static_cast<float>(v);
    for (uint32_t v = 0; v < 18; ++v) s.set_velocity(0, v, Vec3d(0.3 * (v % 3), -0.1 * (v % 5), 0.2));
    const double h = 5e-3;
    reference::DoubleBody b = double_copy(s, 0, graph);
    b.gravity = s.params.gravity;
    const std::vector<Vec3d> start = b.position;
    double left = 0;
    for (int iteration = 0; iteration < 60; ++iteration) {
        Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(81, 81);
        Eigen::VectorXd right = Eigen::VectorXd::Zero(81);
        const std::vector<Vec3d> force = reference::forces(b);
        for (int v = 0; v < 27; ++v) {
            const double mass = b.inv_mass[v] > 0 ? 1 / b.inv_mass[v] : 1e12;
            matrix.block<3, 3>(3 * v, 3 * v) = (mass / (h * h) + b.anchor[v]) * Eigen::Matrix3d::Identity();
            if (b.inv_mass[v] > 0)
                right.segment<3>(3 * v) = force[v] + mass * b.gravity - mass / (h * h) * (b.position[v] - start[v] - h * b.velocity[v]);
        }
        for (size_t e = 0; e < b.spring.size(); ++e) {
            const auto [i, j] = b.spring[e];
            const Vec3d d = b.position[j] - b.position[i];
            const double a = std::max(0.0, 1 - b.rest_length[e] / d.norm());
            const Eigen::Matrix3d k = 700 * (a * Eigen::Matrix3d::Identity() + (1 - a) * d.normalized() * d.normalized().transpose());
            for (const auto& [r, c, sign] : {std::tuple(i, i, 1), std::tuple(j, j, 1), std::tuple(i, j, -1), std::tuple(j, i, -1)})
                matrix.block<3, 3>(3 * r, 3 * c) += sign * k;
        }
        const Eigen::VectorXd change = reference::solve_symmetric(matrix, right);
        for (int v = 0; v < 27; ++v)
            if (b.inv_mass[v] > 0) b.position[v] += change.segment<3>(3 * v);
        left = change.norm();
    }
    ASSERT_LT(left, 1e-10);
    choose(s, Integrator::kBackwardEuler, 200, 1, 0);
    s.advance(5, 1);
    EXPECT_GT(s.report.implicit_iterations, 5u);
    for (int v = 0; v < 27; ++v) {
        EXPECT_LT((s.offset(0, v) - b.position[v]).norm(), 1e-7) << v;
        if (b.inv_mass[v] > 0) {
            EXPECT_LT((s.velocity(0, v) - (b.position[v] - start[v]) / h).norm(), 1e-5) << v;
        }
    }
}

// Numerical energy growth: a body whose stiffness was raised unknown to the step limit is restored in one
// call, counted; the other in the island keeps its bits, and a body moved violently by forces is left alone.
TEST(Integrators, RunawayBodyIsRestoredAlone) {
    const auto make = [] {
        auto s = std::make_unique<AdvanceScene>();
        s->params.gravity.setZero();
        Tissue tissue;
        tissue.damping = 1;
        const uint32_t mesh = s->add_mesh(subdivided_sphere(0.05, 2, 0.02));
        for (int i = 0; i < 2; ++i) s->add_body(mesh, Motion::kDeformable, Vec3d(i, 0, 0), tissue);
        for (uint32_t b = 0; b < 2; ++b)
            for (uint32_t v = 0; v < 162; ++v) s->set_velocity(b, v, Vec3d(0, 0, 3).cross(s->offset(b, v)));
        return s;
    };
    const auto calm = make(), wild = make();
    const uint32_t substeps = static_cast<uint32_t>(std::ceil(16e-3 / calm->bodies.stable_dt[0]));
    for (int n = 0; n < 3; ++n) calm->advance(64, 4 * substeps), wild->advance(64, 4 * substeps);
    EXPECT_EQ(calm->report.runaway_bodies, 0u);
    const std::vector<Float4> before = wild->particles.offset;
    wild->bodies.spring_stiffness[0] *= 40;  // the step is now many times too long
    calm->advance(16, substeps);
    wild->advance(16, substeps);
    EXPECT_EQ(wild->report.runaway_bodies, 1u);
    EXPECT_EQ(wild->report.nonfinite_particles, 0u);
    const Range first = wild->range(0), second = wild->range(1);
    EXPECT_EQ(0, std::memcmp(&wild->particles.offset[first.first], &before[first.first], first.count * sizeof(Float4)));
    EXPECT_EQ(0, std::memcmp(&wild->particles.offset[second.first], &calm->particles.offset[second.first], second.count * sizeof(Float4)));
    for (uint32_t v = 0; v < 162; ++v) EXPECT_EQ(wild->velocity(0, v), Vec3d::Zero());
}

// Bodies at rest stay at rest, however stiff. Rounding of positions to floats may kick each by omega ulp once a call, not once in each of
// its hundreds of steps: a walk of omega ulp sqrt(calls). Shells without damping and load, in calls of 16 and 17 ms. Oracle: rest.
TEST(Integrators, StiffBodiesAtRestStayCold) {
    for (const double modulus : {5e8, 2e9, 1e10}) {
        for (const double radius : {0.3, 0.5, 0.9, 3.0}) {
            for (const AnchorFrame frame : {AnchorFrame::kWorld, AnchorFrame::kShape}) {
                AdvanceScene s;
                s.params.gravity.setZero();
                Tissue tissue;
                tissue.youngs_modulus = modulus;
                tissue.damping = 0;
                const uint32_t mesh = s.add_mesh(subdivided_sphere(radius, 2, 0.02, static_cast<uint32_t>(100 * radius)));
                s.add_body(mesh, Motion::kDeformable, Vec3d::Zero(), tissue, frame, from_rotation_vector({0.3, radius, 1e-10 * modulus}));
                for (uint32_t call = 0; call < 18; ++call) {
                    const uint32_t ticks = call % 3 == 0 ? 16 : 17;
                    s.advance(ticks, count_substeps(s.bodies, std::vector<uint32_t>{0}, ticks * 1e-3, 1e-3));
                }
                double kinetic = 0, mass = 0;
                for (uint32_t v = 0; v < 162; ++v) {
                    const double m = 1.0 / s.particles.offset[s.range(0).first + v].w;
                    kinetic += 0.5 * m * s.velocity(0, v).squaredNorm();
                    mass += m;
                }
                const float at = static_cast<float>(radius);
                const double ulp = std::nextafter(at, 1e9f) - at, omega = 2 * kStiffShare / s.bodies.stable_dt[0];
                EXPECT_LT(std::sqrt(2 * kinetic / mass), omega * ulp * std::sqrt(18.0))
                    << modulus << " Pa, " << radius << " m, step " << s.bodies.stable_dt[0];
                EXPECT_EQ(s.report.runaway_bodies, 0u);
            }
        }
    }
}

// An island's step is the shortest of its bodies'; an implicit body requests its own, not the explicit limit.
TEST(Integrators, SubstepsOfAnIsland) {
    Bodies bodies;
    bodies.stable_dt = {1e-4, 3e-4};
    const std::vector<uint32_t> both{0, 1}, second{1};
    EXPECT_EQ(count_substeps(bodies, both, 16e-3, 1e-3), 160u);
    bodies.stepping = {{Integrator::kBackwardEuler, 10, 1e-3, 8e-3}, {}};
    EXPECT_EQ(count_substeps(bodies, both, 16e-3, 1e-3), 54u);
    bodies.stepping[1] = {Integrator::kBackwardEuler, 10, 1e-3, 20e-3};
    EXPECT_EQ(count_substeps(bodies, second, 16e-3, 1e-3), 1u);
}

}  // namespace
}  // namespace trocar
