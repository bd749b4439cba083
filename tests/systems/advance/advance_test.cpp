#include "systems/advance/advance.hpp"

#include <gtest/gtest.h>

#include <cstring>

#include "engine/base/cpu.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "systems/prepare/rigid_motion.hpp"
#include "tests/reference/measures.hpp"
#include "tests/systems/advance/tissue/spring_graph.hpp"
namespace trocar {
namespace {

struct Masses : AdvanceScene {
    uint32_t add(const std::vector<Vec3d>& position, const std::vector<double>& mass, const std::vector<std::array<uint32_t, 2>>& edges,
                 double rest, double k) {
        return add_graph(*this, {position, mass, edges, rest, k});
    }
};

double discrete_phase(double omega, double dt) { return 2 * std::asin(0.5 * omega * dt); }

// M12. The leapfrog solution of an oscillator is known exactly: x_n = a cos(n phi), sin(phi / 2) = omega dt /
// 2. Breaks on a full first kick, a wrong mass or a spring counted once.
TEST(Advance, M12_OneMassBetweenTwoFixed) {
    Masses s;
    s.params.gravity.setZero();
    const double m = 0.02, k = 35, a = 0.01, omega = std::sqrt(2 * k / m);
    const uint32_t body = s.add({{-1, 0, 0}, {0, 0, 0}, {1, 0, 0}}, {0, m, 0}, {{0, 1}, {1, 2}}, 1.0, k);
    EXPECT_NEAR(s.bodies.stable_dt[body], kStableShare * 2 / omega, 1e-6);
    s.particles.offset[1].x = static_cast<float>(a);
    for (int n = 1; n <= 500; ++n) {
        s.advance(1, 1);
        EXPECT_NEAR(s.offset(body, 1).x(), a * std::cos(n * discrete_phase(omega, 1e-3)), 2e-4 * a);
    }
    EXPECT_EQ(s.offset(body, 0).x(), -1);
}

TEST(Advance, TwoBodiesOscillateAboutTheirCentre) {
    Masses s;
    s.params.gravity.setZero();
    const double m1 = 0.02, m2 = 0.05, k = 35, a = 0.01, omega = std::sqrt(k * (m1 + m2) / (m1 * m2));
    const uint32_t body = s.add({{0, 0, 0}, {0, 1 + a, 0}}, {m1, m2}, {{0, 1}}, 1.0, k);
    const double centre = m2 * (1 + a) / (m1 + m2);
    for (int n = 1; n <= 500; ++n) {
        s.advance(1, 1);
        const double y0 = s.offset(body, 0).y(), y1 = s.offset(body, 1).y();
        EXPECT_NEAR(y1 - y0 - 1, a * std::cos(n * discrete_phase(omega, 1e-3)), 5e-4 * a);
        EXPECT_NEAR((m1 * y0 + m2 * y1) / (m1 + m2), centre, 5e-6);  // 500 roundings of ulp(1 m)
    }
}

// omega_j = 2 sqrt(k/m) sin(j pi / (2 (N + 1))), mode shape sin(i j pi / (N + 1)).
TEST(Advance, ChainModes) {
    constexpr int kMasses = 10;
    for (const int mode : {1, 4, 10}) {
        Masses s;
        s.params.gravity.setZero();
        std::vector<Vec3d> position;
        std::vector<double> mass(kMasses + 2, 0.02);
        std::vector<std::array<uint32_t, 2>> edges;
        const double k = 35, a = 1e-3;
        const auto shape = [&](int i) { return a * std::sin(i * mode * std::numbers::pi / (kMasses + 1)); };
        for (int i = 0; i <= kMasses + 1; ++i) {
            position.push_back({0.1 * i - 0.55 + shape(i), 0, 0});
            if (i > 0) edges.push_back({static_cast<uint32_t>(i - 1), static_cast<uint32_t>(i)});
        }
        mass.front() = mass.back() = 0;
        const uint32_t body = s.add(position, mass, edges, 0.1, k);
        const double omega = 2 * std::sqrt(k / 0.02) * std::sin(mode * std::numbers::pi / (2 * (kMasses + 1)));
        for (int n = 1; n <= 200; ++n) {
            s.advance(1, 1);
            for (int i = 1; i <= kMasses; ++i) {
                EXPECT_NEAR(s.offset(body, i).x() - (0.1 * i - 0.55), shape(i) * std::cos(n * discrete_phase(omega, 1e-3)), 5e-3 * a);
            }
        }
    }
}

TEST(Advance, M01_RestLengthZeroIsALinearSpring) {
    Masses s;
    s.params.gravity.setZero();
    const double m = 0.02, k = 35, omega = std::sqrt(k / m);
    const uint32_t body = s.add({{0, 0, 0}, {0.3, 0.4, 0}}, {0, m}, {{0, 1}}, 0.0, k);
    for (int n = 1; n <= 100; ++n) {
        s.advance(1, 1);
        const double c = std::cos(n * discrete_phase(omega, 1e-3));
        EXPECT_LT((s.offset(body, 1) - c * Vec3d(0.3, 0.4, 0)).norm(), 2e-5);
    }
}

// M02, M03
TEST(Advance, M02_CoincidentMassesPullNowhere) {
    Masses s;
    s.params.gravity.setZero();
    const uint32_t body = s.add({{1, 1, 1}, {1, 1, 1}}, {0.02, 0.02}, {{0, 1}}, 0.5, 35);
    s.advance(1, 1);
    EXPECT_EQ(s.velocity(body, 0), Vec3d::Zero());
    EXPECT_EQ(s.offset(body, 1), Vec3d(1, 1, 1));
}
TEST(Advance, M03_CoincidentMovingMassesStayFinite) {
    Masses s;
    s.params.gravity.setZero();
    const uint32_t body = s.add({{1, 1, 1}, {1, 1, 1}}, {0.02, 0.02}, {{0, 1}}, 0.5, 35);
    s.set_velocity(body, 0, {1, 0, 0});
    s.set_velocity(body, 1, {1, 1e-20, 0});
    s.advance(100, 100);
    EXPECT_EQ(s.report.nonfinite_particles, 0u);
    EXPECT_NEAR(s.offset(body, 0).x() + s.offset(body, 1).x(), 2.2, 1e-5);
}

// M07. 0.99 of 2 / omega stays bounded; 1.05 grows until the body is put back, counted.
TEST(Advance, M07_LimitOfTheStep) {
    for (const double share : {0.99, 1.05}) {
        Masses s;
        s.params.gravity.setZero();
        const double dt = 1e-3, omega = share * 2 / dt, m = 0.01;
        const uint32_t body = s.add({{-1, 0, 0}, {0.001, 0, 0}, {1, 0, 0}}, {0, m, 0}, {{0, 1}, {1, 2}}, 1.0, 0.5 * m * omega * omega);
        double most = 0;
        for (int n = 0; n < 2000; ++n) {
            s.advance(1, 1);
            most = std::max(most, std::abs(s.offset(body, 1).x()));
        }
        EXPECT_EQ(most < 0.0075, share < 1) << share << " " << most;
        EXPECT_EQ(s.report.nonfinite_particles > 0, share > 1);
    }
}

// Half a kick first: x_n = g t^2 / 2 exactly. Damping does not act on a free body's fall.
TEST(Advance, FreeFallIsExact) {
    AdvanceScene s;
    Tissue tissue;
    tissue.damping = 5;
    const uint32_t body =
        s.add_body(s.add_mesh(subdivided_sphere(0.05, 2, 0.1)), Motion::kDeformable, Vec3d::Zero(), tissue, AnchorFrame::kShape);
    const std::vector<Float4> start = s.particles.offset;
    for (int n = 1; n <= 100; ++n) s.advance(1, 1);
    for (uint32_t v = 0; v < 162; ++v) {
        EXPECT_NEAR(s.offset(body, v).z() - start[v].z, -0.5 * 9.81 * 0.01, 2e-6);
        EXPECT_NEAR(s.offset(body, v).x() - start[v].x, 0, 2e-6);
    }
}

// The whole substep against the plain double version, held and free.
TEST(Advance, AgreesWithDoubleLeapfrog) {
    for (const AnchorFrame frame : {AnchorFrame::kWorld, AnchorFrame::kShape}) {
        AdvanceScene s;
        const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 3, 0.05)), Motion::kDeformable, Vec3d(3, 0, 0), {}, frame,
                                         from_rotation_vector({0.4, 0.2, -0.6}));
        for (uint32_t v = 0; v < 642; ++v) {
            const Vec3d x = s.offset(body, v);
            s.set_velocity(body, v, Vec3d(0, 0, 4).cross(x) + 8.0 * Vec3d(x.x(), -x.y(), x.z() * x.x() * 20));
        }
        reference::DoubleBody expected = double_copy(s, body);
        for (int n = 0; n < 150; ++n) {
            s.advance(1, 2);
            reference::step(expected, 0.5e-3);
            reference::step(expected, 0.5e-3);
        }
        double worst = 0, moved = 0;
        for (uint32_t v = 0; v < 642; ++v) {
            worst = std::max(worst, (s.offset(body, v) - expected.position[v]).norm());
            moved = std::max(moved, (expected.position[v] - expected.goal[v]).norm());
        }
        EXPECT_LT(worst, 2e-6) << static_cast<int>(frame);
        EXPECT_GT(moved, 1e-3);
    }
}

