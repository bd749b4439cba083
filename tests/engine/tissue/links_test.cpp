// Springs between bodies, and springs that break: closed forms, momentum, energy accounting, limits, names.
#include "engine/tissue/links.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <cstring>
#include <random>

#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "systems/constrain/islands.hpp"
#include "systems/prepare/link_bodies.hpp"
#include "systems/prepare/tear_bodies.hpp"
#include "tests/reference/measures.hpp"
#include "tests/systems/advance/tissue/spring_graph.hpp"
namespace trocar {
namespace {

struct LinkScene : AdvanceScene {
    LinkScratch link_scratch;
    HoldingGroups holding;

    LinkScene() { params.gravity.setZero(); }
    LinkWorld world() const { return {surfaces(), solids, {}}; }
    OtherForces other() {
        find_holding_groups(links, static_cast<uint32_t>(bodies.mesh.size()), holding);
        return {.solids = &solids, .links = &links, .holding = &holding, .tears = &tears, .torn = &torn, .torn_springs = &torn_springs};
    }

    // Masses without springs of their own.
    uint32_t add_masses(const std::vector<Vec3d>& position, double mass) {
        return add_graph(*this, {position, std::vector<double>(position.size(), mass), {}, 0, 1});
    }
    Entity link(uint32_t body, uint32_t holder, double stiffness, double rest = -1) {
        LinkGroup g;
        g.body = body, g.holder = holder, g.stiffness = stiffness, g.rest = rest, g.gauge = 0.1;
        const Entity name = add_link_group(links, g);
        EXPECT_GT(make_links(world(), name.index, link_scratch, links, energy), 0u);
        update_link_limits(bodies, solids, particles, link_scratch, links);
        return name;
    }
    void let_break(uint32_t body, double strain) {
        TearBody tear;
        tear.body = body, tear.break_strain = strain;
        tears.body.push_back(tear);
        torn.spring.assign(springs.neighbour.size(), 0);
        copy_torn_springs(springs, solids, bodies, tears, torn, torn_springs);
    }
    void step(uint32_t ticks, uint32_t substeps) {
        params.ticks = ticks, params.substeps = substeps;
        tool_states.resize(tools.size());
        AdvanceResult done;
        const AdvanceInputs in{meshes, springs, bodies, anchors, paths, tools, devices, device_stride, other()};
        std::vector<uint32_t> all(contact_constraints.body.size());
        for (uint32_t row = 0; row < all.size(); ++row) all[row] = row;
        advance_island(params, in, moving(), all, scratch, {particles, poses, contact_constraints, tool_states}, done);
        params.tick += ticks;
        add_advance_result(done, energy, report);
    }
    void measure_all() {
        measure_energy({springs, bodies, poses, particles, anchors, params.gravity, other()}, energy_start, energy_scratch, energy);
    }
    void open() {
        energy = {};
        energy_start = {};
        measure_all();
    }
};

// Which groups hold a body, against the definition. Breaks when waiting or freed groups are included, or the
// order of groups is lost.
TEST(HoldingGroups, OfEveryBodyInOrder) {
    Links links;
    std::mt19937 random(5);
    for (uint32_t g = 0; g < 200; ++g) {
        LinkGroup group;
        group.body = random() % 4 == 0 ? kNone : random() % 7;
        group.links.count = random() % 3;
        links.group.push_back(group);
    }
    HoldingGroups holding;
    for (int again = 0; again < 2; ++again) {
        find_holding_groups(links, 8, holding);
        for (uint32_t body = 0; body < 8; ++body) {
            std::vector<uint32_t> expected;
            for (uint32_t g = 0; g < links.group.size(); ++g)
                if (links.group[g].body == body && links.group[g].links.count > 0) expected.push_back(g);
            const auto of = holding.of(body);
            EXPECT_EQ(std::vector<uint32_t>(of.begin(), of.end()), expected) << body;
        }
    }
    EXPECT_TRUE(holding.of(7).empty());
    find_holding_groups({}, 3, holding);
    EXPECT_TRUE(holding.of(2).empty());
}

// Two masses joined by a link only oscillate with omega^2 = k (1/m + 1/M); their centre stays. Second order
// in the step.
TEST(Links, TwoBodiesSwingAsTheClosedFormSays) {
    double error[2];
    const double m = 0.02, big = 0.05, k = 60, rest = 0.1, pull = 0.01;
    const double omega = std::sqrt(k * (1 / m + 1 / big)), reduced = m * big / (m + big);
    for (const uint32_t per_ms : {1u, 2u}) {
        LinkScene s;
        const uint32_t a = s.add_masses({{0, 0, 0}}, m), b = s.add_masses({{rest + pull, 0, 0}}, big);
        s.link(a, b, k, rest);
        s.open();
        EXPECT_NEAR(s.energy.links, 0.5 * k * pull * pull, 1e-6 * s.energy.links);
        double worst = 0, unbalanced = 0;
        for (int n = 1; n <= 200; ++n) {
            s.step(1, per_ms);
            const double distance = s.offset(b, 0).x() - s.offset(a, 0).x();
            worst = std::max(worst, std::abs(distance - rest - pull * std::cos(omega * n * 1e-3)));
            s.measure_all();
            unbalanced = std::max(unbalanced, std::abs(s.energy.balance));
        }
        error[per_ms - 1] = worst;
        const Momentum p = measure_momentum(s.bodies, s.poses, s.particles, a), q = measure_momentum(s.bodies, s.poses, s.particles, b);
        EXPECT_LT((p.linear + q.linear).norm(), 1e-6 * reduced * omega * pull);
        // leapfrog's energy at half steps oscillates by (omega dt)^2 / 4 of it
        EXPECT_LT(unbalanced, 0.3 * std::pow(omega * 1e-3 / per_ms, 2) * 0.5 * k * pull * pull);
    }
    std::printf("link: error %.3g, %.3g of the amplitude, order %.2f\n", error[0] / pull, error[1] / pull, std::log2(error[0] / error[1]));
    EXPECT_NEAR(std::log2(error[0] / error[1]), 2, 0.15);
    // phase error of the leapfrog: omega t (omega dt)^2 / 24
    double expected = 0;
    for (int n = 1; n <= 200; ++n)
        expected = std::max(expected, omega * n * 1e-3 * std::pow(omega * 1e-3, 2) / 24 * std::abs(std::sin(omega * n * 1e-3)));
    EXPECT_NEAR(error[0] / pull, expected, 0.05 * expected);
}

// Masses held by points of a free rigid body, off its centre: the force on a mass also pulls and rotates the
// body.
TEST(Links, HeldByAFreeBodyMomentumIsConserved) {
    LinkScene s;
    const uint32_t cloud = s.add_masses({{0.1, 0.02, 0}, {0.12, -0.03, 0.01}, {0.09, 0, 0.05}}, 0.01);
    const uint32_t ball = s.add_body(s.add_mesh(subdivided_sphere(0.05, 1, 0.2)), Motion::kFree);
    s.bodies.tissue[ball].damping = 0;
    ASSERT_TRUE(set_rigid_mass(s.meshes, ball, 0.05, s.bodies, s.particles));
    s.link(cloud, ball, 40);
    s.set_velocity(cloud, 0, {0.5, 1, -0.3});
    s.set_velocity(cloud, 2, {-0.2, 0.4, 0.8});
    s.open();
    const auto total = [&] {
        Momentum sum;
        for (const uint32_t body : {cloud, ball}) {
            const Momentum m = measure_momentum(s.bodies, s.poses, s.particles, body);
            sum.linear += m.linear, sum.angular += m.angular;
        }
        return sum;
    };
    const Momentum before = total();
    const double start = s.energy.kinetic;
    const uint32_t substeps = count_substeps(s.bodies, s.moving(), 0.01, 1e-3, s.links.stable_dt);
    double turned = 0;
    for (int n = 0; n < 100; ++n) {
        s.step(10, 4 * substeps);
        turned = std::max(turned, s.poses.angular_velocity[ball].norm());
    }
    EXPECT_GT(turned, 1) << "the ball must turn for its side to be tested";
    const Momentum after = total();
    EXPECT_LT((after.linear - before.linear).norm(), 1e-5 * before.linear.norm());
    // the energy accounting extrapolates positions half a step back along velocities: second order in the
    // step
    EXPECT_LT((after.angular - before.angular).norm(), 2e-3 * before.angular.norm());
    s.measure_all();
    EXPECT_LT(std::abs(s.energy.balance), 1e-2 * start);
}

// A body between two scripted holders that pull unequally: its change of momentum is the impulse of the
// links, and the work of the scripts is in the energy accounting.
TEST(Links, PullOfTheHoldersIsTheMomentumOfTheTissue) {
    LinkScene s;
    const uint32_t ball =
        s.add_body(s.add_mesh(subdivided_sphere(0.04, 2, 0.05)), Motion::kDeformable, Vec3d::Zero(), {}, AnchorFrame::kShape);
    s.bodies.tissue[ball].damping = 0;
    std::array<uint32_t, 2> holder;
    for (int side = 0; side < 2; ++side) {
        const double x = side == 0 ? -0.04 : 0.04;
        holder[side] = s.add_body(s.add_mesh(subdivided_sphere(0.01, 1)), Motion::kKinematic, {x, 0, 0});
        s.add_path(holder[side], {{0, {x, 0, 0}, {}, 0}, {0.3, {x * (side == 0 ? 1.5 : 2.0), 0.01, 0}, {}, 0}});
        LinkGroup g;
        g.body = ball, g.holder = holder[side], g.stiffness = 50, g.gauge = 0.01;
        g.region = {RegionKind::kSphere, Vec3d::Zero(), Vec3d::Zero(), 0.015};
        ASSERT_GT(make_links(s.world(), add_link_group(s.links, g).index, s.link_scratch, s.links, s.energy), 5u);
    }
    update_link_limits(s.bodies, s.solids, s.particles, s.link_scratch, s.links);
    s.open();
    const uint32_t substeps = count_substeps(s.bodies, s.moving(), 0.01, 1e-3, s.links.stable_dt);
    double work = 0, worst = 0;
    Vec3d before = Vec3d::Zero();
    for (int n = 0; n < 60; ++n) {
        for (LinkGroup& g : s.links.group) g.impulse.setZero();
        s.step(10, substeps);
        const Vec3d now = measure_momentum(s.bodies, s.poses, s.particles, ball).linear;
        const Vec3d given = s.links.group[0].impulse + s.links.group[1].impulse;
        const double size = s.links.group[0].impulse.norm() + s.links.group[1].impulse.norm();
        EXPECT_LT((now - before - given).norm(), 1e-4 * size) << n;
        before = now;
        s.measure_all();
        work = std::max(work, s.energy.work_hand);
        worst = std::max(worst, std::abs(s.energy.balance));
    }
    std::printf("pulled: work %.3g J, books off by %.2f %%\n", work, 100 * worst / work);
    EXPECT_GT(work, 1e-3);
    EXPECT_LT(worst, 1e-2 * work);
}

// M07 for links: the limit of two linked masses is 2 / omega; kStableShare of it is used. Just below the
// limit motion is bounded, just above it grows.
TEST(HardCases, M07_LinksAreInTheStableStep) {
    const double m = 1e-3, big = 4e-3, k = 500, omega = std::sqrt(k * (1 / m + 1 / big));
    for (const double share : {0.99, 1.05}) {
        LinkScene s;
        const uint32_t a = s.add_masses({{0, 0, 0}}, m), b = s.add_masses({{0.1, 0, 0}}, big);
        s.link(a, b, k, 0.1);
        EXPECT_NEAR(s.links.stable_dt[a], kStableShare * 2 / omega, 1e-6 / omega);
        EXPECT_NEAR(s.links.stable_dt[b], kStableShare * 2 / omega, 1e-6 / omega);
        s.set_velocity(a, 0, {1e-4, 0, 0});
        const double dt = share * 2 / omega;
        const uint32_t ticks = static_cast<uint32_t>(std::round(dt * 1e3 * 1000));
        double peak = 0;
        for (int n = 0; n < 5; ++n) {
            s.step(ticks, 1000);  // ticks ms in 1000 substeps: dt
            peak = std::max(peak, std::abs(s.offset(b, 0).x() - s.offset(a, 0).x() - 0.1));
        }
        if (share < 1) {
            EXPECT_LT(peak, 10 * 1e-4 / omega / std::sqrt(1 - share * share));
        } else {
            EXPECT_TRUE(peak > 1 || s.report.nonfinite_particles > 0) << peak;
        }
    }
}

// M02, M03. Linked nodes at one position, also moving: no direction, no force, all values finite.
TEST(HardCases, M02_M03_LinkedNodesInOnePlace) {
    for (const double rest : {0.0, 0.05}) {
        LinkScene s;
        const uint32_t a = s.add_masses({{0, 0, 0}}, 0.01), b = s.add_masses({{0, 0, 0}}, 0.01);
        s.link(a, b, 100, rest);
        s.step(10, 10);
        EXPECT_EQ(s.offset(a, 0).norm() + s.offset(b, 0).norm(), 0);
        s.set_velocity(a, 0, {0, 0.1, 0});
        s.step(50, 50);
        EXPECT_TRUE(s.offset(a, 0).allFinite() && s.velocity(b, 0).allFinite());
        EXPECT_NEAR((s.velocity(a, 0) + s.velocity(b, 0)).y(), 0.1, 1e-6);
        EXPECT_EQ(s.report.nonfinite_particles, 0u);
    }
}

// M14 for links: a fixed node is not held, a fixed far end acts like a wall.
TEST(HardCases, M14_FixedNodesAreNotLinked) {
    LinkScene s;
    const uint32_t a = add_graph(s, {{{0, 0, 0}, {0.1, 0, 0}}, {0, 0.01}, {}, 0, 1}), b = add_graph(s, {{{0.1, 0.01, 0}}, {0.0}, {}, 0, 1});
    s.link(a, b, 100, 0.01);
    ASSERT_EQ(s.links.node, std::vector<uint32_t>{1});
    EXPECT_NEAR(s.links.stable_dt[a], kStableShare * 2 / std::sqrt(100 / 0.01), 1e-9) << "against a wall: k / m";
    s.set_velocity(a, 1, {0, -0.1, 0});
    s.step(40, 40);
    EXPECT_EQ(s.offset(b, 0), Vec3d(static_cast<double>(0.1f), static_cast<double>(0.01f), 0));
    EXPECT_LT(s.offset(a, 1).norm(), 0.11);
}

// M10 for links. A NaN in one body does not spread along a link into the next: the one is restored, the other
// continues and the link becomes active again.
TEST(HardCases, M10_ANanDoesNotPassALink) {
    LinkScene s;
    const uint32_t a = s.add_masses({{0, 0, 0}, {0.5, 0, 0}}, 0.01), b = s.add_masses({{0.1, 0, 0}}, 0.01);
    s.link(a, b, 100, 0.08);
    s.open();
    s.step(10, 10);
    s.particles.velocity_y[s.range(a).first] = std::nanf("");
    for (int n = 0; n < 5; ++n) {
        s.step(10, 10);
        EXPECT_TRUE(s.offset(b, 0).allFinite() && s.velocity(b, 0).allFinite()) << n;
        EXPECT_TRUE(s.offset(a, 0).allFinite() && s.velocity(a, 0).allFinite()) << n;
    }
    EXPECT_EQ(s.report.nonfinite_particles, 1u);
    EXPECT_EQ(s.links.whole[0], 1);
    EXPECT_GT(s.velocity(a, 0).norm() + s.velocity(b, 0).norm(), 0);
    s.measure_all();
    EXPECT_TRUE(std::isfinite(s.energy.links) && std::isfinite(s.energy.balance));
}

// A hand that holds tissue feels the reaction to its force; the work of the hand is in the energy accounting.
TEST(Links, AHandFeelsWhatItHolds) {
    LinkScene s;
    const uint32_t mass = s.add_masses({{0.05, 0, 0}}, 0.05);
    s.bodies.tissue[mass].damping = 20;
    const uint32_t hand = s.add_body(s.add_mesh(subdivided_sphere(0.01, 1)), Motion::kHand);
    s.bodies.inv_mass[hand] = 20;
    HandTool tool;
    tool.body = hand;
    s.tools.push_back(tool);
    s.devices.resize(2);
    s.tool_states.resize(1);
    s.link(mass, hand, 30);
    s.open();
    double work = 0, worst = 0;
    for (int ms = 0; ms < 600; ++ms) {
        s.devices[0].position = Vec3d(0, 0.05 * std::min(ms, 400) / 400, 0);
        s.devices[1].position = Vec3d(0, 0.05 * std::min(ms + 1, 400) / 400, 0);
        const Vec3d before = s.links.group[0].impulse, felt = s.tool_states[0].contact_impulse;
        s.step(1, 1);
        EXPECT_LT((s.links.group[0].impulse - before + s.tool_states[0].contact_impulse - felt).norm(), 1e-15);
        s.measure_all();
        work = std::max(work, s.energy.work_hand);
        worst = std::max(worst, std::abs(s.energy.balance));
    }
    EXPECT_GT(work, 1e-4);
    EXPECT_LT(worst, 1e-2 * work);
    EXPECT_NEAR(s.offset(mass, 0).y(), 0.05, 5e-3) << "it comes along";
    EXPECT_GT(s.tool_states[0].contact_impulse.norm(), 1e-3);
}

// Links also hold bodies with other integrators: masses on links to a wall come to rest where their weight is
// borne. With leapfrog the energy accounting balances; in implicit steps the link pulls as at the start of
// the step: first order, omega dt of the potential energy exchanged.
TEST(Links, HoldBodiesOfEveryIntegrator) {
    const double m = 0.02, k = 40, omega = std::sqrt(k / m), drop = m * 9.81 / k;
    for (const Integrator integrator : {Integrator::kLeapfrog, Integrator::kBackwardEuler}) {
        double worst[2] = {};
        for (const uint32_t per_ms : {1u, 2u}) {
            LinkScene s;
            s.params.gravity = Vec3d(0, 0, -9.81);
            const uint32_t chain = add_graph(s, {{{0, 0, 0}, {0.1, 0, 0}}, {m, m}, {{0, 1}}, 0.1, 50});
            s.bodies.tissue[chain].damping = 10;
            s.bodies.stepping.resize(1);
            s.bodies.stepping[0].integrator = integrator;
            const uint32_t wall = s.add_body(s.add_mesh(subdivided_sphere(0.01, 1)), Motion::kStatic);
            s.link(chain, wall, k);
            s.open();
            for (int n = 0; n < 40; ++n) {
                s.step(100, 100 * per_ms);
                s.measure_all();
                worst[per_ms - 1] = std::max(worst[per_ms - 1], std::abs(s.energy.balance));
            }
            for (uint32_t v = 0; v < 2; ++v) EXPECT_NEAR(s.offset(chain, v).z(), -drop, 2e-5) << static_cast<int>(integrator);
        }
        const double moved = 2 * m * 9.81 * 2 * drop;
        std::printf("integrator %d: books off by %.2g and %.2g of what falls\n", static_cast<int>(integrator), worst[0] / moved,
                    worst[1] / moved);
        EXPECT_LT(worst[0], (integrator == Integrator::kLeapfrog ? 1e-2 : omega * 1e-3) * moved) << static_cast<int>(integrator);
        EXPECT_LT(worst[1], 0.6 * worst[0] + 1e-3 * moved) << static_cast<int>(integrator);
    }
}

// A holder that sinks below a plate, slides aside and waits pulls two masses onto the plate: the hand's work
// is in the links, 1/2 k d^2 each, and in the friction loss. In every substep the links pull the masses in
// and the contact constraints push them out.
TEST(Links, BooksOfWhatIsPulledOntoAPlate) {
    const double m = 0.02, k = 40, sink = 0.02, aside = 0.03, slack = 1e-4;
    for (const double friction : {0.0, 0.3}) {
        LinkScene s;
        const uint32_t chain = add_graph(s, {{{0, 0, slack}, {0.1, 0, slack}}, {m, m}, {{0, 1}}, 0.1, 50});
        s.bodies.tissue[chain].damping = 20;
        const uint32_t holder = s.add_body(s.add_mesh(subdivided_sphere(0.01, 1)), Motion::kKinematic, {0, 0, slack});
        s.add_path(holder, {{0, {0, 0, slack}, {}, 0}, {0.4, {0, 0, -sink}, {}, 0}, {0.8, {aside, 0, -sink}, {}, 0}});
        s.link(chain, holder, k);
        const uint32_t plate = s.add_body(s.add_mesh(flat_square(1.0)), Motion::kStatic);
        for (const uint32_t v : {0u, 1u}) s.add_constraint(chain, v, plate, {0, 1, 2}, {0.5, 0.2, 0.3}, {0, 0, 1}, slack, friction);
        s.open();
        double worst = 0;
        for (int n = 0; n < 150; ++n) {
            s.step(10, 20);
            s.measure_all();
            worst = std::max(worst, std::abs(s.energy.balance));
        }
        // an upper bound: once a mass sticks, friction holds the rest of the displacement aside
        const double held = 0.5 * k * (sink * sink + std::pow(std::min(aside, friction * sink), 2));
        std::printf("pulled onto a plate, friction %.1f: links hold %.6f of the most, books off by %.2g of the hand's work\n", friction,
                    s.energy.links / (2 * held), worst / s.energy.work_hand);
        EXPECT_LT(s.energy.links, 2.001 * held);
        EXPECT_GT(s.energy.links, 0.999 * k * sink * sink);
        EXPECT_LT(worst, 1e-3 * s.energy.work_hand);
    }
}

// A heavy mass whose holder moves away at constant speed: the link's strain is v t / gauge, and it breaks in
// the step in which that passes the limit, neither earlier nor later.
TEST(Links, BreaksAtItsStrainWithinOneStep) {
    const double speed = 0.02, strain = 0.25, gauge = 0.1, due = strain * gauge / speed;  // 1.25 s
    LinkScene s;
    const uint32_t mass = s.add_masses({{0, 0, 0}}, 1e6);
    const uint32_t holder = s.add_body(s.add_mesh(subdivided_sphere(0.01, 0)), Motion::kKinematic);
    std::vector<Keyframe> even;  // it passes 0 at full speed
    for (int t = -1; t <= 3; ++t) even.push_back({double(t), {t * speed, 0, 0}, {}, 0});
    s.add_path(holder, even);
    const Entity name = s.link(mass, holder, 1);
    s.links.group[name.index].break_strain = strain;
    s.open();
    uint32_t broke = 0;
    for (uint32_t ms = 1; ms <= 2000 && broke == 0; ++ms) {
        s.step(1, 1);
        if (s.links.whole[0] == 0) broke = ms;
    }
    std::printf("link: broke in the step that ends at %u ms, due at %g ms\n", broke, due * 1e3);
    EXPECT_NEAR(broke, due * 1e3, 1);
    EXPECT_EQ(s.report.broken_links, 1u);
    EXPECT_EQ(s.links.group[name.index].broken, 1u);
    EXPECT_NEAR(s.energy.work_links, -0.5 * std::pow(strain * gauge, 2), 2e-3 * std::pow(strain * gauge, 2));
    s.measure_all();
    EXPECT_EQ(s.energy.links, 0);
    EXPECT_LT(std::abs(s.energy.balance), 1e-2 * s.energy.work_hand);
    EXPECT_GT(s.links.group[name.index].largest_strain, strain);
    drop_broken_links(s.links);
    EXPECT_TRUE(s.links.node.empty());
    EXPECT_EQ(s.links.group[name.index].links.count, 0u);
}

// One spring between a fixed mass and one that leaves it with speed v: x = v / omega sin omega t, so that it
// breaks at asin(strain L omega / v) / omega; then the mass continues at its speed of that time.
TEST(Breaking, OneSpringAtItsStrainWithinOneStep) {
    const double m = 0.02, k = 30, rest = 0.1, strain = 0.3, v = 2.5, omega = std::sqrt(k / m);
    const double due = std::asin(strain * rest * omega / v) / omega;
    for (const uint32_t per_ms : {1u, 4u}) {
        LinkScene s;
        const uint32_t b = add_graph(s, {{{0, 0, 0}, {rest, 0, 0}}, {0, m}, {{0, 1}}, rest, k});
        s.let_break(b, strain);
        s.set_velocity(b, 1, {v, 0, 0});
        s.open();
        const double start = s.energy.kinetic;
        uint32_t ms = 0;
        for (; ms < 100 && s.report.broken_springs == 0; ++ms) s.step(1, per_ms);
        std::printf("spring: broke in ms %u, due at %.3f ms\n", ms, due * 1e3);
        // checked every ms; one step more is the tolerance
        EXPECT_GE(ms * 1e-3 + 1e-3 / per_ms, due);
        EXPECT_LE(ms * 1e-3 - 1e-3 - 1e-3 / per_ms, due);
        s.measure_all();
        EXPECT_EQ(s.energy.elastic, 0);
        EXPECT_NEAR(s.energy.work_links, -0.5 * k * std::pow(strain * rest, 2), 0.08 * k * std::pow(strain * rest, 2));
        EXPECT_LT(std::abs(s.energy.balance), 1e-2 * start);
        const Vec3d before = s.velocity(b, 1);
        s.step(5, 5);
        EXPECT_EQ(s.velocity(b, 1), before) << "nothing pulls any more";
        EXPECT_EQ(s.report.broken_springs, 1u) << "a spring breaks once, from both its ends";
    }
}

// A chain stretched slowly: every spring carries the same force, and the shortest (most strained) breaks when
// the chain is longer by n strain times its length; no other breaks, because the force is then gone.
TEST(Breaking, TheWeakestOfAChainWhenItsStrainIsReached) {
    constexpr uint32_t kSprings = 8, kShort = 5;
    const double rest = 0.1, shorter = 0.08, strain = 0.2, k = 50, speed = 0.02;
    LinkScene s;
    SpringGraph g;
    g.stiffness = k;
    double x = 0;
    for (uint32_t i = 0; i <= kSprings; ++i) {
        g.position.push_back({x, 0, 0});
        g.mass.push_back(i == 0 || i == kSprings ? 0.0 : 0.005);
        if (i > 0) g.edge.push_back({i - 1, i});
        x += i + 1 == kShort ? shorter : rest;
    }
    const uint32_t b = add_graph(s, g);
    s.bodies.tissue[b].damping = 40;
    s.let_break(b, strain);
    const uint32_t end = s.range(b).first + kSprings;
    const double due = kSprings * strain * shorter / speed;
    double broke = 0;
    for (uint32_t ms = 1; ms <= 8000 && broke == 0; ++ms) {
        s.particles.offset[end].x += static_cast<float>(speed * 1e-3);
        s.step(1, 2);
        if (s.report.broken_springs > 0) broke = ms * 1e-3;
    }
    // it lags by damping: c m sum(i / n) v of force, which shows as strain; and by the rounding of the end's
    // motion to float
    std::printf("chain: broke at %.3f s, due at %.3f s\n", broke, due);
    EXPECT_NEAR(broke, due, 0.01 * due);
    s.step(2000, 4000);
    EXPECT_EQ(s.report.broken_springs, 1u);
    EXPECT_EQ(std::count(s.torn.spring.begin(), s.torn.spring.end(), 1), 2);
    for (uint32_t i = 1; i < kSprings; ++i) {
        // both halves have their own length again
        const double at_rest = i < kShort ? g.position[i].x() : s.offset(b, kSprings).x() - (g.position[kSprings].x() - g.position[i].x());
        EXPECT_NEAR(s.offset(b, i).x(), at_rest, 1e-4) << i;
    }
    // the state alone determines which spring is gone: recomputed from it, it is the same
    const TornSprings now = s.torn_springs;
    copy_torn_springs(s.springs, s.solids, s.bodies, s.tears, s.torn, s.torn_springs);
    EXPECT_EQ(now.neighbour, s.torn_springs.neighbour);
    EXPECT_EQ(now.rest_length, s.torn_springs.rest_length);
}

// A sheet that hangs from its upper rim and is hit: hundreds of springs break. Same bits for any number of
// threads, no energy gain, and the sheet continues without them.
TEST(Breaking, ATornSheetSameBitsForAnyThreads) {
    struct Run {
        std::vector<uint8_t> broken;
        std::vector<Float4> position;
        uint64_t count = 0;
    };
    const auto run = [](uint32_t threads) {
        Run out;
        ThreadPool pool(threads);
        pool.run([&] {
            LinkScene s;
            s.params.gravity = Vec3d(0, 0, -9.81);
            const SpringGraph g = sheet_graph(100, 0.2, 0.05, 40);
            const uint32_t b = add_graph(s, g);
            s.bodies.tissue[b].damping = 2;
            s.let_break(b, 0.15);
            for (uint32_t v = 4500; v < 5500; ++v) s.set_velocity(b, v, {0, 3, -1});
            s.open();
            const double start = s.energy.kinetic;
            for (int n = 0; n < 10; ++n) {
                s.step(10, count_substeps(s.bodies, s.moving(), 0.01, 1e-3));
                s.measure_all();
                EXPECT_LT(std::abs(s.energy.balance), 2e-2 * start);
            }
            EXPECT_EQ(s.report.nonfinite_particles, 0u);
            out = {s.torn.spring, s.particles.offset, s.report.broken_springs};
        });
        return out;
    };
    const Run one = run(1), three = run(3);
    std::printf("sheet: %llu springs broke\n", static_cast<unsigned long long>(one.count));
    EXPECT_GT(one.count, 100u);
    EXPECT_LT(one.count, 20000u);
    EXPECT_EQ(2 * one.count, static_cast<uint64_t>(std::count(one.broken.begin(), one.broken.end(), 1)));
    EXPECT_EQ(one.broken, three.broken);
    EXPECT_EQ(0, std::memcmp(one.position.data(), three.position.data(), one.position.size() * sizeof(Float4)));
}

// Names of groups: a freed one is stale for ever, also when its slot is reused; other groups keep their
// links.
TEST(Links, NamesStaySafe) {
    LinkScene s;
    const uint32_t a = s.add_masses({{0, 0, 0}, {0.01, 0, 0}}, 0.01), b = s.add_masses({{0, 0.1, 0}}, 0.01),
                   c = s.add_masses({{0, 0.2, 0}}, 0.01);
    const Entity first = s.link(a, b, 10), second = s.link(a, c, 20);
    EXPECT_EQ(s.links.group[second.index].links.first, 2u);
    EXPECT_TRUE(free_link_group(s.links, first, s.energy));
    EXPECT_FALSE(free_link_group(s.links, first, s.energy));
    EXPECT_EQ(find_link_group(s.links, first), kNone);
    EXPECT_EQ(s.links.group[second.index].links.first, 0u);
    EXPECT_EQ(s.links.node.size(), 2u);
    const Entity third = s.link(b, c, 30);
    EXPECT_EQ(third.index, first.index);
    EXPECT_NE(third.generation, first.generation);
    EXPECT_EQ(find_link_group(s.links, first), kNone);
    EXPECT_EQ(find_link_group(s.links, third), third.index);
    EXPECT_EQ(s.links.node, (std::vector<uint32_t>{0, 0, 1})) << "rows lie in the order of their groups";
    EXPECT_EQ(find_link_group(s.links, {7, 0}), kNone);
    EXPECT_EQ(find_link_group(s.links, {}), kNone);
    reserve_links(s.links, 8, 3);  // spare groups have names of their own too
    for (uint32_t g = 0; g < s.links.group.size(); ++g) EXPECT_EQ(s.links.group[g].entity.index, g);
}

// A staple set while bodies move: one link between the nearest nodes, contracted to its length; the work of
// contraction is accounted. Out of reach none is made.
TEST(Links, AStapleDrawsTwoTissuesTogether) {
    LinkScene s;
    const uint32_t a = s.add_masses({{0, 0, 0}, {0.05, 0, 0}}, 0.01), b = s.add_masses({{0.05, 0.02, 0}, {0, 0.02, 0}}, 0.01);
    for (const uint32_t body : {a, b}) s.bodies.tissue[body].damping = 20;
    s.open();
    Staple staple{.a = a, .b = b, .position = {0.05, 0.01, 0}, .reach = 0.005, .stiffness = 100, .rest = 0.002};
    EXPECT_EQ(add_staple(s.world(), staple, s.links, s.energy), Entity{});
    EXPECT_TRUE(s.links.node.empty());
    staple.reach = 0.015;
    const Entity name = add_staple(s.world(), staple, s.links, s.energy);
    ASSERT_EQ(find_link_group(s.links, name), name.index);
    ASSERT_EQ(s.links.node, std::vector<uint32_t>{1});
    EXPECT_EQ(s.links.far_node, std::vector<uint32_t>{0});
    EXPECT_NEAR(s.energy.work_links, 0.5 * 100 * 0.018 * 0.018, 1e-6);
    // the masses pass through each other, where the force reverses by 2 k rest: up to half of that times the
    // displacement of a step is lost
    for (int n = 0; n < 100; ++n) s.step(10, 100);
    EXPECT_NEAR((s.offset(a, 1) - s.offset(b, 0)).norm(), 0.002, 1e-5);
    s.measure_all();
    EXPECT_LT(std::abs(s.energy.balance), 1e-2 * s.energy.work_links);
}

// Linked bodies form one island and one sleeping group, but a static holder joins no island.
TEST(Links, JoinIslands) {
    Bodies bodies;
    bodies.motion = {Motion::kDeformable, Motion::kStatic, Motion::kDeformable, Motion::kKinematic, Motion::kDeformable};
    Links links;
    for (const auto& [body, holder] : {std::array<uint32_t, 2>{0, 4}, {2, 1}, {4, 1}, {2, 3}, {0, 3}}) {
        LinkGroup g;
        g.body = body, g.holder = holder, g.links.count = body == 0 && holder == 3 ? 0 : 1;
        links.group.push_back(g);
    }
    std::vector<std::array<uint32_t, 2>> joined;
    joined_by_links(bodies, links, joined);
    EXPECT_EQ(joined, (std::vector<std::array<uint32_t, 2>>{{0, 4}, {2, 3}}));
    IslandsScratch scratch;
    Islands islands;
    find_islands(bodies, {}, scratch, islands, joined);
    EXPECT_EQ(islands.body, (std::vector<uint32_t>{0, 4, 2}));
    EXPECT_EQ(islands.bodies.size(), 2u);
}

// Scripted times and grips: made in the first pass that begins after the time, released likewise; a grip
// holds while the button is pressed, and again at the next press. Sleeping bodies wake.
TEST(Links, AreMadeAndReleasedInTime) {
    LinkScene s;
    const uint32_t a = s.add_masses({{0, 0, 0}}, 0.01), b = s.add_masses({{0.1, 0, 0}}, 0.01);
    s.sleep.still = {500, 500}, s.sleep.group = {0, 0};
    LinkGroup g;
    g.body = a, g.holder = b, g.stiffness = 5, g.gauge = 1, g.begin = 0.1, g.end = 0.2;
    add_link_group(s.links, g);
    g.tool = 0;
    add_link_group(s.links, g);
    std::vector<ToolState> tools(1);
    const auto at = [&](double now, bool pressed) {
        tools[0].device.buttons = pressed ? 1 : 0;
        link_bodies(now, tools, s.world(), s.link_scratch, s.links, s.sleep, s.energy, s.report);
        return std::array<uint32_t, 2>{s.links.group[0].links.count, s.links.group[1].links.count};
    };
    using Counts = std::array<uint32_t, 2>;
    EXPECT_EQ(at(0.0999, false), (Counts{0, 0}));
    EXPECT_TRUE(std::isinf(s.links.stable_dt[a]));
    EXPECT_EQ(s.sleep.still[0], 500u);
    EXPECT_EQ(at(0.1, true), (Counts{1, 1}));
    EXPECT_EQ(s.sleep.still, (std::vector<uint32_t>{0, 0}));
    EXPECT_TRUE(std::isfinite(s.links.stable_dt[a]));
    EXPECT_EQ(s.report.links, 2u);
    EXPECT_EQ(at(0.15, false), (Counts{1, 0}));
    EXPECT_EQ(at(0.16, true), (Counts{1, 1}));
    EXPECT_EQ(at(0.2, true), (Counts{0, 1}));
    EXPECT_EQ(at(0.15, true), (Counts{0, 1})) << "what was released by its script is done";
    EXPECT_EQ(s.links.group[0].phase, LinkPhase::kDone);
}

}  // namespace
}  // namespace trocar