// Splitting calls differently gives the same bits, with a moving tool, touching constraints and a rotating
// body.
struct PressedShell : AdvanceScene {
    uint32_t shell, ball;
    explicit PressedShell(int levels = 3, AnchorFrame frame = AnchorFrame::kWorld) {
        Mesh mesh = subdivided_sphere(0.05, levels, 0.01);
        Tissue tissue;
        tissue.damping = 4;
        shell = add_body(add_mesh(mesh), Motion::kDeformable, Vec3d::Zero(), tissue, frame);
        for (uint32_t v = 0; v < mesh.position.size(); ++v) {
            if (mesh.position[v].z() < -0.03) particles.offset[v].w = 0;
        }
        update_stable_dt(springs, shell, particles, anchors, bodies);
        ball = add_body(add_mesh(subdivided_sphere(0.01, 2)), Motion::kKinematic, Vec3d(0, 0, 0.065));
        add_path(ball, {{0, {0, 0, 0.065}, {}, 0},
                        {0.1, {0, 0, 0.052}, {}, 0},
                        {0.2, {0, 0, 0.052}, {}, 0},
                        {0.4, {-0.01, 0.004, 0.052}, from_rotation_vector({1, 0, 0}), 0},
                        {0.5, {-0.01, 0.004, 0.08}, {}, 0}});
    }
    void pass(uint32_t ms, uint32_t substeps_per_ms, uint32_t calls = 1, double friction = 0.2) {
        follow_paths(paths, static_cast<double>(params.tick) * 1e-3, {}, poses);
        clear_constraints();
        find_constraints(shell, ball, friction);
        for (uint32_t c = 0; c < calls; ++c) advance(ms / calls, ms / calls * substeps_per_ms);
    }
};

bool same_state(const AdvanceScene& a, const AdvanceScene& b) {
    return 0 == std::memcmp(a.particles.offset.data(), b.particles.offset.data(), a.particles.offset.size() * sizeof(Float4)) &&
           a.particles.velocity_x == b.particles.velocity_x && a.particles.velocity_y == b.particles.velocity_y &&
           a.particles.velocity_z == b.particles.velocity_z && a.particles.last_dt == b.particles.last_dt;
}

TEST(Advance, SplitCallsGiveTheSameBits) {
    PressedShell whole, split;
    whole.params.contact.iterations = split.params.contact.iterations =
        1;  // with two iterations or more a call warm starts from the end of the last
    uint64_t acted = 0;
    for (int pass = 0; pass < 25; ++pass) {
        whole.pass(16, 2);
        acted += whole.result.active_constraints;
        split.pass(16, 2, 16);
        ASSERT_TRUE(same_state(whole, split)) << pass;
    }
    EXPECT_GT(acted, 1000u);
}

TEST(Advance, InstructionSetsGiveTheSameBits) {
    PressedShell wide(3, AnchorFrame::kShape), narrow(3, AnchorFrame::kShape);
    for (int pass = 0; pass < 15; ++pass) {
        force_avx2(false);
        wide.pass(16, 1);
        force_avx2(true);
        narrow.pass(16, 1);
    }
    force_avx2(false);
    EXPECT_TRUE(same_state(wide, narrow));
    EXPECT_EQ(wide.energy.work_damping, narrow.energy.work_damping);
}

// Four chunks of slices; breaks on a reduction in thread order or a race.
TEST(Advance, ThreadsGiveTheSameBits) {
    const auto run = [](uint32_t threads) {
        auto s = std::make_unique<AdvanceScene>();
        ThreadPool pool(threads);
        pool.run([&] {
            EXPECT_EQ(thread_count(), threads);
            s->add_body(s->add_mesh(subdivided_sphere(0.05, 6, 0.002)), Motion::kDeformable, Vec3d::Zero(), {}, AnchorFrame::kShape);
            for (uint32_t v = 0; v < 40962; ++v) s->set_velocity(0, v, Vec3d(1, 2, 3).cross(s->offset(0, v)) * 10.0);
            s->advance(2, 40);
        });
        return s;
    };
    const auto one = run(1), two = run(2), four = run(4);
    EXPECT_TRUE(same_state(*one, *two));
    EXPECT_TRUE(same_state(*one, *four));
    EXPECT_EQ(one->energy.work_damping, four->energy.work_damping);
}

// A free body drifts by far less than an ulp of its floats per step of 0.1 ms (0.02 mm/s: 0.27 of it) and
// loses at most half an ulp per call. Rounding each step by itself loses 41 % of the displacement.
TEST(Advance, StepsOfAFewUlpAddUp) {
    for (const double speed : {1e-3, -1e-3, 2e-5}) {
        AdvanceScene s;
        const uint32_t mesh = s.add_mesh(subdivided_sphere(0.1, 3));
        const uint32_t body = s.add_body(mesh, Motion::kDeformable, Vec3d::Zero(), {}, AnchorFrame::kShape);
        s.bodies.tissue[body].damping = 0;
        s.params.gravity.setZero();
        const uint32_t count = s.meshes.info[0].vertices.count;
        Vec3d start = Vec3d::Zero(), end = Vec3d::Zero();
        for (uint32_t v = 0; v < count; ++v) {
            s.set_velocity(body, v, Vec3d(speed, 0, 0));
            start += s.offset(body, v) / count;
        }
        for (int pass = 0; pass < 30; ++pass) s.advance(16, 160);
        for (uint32_t v = 0; v < count; ++v) end += s.offset(body, v) / count;
        const double displacement = 30 * 0.016 * speed;
        EXPECT_NEAR((end - start).x(), displacement, 30 * 3.8e-9 + 1e-4 * std::abs(displacement)) << speed;
        EXPECT_NEAR((end - start).y(), 0, 30 * 3.8e-9) << speed;
    }
}

TEST(Advance, M13_FixedBodyDoesNotMove) {
    PressedShell s;
    for (Float4& o : s.particles.offset) o.w = 0;
    const auto before = s.particles.offset;
    for (int pass = 0; pass < 15; ++pass) s.pass(16, 1);
    EXPECT_EQ(0, std::memcmp(before.data(), s.particles.offset.data(), before.size() * sizeof(Float4)));
}

// M10. A non-finite body is back at rest after one call, counted; another in the same island keeps its bits. What moved it was no work.
TEST(Advance, M10_BodyThatIsNotFiniteIsRestoredAlone) {
    for (uint32_t poke = 0; poke < 24; ++poke) {
        const bool velocity = poke % 2 == 1;
        const uint32_t where = 17 + 11 * (poke / 2);
        const float value = poke % 3 == 0 ? 3e30f : std::nanf("");  // squares of the former overflow
        const auto make = [] {
            auto s = std::make_unique<AdvanceScene>();
            const uint32_t mesh = s->add_mesh(subdivided_sphere(0.05, 2, 0.02));
            s->add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0), {}, AnchorFrame::kShape);
            s->add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0.099), {}, AnchorFrame::kShape);
            s->params.gravity.setZero();
            s->find_constraints(0, 1, 0.1);
            return s;
        };
        const auto clean = make(), poked = make();
        EXPECT_GT(poked->contact_constraints.body.size(), 1u);
        clean->clear_constraints();
        poked->open_energy_account();
        const Energy before = poked->energy;
        (velocity ? poked->particles.velocity_y[where] : poked->particles.offset[where].y) = value;
        clean->advance(8, 8);
        poked->advance(8, 8);
        EXPECT_EQ(poked->energy.work_contact, before.work_contact);
        EXPECT_EQ(poked->energy.work_damping, before.work_damping);
        EXPECT_EQ(poked->energy.work_push, before.work_push);
        EXPECT_GT(poked->report.nonfinite_particles, 0u);
        const Range other = poked->range(1);
        const bool same =
            0 == std::memcmp(&clean->particles.offset[other.first], &poked->particles.offset[other.first], other.count * sizeof(Float4));
        EXPECT_TRUE(same || !std::isnan(value)) << "what is only absurd pushes before it is found";
        for (uint32_t v = 0; v < 162; ++v) {
            EXPECT_TRUE(poked->offset(0, v).allFinite());
            EXPECT_LT((poked->offset(0, v) - clean->offset(0, v)).norm(), 1e-6);
            EXPECT_EQ(poked->velocity(0, v), Vec3d::Zero());
        }
        EXPECT_NEAR(poked->poses.orientation[0].w, 1, 1e-6);
        poked->advance(8, 8);
        EXPECT_TRUE(poked->offset(0, where).allFinite());
        poked->measure();
        EXPECT_NEAR(poked->energy.balance, 0, 1e-8);
    }
}

// Momentum of a free deformable pair that collides off centre, without friction.
TEST(Advance, MomentumOfAFreePairIsKept) {
    AdvanceScene s;
    s.params.gravity.setZero();
    s.params.contact.push_speed = 0;
    s.margin = 4e-3;
    Tissue tissue;
    tissue.damping = 3;
    const uint32_t mesh = s.add_mesh(subdivided_sphere(0.03, 2, 0.03));
    s.add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0), tissue, AnchorFrame::kShape);
    s.add_body(mesh, Motion::kDeformable, Vec3d(0.062, 0.02, 0.005), tissue, AnchorFrame::kShape, from_rotation_vector({1, 2, 0}));
    for (uint32_t v = 0; v < 162; ++v) s.set_velocity(0, v, {0.4, 0.05, 0});
    const auto momentum = [&](Vec3d& p, Vec3d& l, Vec3d& p0) {
        const Momentum a = measure_momentum(s.bodies, s.poses, s.particles, 0), b = measure_momentum(s.bodies, s.poses, s.particles, 1);
        p = a.linear + b.linear, l = a.angular + b.angular, p0 = a.linear;
    };
    Vec3d p, l, first, p_end, l_end, first_end;
    momentum(p, l, first);
    uint64_t acted = 0;
    for (int pass = 0; pass < 20; ++pass) {
        s.clear_constraints();
        s.find_constraints(0, 1, 0);
        s.advance(10, 20);
        acted += s.result.active_constraints;
    }
    momentum(p_end, l_end, first_end);
    EXPECT_GT(acted, 100u);
    EXPECT_GT((first_end - first).norm(), 0.3 * first.norm());
    EXPECT_LT((p_end - p).norm(), 1e-6 * p.norm());
    // of the larger body's share: 0.4 m/s at 0.03 m. The rest is rounding of 400 x 324 positions and
    // velocities to float: merely reordering the constraints leaves 0.5e-6 to 1.8e-6
    EXPECT_LT((l_end - l).norm(), 4e-6 * first.norm() * 0.03);
    EXPECT_LE(s.energy.work_contact, 0);
}

// Head-on, equal spheres: the elastic bodies rebound and exchange nearly all of their velocities.
TEST(Advance, EqualBodiesExchangeMomentum) {
    AdvanceScene s;
    s.params.gravity.setZero();
    Tissue tissue;
    tissue.damping = 0;
    const uint32_t mesh = s.add_mesh(subdivided_sphere(0.03, 3));
    s.add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0), tissue, AnchorFrame::kShape);
    s.add_body(mesh, Motion::kDeformable, Vec3d(0.0605, 0, 0), tissue, AnchorFrame::kShape);
    for (uint32_t v = 0; v < 642; ++v) s.set_velocity(0, v, {0.2, 0, 0});
    const Vec3d start = measure_momentum(s.bodies, s.poses, s.particles, 0).linear;
    for (int pass = 0; pass < 15; ++pass) {
        s.clear_constraints();
        s.find_constraints(0, 1, 0);
        s.advance(10, 20);
    }
    const Vec3d a = measure_momentum(s.bodies, s.poses, s.particles, 0).linear;
    const Vec3d b = measure_momentum(s.bodies, s.poses, s.particles, 1).linear;
    EXPECT_TRUE(s.contact_constraints.body.empty() || s.result.active_constraints == 0);
    EXPECT_LT((a + b - start).norm(), 2e-6 * start.norm());
    EXPECT_GT(b.x(), 0.75 * start.x());
}

// A tool held still: its impulses per second equal spring, anchor and weight forces on free particles.
TEST(Advance, StaticPressBalancesReactions) {
    PressedShell s;
    s.bodies.tissue[0].damping = 30;
    s.paths.key[2].time = 99, s.paths.key[3].time = 100, s.paths.key[4].time = 101;
    Vec3d impulse;
    for (int pass = 0; pass < 60; ++pass) {
        s.pass(16, 2);
        impulse.setZero();
        for (size_t r = 0; r < s.contact_constraints.body.size(); ++r)
            impulse += (s.contact_constraints.body[r] == 0 ? 1 : -1) * s.contact_constraints.impulse[r];
    }
    const reference::DoubleBody b = double_copy(s, 0);
    Vec3d reaction = Vec3d::Zero();
    const auto f = reference::forces(b);
    for (size_t i = 0; i < f.size(); ++i) {
        if (b.inv_mass[i] > 0) reaction += f[i] + s.params.gravity / b.inv_mass[i];
    }
    EXPECT_GT(impulse.norm() / 16e-3, 0.05);
    EXPECT_LT((impulse / 16e-3 + reaction).norm(), 0.01 * impulse.norm() / 16e-3);
}

// After the tool has left, no constraint acts: planes do not persist without contact.
TEST(Advance, NothingActsAfterTheToolHasLeft) {
    PressedShell s;
    uint64_t before = 0, after = 0;
    for (int pass = 0; pass < 50; ++pass) {
        s.pass(16, 1);
        (s.params.tick < 480 ? before : after) += s.result.active_constraints;
        if (s.params.tick >= 480) {
            for (const Vec3d& j : s.contact_constraints.impulse) EXPECT_EQ(j, Vec3d::Zero());
        }
    }
    EXPECT_GT(before, 1000u);
    EXPECT_EQ(after, 0u);
}

// After the first calls a call reuses all its memory: addresses and capacities do not change.
TEST(Advance, WarmCallsKeepTheirMemory) {
    PressedShell s;
    for (int pass = 0; pass < 14; ++pass) s.pass(16, 1);
    const auto memory = [&] {
        const AdvanceScratch& c = s.scratch;
        return std::vector<const void*>{c.tissue.offset_a.data(),
                                        c.tissue.offset_b.data(),
                                        c.tissue.sums.data(),
                                        c.island.body.data(),
                                        c.island.rigid.data(),
                                        c.island.slot_of_body.data(),
                                        c.island.nodes.node.position.data(),
                                        c.island.nodes.change.before.data(),
                                        c.island.nodes.node_of_particle.data(),
                                        c.solver.prepared.data(),
                                        c.solver.group[0].active.data(),
                                        c.solver.wide_constraint.data()};
    };
    const auto warm = memory();
    s.params.tick = 100;
    for (int i = 0; i < 3; ++i) s.advance(16, 16);
    EXPECT_EQ(memory(), warm);
}

// A block of four free corners on a table: a body with explicit constraints.
struct Block : Masses {
    uint32_t block, table;
    explicit Block(double mass, double friction, bool pinned_table = false) {
        block = add({{0.1, 0.1, 0}, {-0.1, 0.1, 0}, {-0.1, -0.1, 0}, {0.1, -0.1, 0}}, std::vector<double>(4, mass),
                    {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 2}}, 0.2, 50);
        springs.rest_length.clear();
        const uint32_t mesh = add_mesh(flat_square(1.0));
        (void)pinned_table;
        table = add_body(mesh, Motion::kStatic);
        for (uint32_t v = 0; v < 4; ++v) add_constraint(block, v, table, {0, 1, 2}, {0.5, 0.2, 0.3}, {0, 0, 1}, 0, friction);
        springs.rest_length.assign(springs.neighbour.size(), 0.0f);
        bodies.spring_stiffness[block] = 0;
    }
};

// Coulomb: a sliding block slows by mu g until it stops, and then stays.
TEST(Advance, FrictionSlowsASlidingBlockByMuG) {
    Block s(0.01, 0.3);
    for (uint32_t v = 0; v < 4; ++v) s.set_velocity(s.block, v, {0.5, 0, 0});
    s.advance(100, 100);
    for (uint32_t v = 0; v < 4; ++v) {
        EXPECT_NEAR(s.velocity(s.block, v).x(), 0.5 - 0.3 * 9.81 * 0.0995, 1e-4);
        EXPECT_NEAR(s.offset(s.block, v).z(), 0, 2e-6);
    }
    s.advance(200, 200);
    for (uint32_t v = 0; v < 4; ++v) EXPECT_LT(s.velocity(s.block, v).norm(), 1e-6);
    s.measure();
}

// A block on a slope slides if and only if tan(slope) > mu, and then with g (sin - mu cos).
TEST(Advance, BlockOnASlope) {
    for (const double mu : {0.2, 0.5}) {
        Block s(0.01, mu);
        const double slope = 0.35;  // tan = 0.365
        s.params.gravity = 9.81 * Vec3d(std::sin(slope), 0, -std::cos(slope));
        s.advance(100, 100);
        const double a = mu > std::tan(slope) ? 0 : 9.81 * (std::sin(slope) - mu * std::cos(slope));
        EXPECT_NEAR(s.velocity(s.block, 0).x(), a * 0.0995, 1e-4) << mu;
    }
}

// A constraint expires, once, an edge length beyond its triangle; then the block falls.
TEST(Advance, RowsEndWhenLeftBehind) {
    Block s(0.01, 0);
    for (uint32_t v = 0; v < 4; ++v) s.set_velocity(s.block, v, {100, 0, 0});
    s.advance(10, 10);
    EXPECT_EQ(s.report.expired_constraints, 0u);
    EXPECT_NEAR(s.offset(s.block, 0).z(), 0, 1e-5);
    s.advance(90, 90);
    EXPECT_EQ(s.report.expired_constraints, 4u);
    EXPECT_LT(s.offset(s.block, 0).z(), -0.01);
    for (const double d : s.contact_constraints.distance) EXPECT_TRUE(std::isinf(d));
}

// M20. Overlap is removed at push_speed, velocities stay, and the springs' gain is accounted for.
TEST(Advance, M20_PushOutAddsOnlyTheEnergyOfItsMoves) {
    AdvanceScene s;
    s.params.gravity.setZero();
    Tissue tissue;
    tissue.damping = 0;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 2)), Motion::kDeformable, Vec3d::Zero(), tissue);
    const uint32_t table = s.add_body(s.add_mesh(flat_square(1.0), Admission::kSolid), Motion::kStatic);
    uint32_t lowest = 0;
    for (uint32_t v = 0; v < 162; ++v) {
        if (s.offset(body, v).z() < s.offset(body, lowest).z()) lowest = v;
    }
    s.poses.origin[table].z() = s.offset(body, lowest).z() + 1e-3;
    s.add_constraint(body, lowest, table, {0, 1, 2}, {0.3, 0.3, 0.4}, {0, 0, 1}, -1e-3, 0);
    const double before = reference::potential_energy(double_copy(s, body));
    const Vec3d at = s.offset(body, lowest);
    s.open_energy_account();
    s.advance(1, 1);
    const Vec3d moved = s.offset(body, lowest) - at;
    EXPECT_NEAR(moved.z(), s.params.contact.push_speed * 1e-3, 1e-8);
    EXPECT_LT(s.velocity(body, lowest).norm(), 1e-7);  // rounding of the rest lengths
    const double added = reference::potential_energy(double_copy(s, body)) - before;
    EXPECT_GT(added, 0);
    EXPECT_NEAR(s.energy.work_push, added, 1e-5 * added);
    double bound = 0.5 * s.anchors.stiffness[s.range(body).first + lowest] * moved.squaredNorm();
    bound += 0.5 * 6 * s.bodies.spring_stiffness[body] * moved.squaredNorm();
    EXPECT_LE(added, bound);
}

// A vertex of a ball between a plate and a triangle of another ball above it.
struct PressedVertex : AdvanceScene {
    uint32_t plate = 0;
    Triangle above;
    double lowest = 0;  // m, of the triangle's corners, all equal at the start

    explicit PressedVertex(uint32_t iterations) {
        params.gravity.setZero();
        params.contact.push_speed = 1e9;
        params.contact.iterations = iterations;
        Tissue soft;
        soft.youngs_modulus = 1e-3;
        const uint32_t mesh = add_mesh(subdivided_sphere(0.05, 1));
        add_body(mesh, Motion::kDeformable, Vec3d::Zero(), soft);
        add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0.2), soft);
        plate = add_body(add_mesh(flat_square(1.0)), Motion::kStatic);
        above = mesh_view(meshes, mesh).triangle[0];
        lowest = 0.15;
        for (const uint32_t v : above) particles.offset[range(1).first + v].z = static_cast<float>(lowest - 0.2);
        const Vec3d middle = (offset(1, above[0]) + offset(1, above[1]) + offset(1, above[2])) / 3;
        Float4& o = particles.offset[range(0).first];
        o = {static_cast<float>(middle.x()), static_cast<float>(middle.y()), static_cast<float>(lowest + 1e-3), o.w};
        poses.origin[plate].z() = lowest + 2e-3;
        add_constraint(0, 0, plate, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, -1e-3, 0);
        add_constraint(0, 0, 1, above, {0.4, 0.3, 0.3}, {0, 0, -1}, -1e-3, 0);
    }
    double below_plate() const { return lowest + 2e-3 - offset(0, 0).z(); }
    double above_triangle() const {
        const double z = 0.4 * offset(1, above[0]).z() + 0.3 * (offset(1, above[1]).z() + offset(1, above[2]).z());
        return offset(0, 0).z() - (0.2 + z);
    }
};

// A vertex pressed from opposite sides moves by the mean correction per sweep; freeing it while the triangle
// above yields takes more. Breaks when such a constraint is corrected only once, or sweeps end before the
// tolerance.
TEST(Advance, MoreSweepsFreeAVertexPressedFromBothSides) {
    PressedVertex once(1), often(12);
    once.advance(1, 1);
    often.advance(1, 1);
    EXPECT_GT(std::max(once.below_plate(), once.above_triangle()), 3e-4);
    EXPECT_LT(often.below_plate(), often.params.contact.tolerance);
    EXPECT_LT(often.above_triangle(), often.params.contact.tolerance);
    EXPECT_GT(often.lowest + 2e-3, often.offset(0, 0).z() - 2e-5);  // not beyond the plate that presses it
    EXPECT_NEAR(often.result.deepest_residual, std::max({0.0, often.below_plate(), often.above_triangle()}), 1e-6);
}

// Between two overlapping plates, which cannot yield, the vertex goes to the middle and stays. Breaks when
// the last constraint of a later sweep wins, or when many constraints push the vertex too far.
TEST(Advance, AVertexBetweenTwoPlatesMeetsThemMidway) {
    for (const uint32_t iterations : {1u, 2u, 7u, 100u}) {
        for (const int constraints : {1, 2, 5}) {
            PressedVertex s(iterations);
            s.clear_constraints();
            s.particles.offset[s.range(0).first].z += 2e-4f;
            const uint32_t low = s.add_body(s.bodies.mesh[s.plate], Motion::kStatic, Vec3d(0, 0, s.lowest));
            for (int i = 0; i < constraints; ++i) {
                s.add_constraint(0, 0, s.plate, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, -8e-4, 0);
                s.add_constraint(0, 0, low, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, -1}, -1.2e-3, 0);
            }
            s.advance(1, 1);
            EXPECT_NEAR(s.offset(0, 0).z(), s.lowest + 1e-3, 1e-6) << iterations << " iterations, " << constraints << " rows";
        }
    }
}

// Pressed across as well, as between the teeth of closed jaws, no displacement frees the vertex: corrections leave it where it is, and it
// is counted. Breaks when they move it: out between the plates, a step in every call.
TEST(Advance, AVertexPressedFromAllSidesStays) {
    for (const uint32_t iterations : {1u, 7u}) {
        PressedVertex s(iterations);
        s.clear_constraints();
        const uint32_t low = s.add_body(s.bodies.mesh[s.plate], Motion::kStatic, Vec3d(0, 0, s.lowest));
        const Vec3d at = s.offset(0, 0);
        const MeshView view = mesh_view(s.meshes, s.bodies.mesh[s.plate]);
        const double below = (0.4 * view.position[0] + 0.3 * (view.position[1] + view.position[2])).x();
        const uint32_t side = s.add_body(s.bodies.mesh[s.plate], Motion::kStatic, Vec3d(at.x() + 1e-3 - below, 0, s.lowest));
        s.add_constraint(0, 0, s.plate, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, -1e-3, 0);
        s.add_constraint(0, 0, low, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, -1}, -1e-3, 0);
        s.add_constraint(0, 0, side, {0, 1, 2}, {0.4, 0.3, 0.3}, {1, 0, 0}, -1e-3, 0);
        s.advance(1, 1);
        EXPECT_LT((s.offset(0, 0) - at).norm(), 1e-9) << iterations;
        EXPECT_EQ(s.result.opposing_planes, 1u);
        EXPECT_NEAR(s.result.deepest_residual, 1e-3, 1e-6);
    }
}

// A free body is corrected once per substep. Between a heavy one and a plate a vertex goes to the middle and
// stays. Breaks when later sweeps, which omit the free body, press it onto the plate.
TEST(Advance, AVertexBetweenAFreeBodyAndAPlateMeetsThemMidway) {
    for (const uint32_t iterations : {1u, 8u}) {
        PressedVertex s(iterations);
        s.clear_constraints();
        const uint32_t heavy = s.add_body(s.bodies.mesh[0], Motion::kFree);
        ASSERT_TRUE(set_rigid_mass(s.meshes, heavy, 1e6, s.bodies, s.particles));
        const MeshView view = mesh_view(s.meshes, s.bodies.mesh[0]);
        const Vec3d closest = 0.4 * view.position[s.above[0]] + 0.3 * (view.position[s.above[1]] + view.position[s.above[2]]);
        s.poses.origin[heavy] = Vec3d(s.offset(0, 0).x(), s.offset(0, 0).y(), s.lowest) - closest;
        s.particles.offset[s.range(0).first].z += 2e-4f;
        s.add_constraint(0, 0, s.plate, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, -8e-4, 0);
        s.add_constraint(0, 0, heavy, s.above, {0.4, 0.3, 0.3}, {0, 0, -1}, -1.2e-3, 0);
        s.advance(1, 1);
        EXPECT_NEAR(s.offset(0, 0).z(), s.lowest + 1e-3, 1e-6) << iterations;
    }
}

// M19. Half the correction each, and one side is fixed: the overlap halves in every substep.
TEST(Advance, M19_HalfShareHalvesTheOverlap) {
    AdvanceScene s;
    s.params.gravity.setZero();
    s.params.contact.share = ResponseShare::kHalf;
    s.params.contact.push_speed = 1e9;
    const uint32_t mesh = s.add_mesh(subdivided_sphere(0.05, 1));
    Tissue soft;
    soft.youngs_modulus = 1e-3;
    s.add_body(mesh, Motion::kDeformable, Vec3d::Zero(), soft);
    s.add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0.09), soft);
    for (uint32_t v = 0; v < s.range(1).count; ++v) s.particles.offset[s.range(1).first + v].w = 0;
    const MeshView view = mesh_view(s.meshes, mesh);
    const Vec3d corner = s.offset(1, view.triangle[0][0]);
    s.add_constraint(0, 0, 1, view.triangle[0], {1, 0, 0}, {0, 0, -1}, 0, 0);
    const auto overlap = [&] { return s.offset(0, 0).z() - (0.09 + corner.z()); };
    s.particles.offset[s.range(0).first] = {static_cast<float>(corner.x()), static_cast<float>(corner.y()),
                                            static_cast<float>(0.09 + corner.z() + 0.01), s.particles.offset[0].w};
    double expected = overlap();
    for (int k = 0; k < 10; ++k) {
        s.advance(1, 1);
        expected *= 0.5;
        EXPECT_NEAR(overlap(), expected, 2e-6);
    }
    EXPECT_LT(overlap(), 1.1e-3 * 0.01);
}

// The thesis' ratio: of two bodies the softer one yields more.
TEST(Advance, StiffnessShareMovesTheSofterBody) {
    AdvanceScene s;
    s.params.gravity.setZero();
    s.params.contact.share = ResponseShare::kStiffness;
    const uint32_t mesh = s.add_mesh(subdivided_sphere(0.05, 1));
    Tissue soft, stiff;
    soft.youngs_modulus = 1, stiff.youngs_modulus = 3;
    s.add_body(mesh, Motion::kDeformable, Vec3d::Zero(), soft);
    s.add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0.09), stiff);
    const Triangle t = mesh_view(s.meshes, mesh).triangle[0];
    const Vec3d corner = s.offset(1, t[0]);
    const float w = s.particles.offset[0].w;
    s.particles.offset[0] = {static_cast<float>(corner.x()), static_cast<float>(corner.y()), static_cast<float>(0.09 + corner.z() + 0.01),
                             w};
    const double before = s.offset(0, 0).z();
    s.add_constraint(0, 0, 1, t, {1, 0, 0}, {0, 0, -1}, 0, 0);
    s.advance(1, 1);
    const double soft_moved = before - s.offset(0, 0).z(), stiff_moved = s.offset(1, t[0]).z() - corner.z();
    EXPECT_NEAR(soft_moved / stiff_moved, 3, 0.05);
    EXPECT_NEAR(soft_moved + stiff_moved, 1e-4, 2e-6);
}

// M18. Between two fixed rigid plates the residual overlap does not grow; pressed vertices are counted.
TEST(Advance, M18_SqueezedBetweenTwoPlates) {
    AdvanceScene s;
    s.params.gravity.setZero();
    Tissue tissue;
    tissue.damping = 20;
    const uint32_t body =
        s.add_body(s.add_mesh(subdivided_sphere(0.03, 3)), Motion::kDeformable, Vec3d::Zero(), tissue, AnchorFrame::kShape);
    const uint32_t plate = s.add_mesh(flat_square(0.2));
    const uint32_t low = s.add_body(plate, Motion::kStatic, Vec3d(0, 0, -0.02));
    const uint32_t high = s.add_body(plate, Motion::kStatic, Vec3d(0, 0, 0.02));
    const auto deepest = [&] {
        double depth = 0;
        for (uint32_t v = 0; v < 642; ++v) depth = std::max(depth, std::abs(s.offset(body, v).z()) - 0.02);
        return depth;
    };
    const auto pass = [&] {
        s.clear_constraints();
        for (uint32_t v = 0; v < 642; ++v) {
            const double z = s.offset(body, v).z();
            if (z < -0.018) s.add_constraint(body, v, low, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, z + 0.02, 0.1);
            if (z > 0.018) s.add_constraint(body, v, high, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, -1}, 0.02 - z, 0.1);
        }
        s.advance(16, 32);
    };
    double before = deepest();
    EXPECT_GT(before, 9e-3);
    for (int i = 0; i < 12; ++i) {
        pass();
        const double now = deepest();
        EXPECT_LE(now, std::max(before, 2e-6)) << i;
        before = now;
    }
    EXPECT_LT(before, 0.05 * 9e-3);
    // one vertex with a plane on either side
    s.add_constraint(body, 0, low, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, 0, 0);
    s.add_constraint(body, 0, high, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, -1}, 0, 0);
    const double z = s.offset(body, 0).z();
    s.poses.origin[low].z() = z + 1e-3;
    s.poses.origin[high].z() = z - 3e-3;
    s.params.contact.push_speed = 1e9;
    s.advance(16, 16);
    EXPECT_GT(s.report.opposing_planes, 0u);
    EXPECT_NEAR(s.offset(body, 0).z(), z - 1e-3, 5e-6);  // midway
}

// A hand against a rigid wall: the coupling force is K times the device's lead, and so is the constraints'
// impulse.
TEST(Advance, HandRestsOnAWall) {
    AdvanceScene s;
    const uint32_t ball = s.add_body(s.add_mesh(subdivided_sphere(0.01, 2)), Motion::kHand, Vec3d(0, 0, 0.02));
    const uint32_t wall = s.add_body(s.add_mesh(flat_square(0.5)), Motion::kStatic);
    s.bodies.inv_mass[ball] = 1 / 0.05;
    HandTool tool;
    tool.body = ball;
    tool.tip = Vec3d(0, 0, 0.004);
    tool.coupling_stiffness = 600, tool.coupling_damping = 6;
    s.tools = {tool};
    DeviceState device;
    device.position = Vec3d(0, 0, 0.024);
    s.devices = {device, device};
    double lowest = 0;
    const MeshView view = mesh_view(s.meshes, s.bodies.mesh[ball]);
    for (const Vec3d& p : view.position) lowest = std::min(lowest, p.z());
    for (int ms = 0; ms < 600; ++ms) {
        s.devices[0] = s.devices[1];
        s.devices[1].position.z() = std::max(0.004, 0.024 - 1e-4 * ms);
        s.clear_constraints();
        for (uint32_t v = 0; v < view.position.size(); ++v) {
            if (view.position[v].z() < -0.0095) s.add_constraint(ball, v, wall, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, 0, 0);
        }
        if (s.tool_states.size() == 1) s.tool_states[0].contact_impulse.setZero();
        s.advance(1, 2);
    }
    EXPECT_NEAR(s.poses.origin[ball].z(), -lowest, 2e-6);
    const double force = 600 * (-lowest - 0.0);
    EXPECT_NEAR(s.tool_states[0].coupling_force.z(), -force, 1e-3 * force);
    EXPECT_NEAR(s.tool_states[0].contact_impulse.z(), force * 1e-3, 1e-3 * force * 1e-3);
}

// Without contact a hand arrives at the device's pose, rotating about the tip.
TEST(Advance, HandFollowsTheDevice) {
    AdvanceScene s;
    const uint32_t ball = s.add_body(s.add_mesh(subdivided_sphere(0.01, 1)), Motion::kHand, Vec3d(0, 0, 0));
    s.bodies.inv_mass[ball] = 1 / 0.05;
    HandTool tool;
    tool.body = ball;
    tool.tip = Vec3d(0, 0.1, 0);
    s.tools = {tool};
    DeviceState from, to;
    to.position = Vec3d(0.1, 0.2, 0.3), to.orientation = from_rotation_vector({0, 0, 1});
    s.device_stride = 401;
    s.devices.assign(401, to);
    for (int ms = 0; ms < 100; ++ms) {
        s.devices[ms].position = 0.01 * ms * to.position;
        s.devices[ms].orientation = from_rotation_vector({0, 0, 0.01 * ms});
    }
    s.advance(400, 400);
    s.devices.assign(401, to);
    s.advance(100, 100);
    const Vec3d tip = s.poses.origin[ball] + rotate(s.poses.orientation[ball], tool.tip);
    EXPECT_LT((tip - to.position).norm(), 1e-6);
    EXPECT_LT(rotation_vector(s.poses.orientation[ball], to.orientation).norm(), 1e-9);
}

// Press, drag and leave: error of the energy accounting relative to the peak elastic energy.
struct BookErrors {
    double worst, drift;  // from the first quarter of the passes to the last
};
BookErrors check_books(int passes, double friction, uint32_t substeps_per_ms = 1) {
    PressedShell s;
    std::vector<Keyframe> loop;
    for (int round = 0; round * 0.6 < passes / 60.0 + 1; ++round) {
        for (Keyframe key : s.paths.key) key.time += 0.6 * round, loop.push_back(key);
    }
    s.paths.key = loop;
    s.paths.keys[0] = {0, static_cast<uint32_t>(loop.size())};
    s.open_energy_account();
    double peak = 0, worst = 0, early = 0, late = 0;
    for (int pass = 0; pass < passes; ++pass) {
        s.pass(pass % 3 == 2 ? 16 : 17, substeps_per_ms, 1, friction);
        s.measure();
        peak = std::max(peak, s.energy.elastic);
        worst = std::max(worst, std::abs(s.energy.balance));
        if (pass < passes / 4) early += s.energy.balance;
        if (pass >= passes - passes / 4) late += s.energy.balance;
    }
    const BookErrors errors{worst / peak, (late - early) / (passes / 4) / peak};
    EXPECT_LT(s.energy.work_contact, 0);
    EXPECT_LT(s.energy.work_damping, 0);
    EXPECT_EQ(s.report.nonfinite_particles, 0u);
    std::printf("%d passes: worst balance %.3f %% of the peak, drift %.4f %%\n", passes, 100 * errors.worst, 100 * errors.drift);
    return errors;
}
TEST(Advance, BooksClose) {
    const BookErrors errors = check_books(150, 0.2);
    EXPECT_LT(errors.worst, 0.002);
    EXPECT_LT(std::abs(errors.drift), 0.0005);
}
// Ten thousand passes do 140 times the peak's work. The drift is the leapfrog's truncation, one-sided for
// nonlinear springs: a quarter with half the step. Breaks when work is not accounted for, or is half a step
// off.
TEST(LongAdvance, BooksCloseOverTenThousandPasses) {
    const BookErrors errors = check_books(10000, 0.2, 2), coarse = check_books(10000, 0.2, 1);
    EXPECT_LT(errors.worst, 0.005);
    EXPECT_GT(coarse.drift / errors.drift, 3);
    EXPECT_LT(coarse.drift / errors.drift, 5);
}

// M21. A held shell sinks by density V/A g depth / E for any mesh: stiffness and mass scale with geometry.
TEST(Advance, M21_RefinementKeepsTheDeflection) {
    double sag[2];
    for (int i = 0; i < 2; ++i) {
        AdvanceScene s;
        Tissue tissue;
        tissue.damping = 100;
        const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 2 + i, 0.01)), Motion::kDeformable, Vec3d::Zero(), tissue);
        const MeshInfo& info = s.meshes.info[0];
        const std::vector<Float4> start = s.particles.offset;
        s.advance(600, 600);
        sag[i] = 0;
        for (uint32_t v = 0; v < info.vertices.count; ++v) sag[i] += start[v].z - s.offset(body, v).z();
        sag[i] /= info.vertices.count;
        const double expected = tissue.density * info.volume / info.area * 9.81 * tissue.depth / tissue.youngs_modulus;
        EXPECT_NEAR(sag[i], expected, 0.01 * expected);
    }
    EXPECT_NEAR(sag[0], sag[1], 0.05 * sag[0]);
}

TEST(Advance, M22_UndampedEnergyDoesNotDrift) {
    AdvanceScene s;
    s.params.gravity.setZero();
    Tissue tissue;
    tissue.damping = 0;
    const uint32_t body =
        s.add_body(s.add_mesh(subdivided_sphere(0.05, 1, 0.1)), Motion::kDeformable, Vec3d::Zero(), tissue, AnchorFrame::kShape);
    for (uint32_t v = 0; v < 42; ++v) {
        const Vec3d x = s.offset(body, v);
        s.set_velocity(body, v, Vec3d(1, 5, 2).cross(x) + 3.0 * Vec3d(x.z(), x.x(), -x.y()));
    }
    s.open_energy_account();
    const double start = s.energy.kinetic + s.energy.elastic;
    double worst = 0;
    for (int block = 0; block < 1000; ++block) {
        s.advance(100, 100);
        s.measure();
        worst = std::max(worst, std::abs(s.energy.kinetic + s.energy.elastic - start));
    }
    EXPECT_LT(worst, 0.01 * start);
}

}  // namespace
}  // namespace trocar
