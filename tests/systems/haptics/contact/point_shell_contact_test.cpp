#include "systems/haptics/contact/point_shell_contact.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "engine/mesh/mesh_topology.hpp"
#include "tests/reference/sample_meshes.hpp"
#include "tests/reference/shell_rig.hpp"

// Tools with a point shell: closed forms, the minimum of an energy measured by brute force, and cases T06 to
// T18 as far as they concern forces and torques of such tools.
namespace trocar {
namespace {

using reference::make_box;
using reference::make_ground;
using reference::make_joined_patch;
using reference::make_plane;
using reference::make_sphere;
using reference::shell_energy;
using reference::ShellRig;

std::vector<ShellPoint> shell_of(const Mesh& mesh, uint32_t count, const Vec3d& tip = Vec3d::Zero()) {
    Meshes meshes;
    return make_point_shell(mesh_view(meshes, add_prototype(meshes, mesh, Admission::kSolid)), tip, count);
}

Quat about(const Vec3d& axis, double angle) { return from_rotation_vector(angle * axis.normalized()); }

Mesh bumpy_ground(uint32_t n) {
    return make_ground(n, 0.05, [](const Vec3d& p) {
        return Vec3d(p.x(), p.y(), 2e-3 * std::sin(180 * p.x()) * std::cos(140 * p.y()) - 6e-3 * p.x() / 0.05);
    });
}
// closed, for the sign of brute force
Mesh bumpy_ball() {
    Mesh mesh = make_sphere(Vec3d::Zero(), 0.03, 4);
    for (Vec3d& p : mesh.position) p *= 1 + 0.04 * std::sin(200 * p.x()) * std::cos(170 * p.y() + 90 * p.z());
    return mesh;
}

// ---- the shell ----

// Breaks when points crowd or leave holes, when normals point outwards, when edges or corners are left out.
TEST(PointShell, CoversABoxEvenlyWithItsEdges) {
    const Vec3d half(0.02, 0.01, 0.005);
    const std::vector<ShellPoint> point_shell = shell_of(make_box(-half, half), 1000);
    ASSERT_GT(point_shell.size(), 950u);
    ASSERT_LE(point_shell.size(), 1000u);
    const double area = 8 * (half.x() * half.y() + half.y() * half.z() + half.z() * half.x());
    const double even = std::sqrt(area / 1000);
    uint32_t corners = 0, on_edges = 0;
    for (size_t i = 0; i < point_shell.size(); ++i) {
        const Vec3d inside = point_shell[i].arm + 1e-4 * point_shell[i].inward;
        EXPECT_NEAR((point_shell[i].arm.cwiseAbs() - half).maxCoeff(), 0, 1e-12);
        EXPECT_LT((inside.cwiseAbs() - half).maxCoeff(), 0);
        EXPECT_NEAR(point_shell[i].inward.norm(), 1, 1e-12);
        const long sides = ((point_shell[i].arm.cwiseAbs() - half).array().abs() < 1e-12).count();
        corners += sides == 3;
        on_edges += sides == 2;
        for (size_t j = 0; j < i; ++j) EXPECT_GT((point_shell[i].arm - point_shell[j].arm).norm(), 0.5 * even);
    }
    EXPECT_EQ(corners, 8u);
    EXPECT_GT(on_edges * even, 0.7 * 8 * half.sum());
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(-1, 1);
    for (int k = 0; k < 2000; ++k) {
        Vec3d p(half.x() * any(random), half.y() * any(random), half.z() * any(random));
        const int axis = k % 3;
        p[axis] = std::copysign(half[axis], p[axis]);
        double nearest = 1;
        for (const ShellPoint& s : point_shell) nearest = std::min(nearest, (s.arm - p).norm());
        EXPECT_LT(nearest, 1.6 * even);
    }
}

TEST(PointShell, OfABallIsEvenAndHasNoEdges) {
    const std::vector<ShellPoint> point_shell = shell_of(make_sphere(Vec3d(0.1, 0, 0), 0.01, 4), 1000, Vec3d(0.1, 0, 0));
    ASSERT_GT(point_shell.size(), 950u);
    Vec3d centre = Vec3d::Zero();
    for (const ShellPoint& p : point_shell) {
        centre += p.arm / static_cast<double>(point_shell.size());
        EXPECT_NEAR(p.arm.norm(), 0.01, 5e-5);
        EXPECT_LT(p.arm.normalized().dot(p.inward), -0.99);
    }
    EXPECT_LT(centre.norm(), 2e-4);
}

// ---- statics ----

// A rod with one shell point at the end of an arm, pressed on a plane at that end: closed form of coupling
// and contact. Breaks with any error in lever arm, sign, stiffness or rotation.
TEST(HapticShell, T18_RodPressedAtItsEndFeelsArmCrossForce) {
    const double length = 0.06, k = 500, turn_k = 1.5, k_s = 5e4;
    for (const double press : {1e-3, 4e-3, 9e-3}) {
        ShellRig rig(make_joined_patch(make_plane(10, 0.1)), {{Vec3d(length, 0, 0), Vec3d(0, 0, 1)}});
        rig.tool.turn_stiffness = turn_k;
        rig.at({0, 0, 5e-3});
        rig.go({0, 0, -press}, 300);
        rig.rest(300);
        // N lifts the tip by N / k and tilts the rod by phi, turn_k phi = N length cos(phi); the end: N / k_s
        double low = 0, high = k * press;
        for (int n = 0; n < 200; ++n) {
            const double force = 0.5 * (low + high);
            double phi = 0;
            for (int m = 0; m < 100; ++m) phi = force * length * std::cos(phi) / turn_k;
            (-press + force / k + length * std::sin(phi) < -force / k_s ? low : high) = force;
        }
        const double force = low;
        double phi = 0;
        for (int m = 0; m < 100; ++m) phi = force * length * std::cos(phi) / turn_k;
        const Vec3d arm(length * std::cos(phi), 0, length * std::sin(phi));
        ASSERT_EQ(rig.state.contact.size(), 1u);
        EXPECT_NEAR(rig.state.command.force.z(), force, 1e-7 * force);
        EXPECT_LT(rig.state.command.force.head<2>().norm(), 1e-7 * force);
        const Vec3d torque = arm.cross(Vec3d(0, 0, force));
        EXPECT_LT((rig.state.command.torque - torque).norm(), 1e-7 * torque.norm()) << press;
        EXPECT_LT((rig.state.contact[0].arm - arm).norm(), 1e-9);
        EXPECT_LT((torque - turn_k * rotation_vector(rig.state.device.orientation, rig.state.proxy_turn)).norm(), 1e-6 * torque.norm());
    }
}

// Force and torque of a whole instrument on a bumpy surface, recomputed from the shell and the pose alone.
TEST(HapticShell, T18_TorqueIsTheSumOfArmsCrossForces) {
    ShellRig rig(make_joined_patch(bumpy_ground(40)), shell_of(make_box({-0.02, -0.008, 0}, {0.03, 0.008, 0.01}), 1000));
    rig.tool.friction = 0.3;
    rig.tool.surface_stiffness = 3e3;
    rig.at({0, 0, 0.012}, about({1, 2, 0}, 0.1));
    rig.go({0.004, 0.003, -3e-3}, about({1, -1, 0.5}, 0.2), 200);
    uint32_t judged = 0;
    for (int k = 0; k < 200; ++k) {
        rig.at({0.004 + 1e-5 * k, 0.003, -3e-3}, about({1, -1, 0.5}, 0.2 + 1e-4 * k));
        Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();
        for (const ShellContact& c : rig.state.contact) {
            const Vec3d arm = rotate(rig.state.proxy_turn, rig.tool.point_shell[c.point].arm);
            EXPECT_LT((arm - c.arm).norm(), 1e-14);
            force += c.force;
            torque += arm.cross(c.force);
        }
        EXPECT_LT((rig.state.command.force - force).norm(), 1e-12 * force.norm());
        EXPECT_LT((rig.state.command.torque - torque).norm(), 1e-12 * (torque.norm() + 0.03 * force.norm()));
        judged += rig.state.contact.size() > 1;
    }
    EXPECT_GT(judged, 150u);
}

// A plate flat on a plane: no torque; the coupling in series with all its points.
TEST(HapticShell, PlateFlatOnAPlaneFeelsNoTorqueAndTheSeriesStiffness) {
    const std::vector<ShellPoint> point_shell = shell_of(make_box({-0.02, -0.015, 0}, {0.02, 0.015, 0.004}), 1000);
    Vec3d middle = Vec3d::Zero();
    double below = 0;
    for (const ShellPoint& p : point_shell)
        if (p.arm.z() < 1e-9) middle += p.arm, ++below;
    middle /= below;
    // held where its lower points are balanced
    std::vector<ShellPoint> held = point_shell;
    for (ShellPoint& p : held) p.arm -= Vec3d(middle.x(), middle.y(), 0);
    ShellRig rig(make_joined_patch(make_plane(10, 0.1)), held);
    rig.tool.surface_stiffness = 300;
    rig.at({0, 0, 1e-3});
    rig.go({0, 0, -2e-3}, 100);
    rig.rest(200);
    const double in_series = 1 / (1 / rig.tool.coupling_stiffness + 1 / (below * rig.tool.surface_stiffness));
    EXPECT_EQ(rig.state.contact.size(), static_cast<size_t>(below));
    EXPECT_NEAR(rig.state.command.force.z(), in_series * 2e-3, 1e-9);
    EXPECT_LT(rig.state.command.force.head<2>().norm(), 1e-12);
    EXPECT_LT(rig.state.command.torque.norm(), 1e-12);
}

// A peg slightly wider than its square hole: contacts from four sides balance without a residual.
TEST(HapticShell, PegInAHoleIsPressedFromAllSidesInBalance) {
    Mesh hole;  // four walls that face the centre
    const double a = 0.01, depth = 0.04;
    const Vec3d wall[4][4] = {{{a, -a, 0}, {a, -a, depth}, {a, a, depth}, {a, a, 0}},
                              {{-a, a, 0}, {-a, a, depth}, {-a, -a, depth}, {-a, -a, 0}},
                              {{a, a, 0}, {a, a, depth}, {-a, a, depth}, {-a, a, 0}},
                              {{-a, -a, 0}, {-a, -a, depth}, {a, -a, depth}, {a, -a, 0}}};
    for (const auto& w : wall) {
        const uint32_t first = static_cast<uint32_t>(hole.position.size());
        for (const Vec3d& p : w) hole.position.push_back(p);
        hole.triangle.push_back({first, first + 1, first + 2});
        hole.triangle.push_back({first, first + 2, first + 3});
    }
    const double wide = a + 5e-5;
    ShellRig rig(make_joined_patch(hole), shell_of(make_box({-wide, -wide, 0.01}, {wide, wide, 0.03}), 400, {0, 0, 0.02}));
    rig.state.proxy_valid = true;  // placed inside, not moved in from outside
    rig.state.proxy = {0, 0, 0.02};
    rig.state.gain = 1;
    rig.at({0, 0, 0.02});
    rig.rest(60);
    double pressed = 0;
    for (const ShellContact& c : rig.state.contact) pressed += c.force.norm();
    EXPECT_GT(rig.state.contact.size(), 150u);
    EXPECT_GT(pressed, 150 * 0.5 * rig.tool.surface_stiffness * 5e-5);
    // the coupling takes the imbalance of unevenly spread points on opposite walls; the balance itself is
    // exact to rounding
    const Vec3d coupling = rig.tool.coupling_stiffness * (rig.state.device.position - rig.state.proxy);
    EXPECT_LT((rig.state.command.force + coupling).norm(), 1e-6 * pressed);
    EXPECT_LT(rig.state.command.force.norm(), 1e-4 * pressed);
    EXPECT_LT(rig.state.command.force.z(), 1e-12 * pressed);
    // against one wall: the device pulls it aside by 2 mm, and only the coupling force remains
    rig.go({2e-3, 0, 0.02}, 100);
    rig.rest(60);
    EXPECT_NEAR(rig.state.command.force.x(), -rig.tool.coupling_stiffness * 2e-3, 0.01 * rig.tool.coupling_stiffness * 2e-3);
}

// The rest position of a shell on a bumpy solid is the minimum of the energy measured by brute force: no
// small motion lowers it.
TEST(HapticShell, RestsAtTheBottomOfTheTrueEnergy) {
    const Mesh ball = bumpy_ball();
    ShellRig rig(make_joined_patch(ball), shell_of(make_box({-0.015, -0.004, 0}, {0.015, 0.004, 0.006}), 300));
    rig.tool.surface_stiffness = 2e3;
    rig.at({0, 0, 0.04}, about({1, 0, 0}, 0.05));
    rig.go({0.002, -0.001, 0.026}, about({0.3, 1, 0.2}, 0.12), 300);
    rig.rest(500);
    ASSERT_GT(rig.state.contact.size(), 1u);
    const double peak = rig.state.command.force.norm();
    for (int axis = 0; axis < 6; ++axis) {
        const double h = axis < 3 ? 1e-7 : 1e-6;
        const Vec3d displacement = h * Vec3d::Unit(axis % 3);
        const auto energy = [&](double sign) {
            return axis < 3 ? shell_energy(rig, rig.state.proxy + sign * displacement, rig.state.proxy_turn)
                            : shell_energy(rig, rig.state.proxy, multiply(from_rotation_vector(sign * displacement), rig.state.proxy_turn));
        };
        const double slope = (energy(1) - energy(-1)) / (2 * h);
        EXPECT_LT(std::abs(slope), (axis < 3 ? 1e-5 : 3e-7) * peak) << "axis " << axis;
    }
}

// Tissue with the roughness of its mesh, displaced slightly by every pass, under a bar that is pressed and
// dragged: after a tick the contact forces balance the coupling force. Breaks when a tick is cut where its
// first planes end, far from their solution, and reports the spring forces there.
TEST(HapticShell, TicksOnRoughTissueEndInBalance) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> height(-1, 1);
    const Mesh flat = make_plane(40);
    ShellRig rig(make_joined_patch(flat), shell_of(make_box({-0.03, -0.003, 0}, {0.03, 0.003, 0.006}), 200));
    rig.tool.coupling_stiffness = 600, rig.tool.turn_stiffness = 0.5, rig.tool.surface_stiffness = 6e4;
    std::vector<double> rough(flat.position.size());
    for (double& h : rough) h = 3e-4 * height(random);
    rig.at({0, 0, 3e-3});
    double loose2 = 0, peak = 0;
    uint32_t judged = 0;
    for (uint32_t k = 0; k < 640; ++k) {
        if (rig.tick % 16 == 0)
            for (size_t v = 0; v < rough.size(); ++v) rig.model.position[v].z() = rough[v] + 5e-5 * height(random);
        rig.at({2e-5 * k, 1e-5 * k, std::max(-1.5e-3, 3e-3 - 3e-5 * k)}, about({0.2, 1, 0.1}, 1e-4 * k));
        if (k < 200) continue;
        Vec3d felt = Vec3d::Zero();
        for (const ShellContact& c : rig.state.contact) felt += c.force;
        const Vec3d pull = rig.tool.coupling_stiffness * (rig.state.proxy - rig.state.device.position);
        loose2 += (felt - pull).squaredNorm();
        peak = std::max(peak, pull.norm());
        ++judged;
    }
    EXPECT_GT(peak, 0.8);
    EXPECT_LT(std::sqrt(loose2 / judged), 0.01 * peak);
}

// A new model has the surface 1.5 mm farther away than the last tick assumed: the tool follows in that same
// tick, and the force is that of the closed form. Breaks when steps are cut and contacts bear
// nothing there.
TEST(HapticShell, SurfaceFoundFartherAwayIsFollowedInTheSameTick) {
    ShellRig rig(make_joined_patch(make_plane(40, 0.1)), shell_of(make_box({-0.06, -0.005, 0}, {0.06, 0.005, 0.005}), 400));
    rig.at({0, 0, 1e-3});
    rig.go({0, 0, -3e-3}, 100);
    rig.rest(60);
    const double before = rig.state.pull.z();
    EXPECT_NEAR(before, rig.tool.coupling_stiffness * 3e-3, 0.01 * before);
    for (Vec3d& p : rig.model.position) p.z() -= 1.5e-3;
    rig.publish();
    rig.rest(1);
    EXPECT_NEAR(rig.state.pull.z(), 0.5 * before, 1e-3 * before);
    EXPECT_NEAR(rig.state.proxy.z(), -1.5e-3, 1e-5);
}

// A jaw of one point, 30 mm from its pivot, which is 10 mm ahead of a tip that the hand does not rotate. At
// the position set by the grip it is pressed as geometry predicts, torque is arm x force, and friction holds
// a jaw that slides by closing like one that is dragged. Breaks when a jaw rotates in the wrong direction,
// about the tip, or by the whole grip.
TEST(HapticShell, JawsFeelWhereTheGripPutsThem) {
    ShellRig rig(make_joined_patch(make_plane(10, 0.1)), {{Vec3d(0.03, 0, 0), Vec3d(0, 0, 1), 0}});
    rig.tool.shell_jaw.push_back({1, Vec3d(0.01, 0, 0), {}, Vec3d(0, 1, 0), 0.5});
    rig.tool.shell_radius = 0.04;
    rig.tool.turn_stiffness = 1e9;
    rig.tool.friction = 0.3;
    const auto press = [&](double height, double grip) {
        DeviceState hand;
        hand.time = rig.time();
        hand.position = {0, 0, height};
        hand.grip = grip;
        return rig.with(hand);
    };
    for (int k = 0; k < 100; ++k) press(0.012, 0.2);
    EXPECT_EQ(rig.state.contacts, 0u);
    const double series = 1 / (1 / rig.tool.coupling_stiffness + 1 / rig.tool.surface_stiffness);
    double dragged = 0;
    for (int k = 1; k <= 400; ++k) {
        const double grip = 0.2 + 2e-3 * k, down = 0.03 * std::sin(0.5 * grip), along = 0.01 + 0.03 * std::cos(0.5 * grip);
        const Vec3d force = press(0.012, grip);
        if (down < 0.0121) continue;
        ASSERT_EQ(rig.state.contacts, 1u) << k;
        EXPECT_NEAR(force.z(), series * (down - 0.012), 1e-6) << k;
        const ShellContact& c = rig.state.contact[0];
        EXPECT_NEAR((c.arm - Vec3d(along, 0, -down)).norm(), 0, 1e-9) << k;
        EXPECT_NEAR((rig.state.command.torque - c.arm.cross(force)).norm(), 0, 1e-9) << k;
        // closing, the point moves back towards the tip: friction opposes it, within its cone
        EXPECT_GE(force.x(), -1e-9) << k;
        EXPECT_LE(force.x(), 0.3 * force.z() * (1 + 1e-9)) << k;
        dragged = std::max(dragged, force.x() / force.z());
    }
    EXPECT_GT(dragged, 0.25);
}

// ---- skipped points ----

// A press, a drag and a tumble on a moving surface, published anew every 16 ms, also with jaws opening and
// closing: skipping points changes no bit.
TEST(HapticShell, PassingOverPointsChangesNoBit) {
    for (const bool jaws : {false, true}) {
        const std::vector<ShellPoint> point_shell = shell_of(make_box({-0.03, -0.004, 0}, {0.03, 0.004, 0.008}), 500);
        ShellRig quick(make_joined_patch(bumpy_ground(40)), point_shell);
        quick.tool.friction = 0.2;
        quick.params.greatest_age = 0.02;
        if (jaws) {
            quick.tool.shell_jaw.push_back({1, Vec3d(0, 0, 0.002), about({1, 0, 0}, 0.1), Vec3d(0, 1, 0), -0.5});
            for (ShellPoint& p : quick.tool.point_shell)
                if (p.arm.x() > 0.005) p.jaw = 0;
            quick.tool.shell_radius += 0.002;
        }
        ShellRig slow = quick;
        slow.scratch.all_points = true;
        uint64_t touched = 0, torqued = 0, looked_at = 0, searched = 0;
        for (int k = 0; k < 400; ++k) {
            const double t = 1e-3 * k;
            const uint64_t looked_before = quick.scratch.looked_at, searched_before = quick.scratch.searched;
            if (k % 16 == 0) {
                for (ShellRig* rig : {&quick, &slow}) {
                    for (size_t v = 0; v < rig->model.position.size(); ++v) {
                        Vec3d& p = rig->model.position[v];
                        const double phase = 60 * p.x() + 9 * t;
                        p.z() += 2e-4 * std::sin(phase);
                        rig->model.velocity[v] = Vec3d(0.01, 0, 0.03 * std::cos(phase));
                    }
                    rig->publish(true);
                }
            }
            DeviceState hand;
            hand.time = t;
            hand.position = Vec3d(0.01 * std::sin(3 * t), 0.008 * std::sin(5 * t), 4e-3 + 9e-3 * std::cos(11 * t));
            hand.grip = 0.3 + 0.3 * std::sin(13 * t);
            hand.orientation = multiply(about({1, 0.3, 0}, 0.25 * std::sin(7 * t)), about({0, 0, 1}, 0.4 * t));
            for (ShellRig* rig : {&quick, &slow}) {
                point_shell_tick(rig->params, rig->model, t, rig->tool, hand, rig->scratch, rig->state);
            }
            ASSERT_EQ(quick.state.command.force, slow.state.command.force) << k;
            ASSERT_EQ(quick.state.command.torque, slow.state.command.torque) << k;
            ASSERT_EQ(quick.state.proxy, slow.state.proxy) << k;
            ASSERT_EQ(quick.state.contact.size(), slow.state.contact.size()) << k;
            if (quick.state.contacts > 0)
                looked_at += quick.scratch.looked_at - looked_before, searched += quick.scratch.searched - searched_before;
            touched += quick.state.contacts > 0;
            torqued += quick.state.command.torque.norm() > 1e-4;
        }
        EXPECT_GT(touched, 100u);
        EXPECT_GT(torqued, 100u);
        EXPECT_LT(2 * quick.scratch.looked_at, slow.scratch.looked_at);
        EXPECT_LT(3 * searched, looked_at);
    }
}

// One distant vertex as fast as tissue may be: the speed bounds around a point hold for every triangle at
// every age, depend on its own region only, and points that the fast vertex cannot reach are not evaluated
// for it. No bit changes.
TEST(HapticShell, SpeedsAreOfTheRegionOfAPoint) {
    const std::vector<ShellPoint> point_shell = shell_of(make_box({-0.01, -0.004, 0}, {0.01, 0.004, 0.008}), 300);
    ShellRig quick(make_joined_patch(bumpy_ground(60)), point_shell);
    quick.params.greatest_age = 0.034;
    LocalContactModel& model = quick.model;
    const auto corner = [](const Vec3d& a, const Vec3d& b) { return a.x() + a.y() < b.x() + b.y(); };
    const auto fast = static_cast<size_t>(std::max_element(model.position.begin(), model.position.end(), corner) - model.position.begin());
    for (size_t v = 0; v < model.position.size(); ++v) {
        const Vec3d& p = model.position[v];
        model.velocity[v] = 0.01 * Vec3d(0, std::sin(100 * p.x()), std::cos(120 * p.y()));
    }
    model.velocity[fast] = Vec3d(-0.5, -0.5, 0.4);
    // in the path of the fast vertex
    quick.state.device.position = Vec3d(0.028, 0.028, 2e-3);
    quick.publish();
    const PointShellCache& point_shell_cache = model.point_shell;
    const double fastest = model.velocity[fast].norm();
    EXPECT_EQ(point_shell_cache.ahead, quick.params.greatest_age);
    ASSERT_EQ(point_shell_cache.speed.size(), point_shell.size());
    ASSERT_EQ(point_shell_cache.position.size(), point_shell.size());
    std::mt19937 random(8);
    std::uniform_real_distribution<double> any(-1, 1);
    uint32_t calm = 0, excluded = 0;
    const auto judge = [&](const Vec3d& position, double speed) {
        calm += speed < 0.1 * fastest;
        for (const Triangle& t : model.triangle) {
            const double own = std::max({model.velocity[t[0]].norm(), model.velocity[t[1]].norm(), model.velocity[t[2]].norm()});
            if (own <= speed) continue;
            ++excluded;
            for (int k = -8; k <= 8; ++k) {
                const double age = point_shell_cache.ahead * k / 8;
                std::array<Vec3d, 3> c;
                for (size_t i = 0; i < 3; ++i) c[i] = model.position[t[i]] + age * model.velocity[t[i]];
                ASSERT_GT(closest_point_on_triangle(position, c[0], c[1], c[2]).squared_distance,
                          point_shell_cache.around * point_shell_cache.around)
                    << age;
            }
        }
    };
    for (size_t k = 0; k < point_shell.size(); ++k) judge(point_shell_cache.position[k], point_shell_cache.speed[k]);
    for (int k = 0; k < 400; ++k) {
        const Vec3d jitter(any(random), any(random), any(random));
        const Vec3d along = model.position[fast] + 1.2 * point_shell_cache.ahead * any(random) * model.velocity[fast];
        const Vec3d position = k % 2 == 0 ? Vec3d(along + 6e-3 * jitter) : Vec3d(jitter.cwiseProduct(Vec3d(0.05, 0.05, 0.01)));
        judge(position, fastest_around(model, point_shell_cache.tree[0], position, point_shell_cache.around, point_shell_cache.ahead));
    }
    EXPECT_GT(calm, 100u);
    EXPECT_GT(excluded, 1000u);

    model.velocity[fast].z() = 0.1;  // below the shell: a surface that passes through itself has no inside
    ShellRig slow = quick;
    slow.scratch.all_points = true;
    uint64_t touched = 0;
    for (int k = 0; k < 300; ++k) {
        DeviceState hand;
        hand.time = 1e-3 * k;
        hand.position = Vec3d(0.028 - 1.5e-4 * k, 0.028 - 1e-4 * k, -3e-3 + 8e-3 * std::cos(0.03 * k));
        for (ShellRig* rig : {&quick, &slow}) {
            rig->tick = static_cast<uint64_t>(k);
            if (k % 34 == 0) rig->publish(true);
            point_shell_tick(rig->params, rig->model, hand.time, rig->tool, hand, rig->scratch, rig->state);
        }
        ASSERT_EQ(quick.state.command.force, slow.state.command.force) << k;
        ASSERT_EQ(quick.state.command.torque, slow.state.command.torque) << k;
        touched += quick.state.contacts > 0;
    }
    EXPECT_GT(touched, 50u);
    EXPECT_LT(4 * quick.scratch.looked_at, slow.scratch.looked_at);
}

// A tool moves to and fro between a surface at rest and one that slides away under it, several millimetres
// per model, so that the remembered triangles become outdated. Evaluating every point anew changes no bit.
TEST(HapticShell, PointsThatCrossToAFastSurfaceAreAskedAnew) {
    ShellRig quick(make_joined_patch(bumpy_ground(60)), shell_of(make_box({-0.01, -0.004, 0}, {0.01, 0.004, 0.008}), 300));
    quick.params.greatest_age = 0.034;
    const LocalContactModel rest = quick.model;
    ShellRig slow = quick;
    slow.scratch.all_points = true;
    uint64_t touched = 0;
    for (int k = 0; k < 500; ++k) {
        DeviceState hand;
        hand.time = 1e-3 * k;
        hand.position = Vec3d(-0.03 * std::cos(0.01 * k), 0, 1e-3 + 6e-3 * std::max(0.0, 1 - 0.02 * k));
        for (ShellRig* rig : {&quick, &slow}) {
            rig->tick = static_cast<uint64_t>(k);
            if (k % 34 == 0) {
                for (size_t v = 0; v < rest.position.size(); ++v)
                    rig->model.velocity[v] = 0.3 * std::clamp(0.5 + 100 * rest.position[v].x(), 0.0, 1.0) * Vec3d(0.2, 1, 0);
                rig->publish(true);
            }
            point_shell_tick(rig->params, rig->model, hand.time, rig->tool, hand, rig->scratch, rig->state);
        }
        ASSERT_EQ(quick.state.command.force, slow.state.command.force) << k;
        ASSERT_EQ(quick.state.command.torque, slow.state.command.torque) << k;
        touched += quick.state.contacts > 0;
    }
    EXPECT_GT(touched, 150u);
    EXPECT_LT(quick.scratch.searched, quick.scratch.looked_at);
}

// The step is at the minimum of the energy of coupling, planes and friction springs, including those on
// planes no longer in contact: the energy grows in every direction.
TEST(HapticShell, StepsEndAtTheBottomOfTheEnergy) {
    std::mt19937 random(11);
    std::uniform_real_distribution<double> any(-1, 1);
    const auto vector = [&] { return Vec3d(any(random), any(random), any(random)); };
    uint32_t pressing = 0, gripping = 0, left = 0;
    for (const size_t count : {3u, 4u, 9u, 30u, 270u}) {
        for (int round = 0; round < 20; ++round) {
            ShellSprings springs{500, 1.5, 5e3, {1e-3 * vector(), 0.02 * vector()}};
            std::vector<ShellPlane> planes(count);
            for (ShellPlane& plane : planes) {
                plane.normal = vector().normalized();
                plane.arm = 0.03 * vector();
                plane.distance = 6e-4 * any(random);
                plane.slip = 1e-4 * vector();
                plane.slip -= plane.normal.dot(plane.slip) * plane.normal;
                plane.carried = 1e-4 * vector();
                if (any(random) > 0) plane.friction = 0.3, plane.held = std::max(0.0, any(random));
            }
            const auto energy = [&](const ShellStep& step) {
                double sum = 0.5 * springs.stiffness * (step.shift - springs.to_device.shift).squaredNorm() +
                             0.5 * springs.turn_stiffness * (step.turn - springs.to_device.turn).squaredNorm();
                for (const ShellPlane& plane : planes) {
                    const Vec3d displacement = step.shift + step.turn.cross(plane.arm);
                    const double gap = std::min(0.0, plane.distance + plane.normal.dot(displacement)), k = springs.surface_stiffness;
                    sum += 0.5 * k * gap * gap;
                    Vec3d slid = plane.slip + displacement - plane.carried;
                    slid -= plane.normal.dot(slid) * plane.normal;
                    const double most = plane.friction * plane.held, length = slid.norm();
                    sum += k * length > most ? most * (length - 0.5 * most / k) : 0.5 * k * length * length;
                }
                return sum;
            };
            const ShellStep step = solve_shell(springs, planes);
            const double least = energy(step);
            for (int trial = 0; trial < 40; ++trial) {
                const Vec3d shift = 1e-7 * vector(), turn = 3e-6 * vector();
                ASSERT_GE(energy({step.shift + shift, step.turn + turn}), least * (1 - 1e-12)) << count;
            }
            for (const ShellPlane& plane : planes) {
                const bool in = separation_after(plane, step)<0, grips = plane.held> 0 && plane.friction > 0;
                pressing += in, gripping += grips, left += grips && !in;
            }
        }
    }
    EXPECT_GT(pressing, 100u);
    EXPECT_GT(gripping, 100u);
    EXPECT_GT(left, 30u);
}

// ---- invariants for any motion of the hand ----

TEST(HapticShell, FreeMotionIsWithoutForceOrTorque) {
    ShellRig rig(make_joined_patch(make_plane()), shell_of(make_box({-0.02, -0.004, 0}, {0.02, 0.004, 0.006}), 400));
    rig.at({0, 0, 0.01});
    for (int k = 0; k < 300; ++k) {
        rig.at({5e-5 * k, 0, 0.006}, about({0, 0, 1}, 0.005 * k));
        ASSERT_EQ(rig.state.command.force.norm(), 0);
        ASSERT_EQ(rig.state.command.torque.norm(), 0);
    }
    EXPECT_LT((rig.state.proxy - rig.state.device.position).norm(), 1e-15);
    EXPECT_LT(rotation_vector(rig.state.proxy_turn, rig.state.device.orientation).norm(), 1e-12);
}

// Wall of 1 mm, the hand 20 mm beyond: the instrument stays on its side, and force and torque are the
// coupling's.
TEST(HapticShell, T07_ThinWallKeepsTheInstrumentOnItsSide) {
    ShellRig rig(make_joined_patch(make_box({-0.05, -0.05, -1e-3}, {0.05, 0.05, 0})),
                 shell_of(make_box({-0.01, -0.004, 0}, {0.01, 0.004, 0.02}), 600));
    rig.at({0, 0, 2e-3});
    rig.go({0, 0, -0.02}, 80);  // 0.28 m/s
    for (int k = 0; k < 300; ++k) {
        rig.at({1e-5 * k, 0, -0.02});
        EXPECT_GT(rig.state.proxy.z(), -1e-3);
    }
    EXPECT_NEAR(rig.state.command.force.z(), rig.tool.coupling_stiffness * 0.02, 0.01 * rig.tool.coupling_stiffness * 0.02);
    rig.go({3e-3, 0, 5e-3}, 100);
    EXPECT_EQ(rig.state.command.force.norm(), 0);
}

// Found beyond the middle of a thin wall, the instrument is not pulled through: no force at all.
TEST(HapticShell, T07_FarSideOfAThinWallDoesNotPull) {
    ShellRig rig(make_joined_patch(make_box({-0.05, -0.05, -1e-3}, {0.05, 0.05, 0})),
                 shell_of(make_box({-0.01, -0.004, 0}, {0.01, 0.004, 0.02}), 600));
    rig.state.proxy_valid = true;
    rig.state.gain = 1;
    rig.state.proxy = {0, 0, -8e-4};
    for (int k = 0; k < 20; ++k) EXPECT_GE(rig.at({0, 0, -8e-4}).z(), 0);
}

// An open sheet of 1 mm stops an instrument on the side from which it came, for both sides.
TEST(HapticShell, T07_SheetStopsTheInstrumentOnTheSideItIsOn) {
    for (const double side : {1.0, -1.0}) {
        ShellRig rig(make_joined_patch(make_plane(10, 0.1), 5e-4), shell_of(make_box({-0.01, -0.01, -0.005}, {0.01, 0.01, 0.005}), 600));
        rig.at({0, 0, side * 0.012});
        rig.go({0, 0, -side * 4e-3}, 100);
        rig.rest(100);
        EXPECT_NEAR(rig.state.command.force.z(), side * rig.tool.coupling_stiffness * (9.5e-3), 0.01 * rig.tool.coupling_stiffness * 9.5e-3)
            << side;
        EXPECT_NEAR(rig.state.proxy.z(), side * 5.5e-3, 1e-4);
    }
}

// Friction of one point on a plane, dragged aside: Coulomb's bound at every tick and the closed form while it
// slides.
TEST(HapticShell, T11_FrictionStaysInItsCone) {
    for (const double mu : {0.0, 0.3, 1.0, 1e6}) {
        ShellRig rig(make_joined_patch(make_plane(10, 0.1)), {{Vec3d::Zero(), Vec3d(0, 0, 1)}});
        rig.tool.friction = mu;
        rig.at({0, 0, 2e-3});
        rig.go({0, 0, -4e-3}, 100);
        rig.rest(60);
        const double normal = rig.tool.coupling_stiffness * 4e-3 / (1 + rig.tool.coupling_stiffness / rig.tool.surface_stiffness);
        for (int k = 1; k <= 200; ++k) {
            rig.at({5e-5 * k, 0, -4e-3});
            for (const ShellContact& c : rig.state.contact) ASSERT_LE(c.force.head<2>().norm(), mu * c.force.z() * (1 + 1e-12) + 1e-12);
        }
        const Vec3d force = rig.rest(20);
        EXPECT_NEAR(force.z(), normal, 1e-6 * normal);
        // 10 mm aside: while it sticks, the springs in series pull back; else the force is on the cone
        const double held = rig.tool.coupling_stiffness * 0.01 / (1 + rig.tool.coupling_stiffness / rig.tool.surface_stiffness);
        EXPECT_NEAR(-force.x(), std::min(mu * normal, held), 1e-5 * held) << mu;
    }
}

// A plane that rises at 0.1 m/s under a resting hand: the instrument is carried, nothing passes through, and
// the force is that of the lifted coupling. With friction a plane that moves sideways carries it until the
// cone is reached.
TEST(HapticShell, T12_MovingSurfaceCarriesTheInstrument) {
    ShellRig rig(make_joined_patch(make_plane(10, 0.1)), shell_of(make_box({-0.01, -0.01, 0}, {0.01, 0.01, 0.005}), 400));
    rig.at({0, 0, 1e-3});
    rig.rest(60);
    double height = 0;
    for (int k = 0; k < 60; ++k) {
        if (k % 15 == 0) {
            for (size_t v = 0; v < rig.model.position.size(); ++v) rig.model.position[v].z() = height, rig.model.velocity[v] = {0, 0, 0.1};
            rig.publish(true);
        }
        rig.model.time = 1e-3 * static_cast<double>(rig.tick - static_cast<uint64_t>(k % 15));
        DeviceState still = rig.state.device;
        still.time = rig.time();
        point_shell_tick(rig.params, rig.model, rig.time(), rig.tool, still, rig.scratch, rig.state);
        ++rig.tick;
        const double now = height + 0.1e-3 * (k % 15);
        if (now > 1.001e-3) {
            EXPECT_NEAR(rig.state.command.force.z(), rig.tool.coupling_stiffness * (now - 1e-3), 2e-3) << k;
            EXPECT_GT(rig.state.proxy.z(), now - 1e-5);
        }
        if (k % 15 == 14) height += 1.5e-3;
    }
    EXPECT_GT(rig.state.command.force.z(), 2);
}

// A shell that starts with a corner inside gets no force until all of it has been outside.
TEST(HapticShell, T13_StartInsideTissueIsWithoutForceUntilOutside) {
    ShellRig rig(make_joined_patch(make_box({-0.05, -0.05, -0.03}, {0.05, 0.05, 0})),
                 shell_of(make_box({-0.01, -0.01, 0}, {0.01, 0.01, 0.01}), 400));
    rig.at({0, 0, -5e-3});
    rig.rest(100);
    EXPECT_EQ(rig.state.command.force.norm(), 0);
    rig.go({0, 0, -1e-3}, 50);
    EXPECT_EQ(rig.state.command.force.norm(), 0);
    rig.go({0, 0, 1e-3}, 50);
    rig.go({0, 0, -1e-3}, 50);
    rig.rest(50);
    EXPECT_NEAR(rig.state.command.force.z(), rig.tool.coupling_stiffness * 1e-3, 1e-3);
}

// The surface jumps by 4 mm from one model to the next: no tick changes force or torque by more than ramp and
// motions allow.
TEST(HapticShell, T06_JumpOfTheContactSetRampsForceAndTorque) {
    ShellRig rig(make_joined_patch(make_plane(10, 0.1)), shell_of(make_box({0, -0.01, 0}, {0.04, 0.01, 0.005}), 400));
    rig.at({0, 0, 1e-3});
    rig.go({0, 0, -1e-3}, 100);
    rig.rest(60);
    Vec3d force = rig.state.command.force, torque = rig.state.command.torque;
    for (Vec3d& p : rig.model.position) p.z() += 4e-3;
    rig.publish();
    const double ramp = rig.params.force_slew * 1e-3, lever = rig.tool.shell_radius + 1e-3;
    for (int k = 0; k < 100; ++k) {
        rig.rest(1);
        ASSERT_LE((rig.state.command.force - force).norm(), ramp * (1 + 1e-9));
        ASSERT_LE((rig.state.command.torque - torque).norm(), ramp * lever);
        force = rig.state.command.force, torque = rig.state.command.torque;
    }
    EXPECT_GT(force.z(), 1.5);
}

// ---- closed loop ----

// A device with mass and inertia, restrained only by its damping, against the coupling through a plate that a
// box holds from all sides; measures what remains of a disturbance after three seconds.
struct SixDevice {
    double mass = 0.1, damping = 0.5;            // kg, N s/m
    double inertia = 1e-4, turn_damping = 5e-4;  // kg m^2, N m s/rad
    Vec3d position = Vec3d::Zero(), velocity = Vec3d::Zero(), spin = Vec3d::Zero();
    Quat turn;
    // exact flow of a tick under constant force and torque
    void step(const Vec3d& force, const Vec3d& torque) {
        const auto flow = [](double m, double b, const Vec3d& f, Vec3d& v) {
            const double keep = std::exp(-b / m * 1e-3);
            const Vec3d end = f / b, displacement = 1e-3 * end + (m / b) * (1 - keep) * (v - end);
            v = end + keep * (v - end);
            return displacement;
        };
        position += flow(mass, damping, force, velocity);
        turn = normalized(multiply(from_rotation_vector(flow(inertia, turn_damping, torque, spin)), turn));
    }
};

// The stiffest coupling (N/m or N m/rad) that is passive for a device of damping `damping` (N s/m or N m
// s/rad) in ticks of `dt` s: b / (dt / 2) (Colgate & Schenkel 1997; Gil et al. 2009, with no delay).
double stiffest_coupling(double damping, double dt) { return damping / (0.5 * dt); }

// Speed (m/s or rad/s) three seconds after a disturbance relative to the initial one, with `share` of the
// stiffest coupling that theory allows.
double left_of_a_knock(double share, bool turning) {
    SixDevice device;
    ShellRig rig(make_joined_patch(make_plane(2, 0.1)), shell_of(make_box({-0.01, -0.01, 0}, {0.01, 0.01, 0.004}), 100));
    const double stiffest = stiffest_coupling(device.damping, 1e-3), stiffest_turn = stiffest_coupling(device.turn_damping, 1e-3);
    EXPECT_DOUBLE_EQ(stiffest, 1000);
    rig.tool.coupling_stiffness = turning ? 100 : share * stiffest;
    rig.tool.turn_stiffness = turning ? share * stiffest_turn : 0.05;
    rig.tool.surface_stiffness = 1e6;
    rig.params.force_slew = 1e9;
    // pressed into the plane by a constant 1 N
    const Vec3d weight(0, 0, -1);
    rig.at({0, 0, 1e-3});
    device.position = {0, 0, -1 / rig.tool.coupling_stiffness};
    rig.go(device.position, 200);
    const double knock = turning ? 0.05 : 2e-3;
    double fastest = 0;  // in the last half second
    for (int k = 0; k < 3200; ++k) {
        if (k == 200) turning ? device.spin.x() += knock : device.velocity.z() -= knock;
        DeviceState sample;
        sample.time = rig.time();
        sample.position = device.position;
        sample.velocity = device.velocity;
        sample.orientation = device.turn;
        rig.with(sample);
        device.step(rig.state.command.force + weight, rig.state.command.torque);
        if (k >= 2700) fastest = std::max(fastest, turning ? std::abs(device.spin.x()) : std::abs(device.velocity.z()));
    }
    return fastest / knock;
}

// Case T01 for an instrument: a disturbance decays below the computed limit b / (T / 2) and grows above it;
// translation and rotation. The remaining damping, b - K T / 2, slows a mass m at the rate exp(-t (b - K T /
// 2) / 2 m).
TEST(HapticShell, T01_QuietBelowTheComputedCouplingAndRestlessAboveIt) {
    for (const bool turning : {false, true}) {
        EXPECT_LT(left_of_a_knock(0.9, turning), 0.8) << turning;
        EXPECT_GT(left_of_a_knock(1.1, turning), 1.2) << turning;
    }
}

// Two seconds of poking, sliding and tilting: through both ports of the coupling no more energy comes out
// than went in, except for that generated by holding forces for a tick, bounded by stiffness * travel^2 / 2 per
// tick.
TEST(HapticShell, PokingTakesEnergyAndGivesNone) {
    ShellRig rig(make_joined_patch(bumpy_ground(30)), shell_of(make_box({-0.01, -0.005, 0}, {0.02, 0.005, 0.006}), 300));
    rig.tool.friction = 0.2;
    rig.at({0, 0, 0.015});
    rig.rest(60);
    double energy = 0, made = 0, most = 0;
    for (int k = 0; k < 2000; ++k) {
        const double t = 1e-3 * k;
        const DeviceState before = rig.state.device;
        const Vec3d force = rig.state.command.force, torque = rig.state.command.torque;
        const Vec3d position(5e-3 * std::sin(4 * t), 3e-3 * std::sin(7 * t), 5e-3 + 8e-3 * std::cos(13 * t));
        const Quat turn = about({1, 0.5, 0.2}, 0.15 * std::sin(9 * t));
        rig.at(position, turn);
        const Vec3d displacement = position - before.position, turned = rotation_vector(before.orientation, rig.state.device.orientation);
        // the hand's work is -F dx while the force of the last tick is held
        energy -= force.dot(displacement) + torque.dot(turned);
        made += 0.5 * rig.tool.coupling_stiffness * displacement.squaredNorm() + 0.5 * rig.tool.turn_stiffness * turned.squaredNorm();
        most = std::max(most, energy);
        ASSERT_GT(energy, -made - 1e-6) << k;
    }
    EXPECT_GT(most, 2e-3);
}

// With or without a hint, a tree gives the result of a loop over all triangles: on a surface that deforms,
// before and after its model's time, on one that yields, and for moving points. Breaks when a box does not
// contain its part at some age.
TEST(HapticShell, TreesGiveTheNearestTriangle) {
    ShellRig rig(make_joined_patch(make_sphere(Vec3d::Zero(), 0.03, 6)), {{{0, 0, 0}, {0, 0, 1}, kNone}});
    for (size_t v = 0; v < rig.model.position.size(); ++v) {
        const Vec3d& p = rig.model.position[v];
        rig.model.velocity[v] = 0.02 * Vec3d(std::sin(150 * p.y()), std::cos(130 * p.z()), std::sin(110 * p.x()));
    }
    rig.publish();
    std::mt19937 random(5);
    std::uniform_real_distribution<double> any(-1, 1);
    const auto vector = [&] { return Vec3d(any(random), any(random), any(random)); };
    const SurfaceTree& tree = rig.model.point_shell.tree[0];
    PlacedSurface hinted, fresh;
    std::array<Vec3d, 40> point;
    std::array<uint32_t, 40> hint;
    hint.fill(kNone);
    for (Vec3d& p : point) p = 0.03 * vector().normalized();
    for (uint32_t tick = 0; tick < 300; ++tick) {
        const SurfaceMoment moment{0.02 + 0.06 * any(random), tick % 3 == 0 ? 0u : kNone, 3e-4 * vector()};
        begin_moment(rig.model, moment, hinted);
        begin_moment(rig.model, moment, fresh);
        for (uint32_t k = 0; k < point.size(); ++k) {
            point[k] += 1e-3 * vector();
            point[k] *= std::clamp(point[k].norm(), 0.0295, 0.0305) / point[k].norm();
            const NearestTriangle found = find_nearest(rig.model, tree, point[k], hint[k], 0.01, hinted);
            const NearestTriangle wanted = find_nearest(rig.model, tree, point[k], kNone, 0.01, fresh);
            ASSERT_EQ(found.triangle, wanted.triangle) << tick << " " << k;
            ASSERT_EQ(found.at.squared_distance, wanted.at.squared_distance);
            hint[k] = found.triangle;
            if (k > 0 || tick % 10 > 0) continue;
            NearestTriangle best;
            best.at.squared_distance = 1e-4;
            for (uint32_t t = 0; t < rig.model.triangle.size(); ++t) {
                std::array<Vec3d, 3> c;
                for (size_t corner = 0; corner < 3; ++corner) {
                    const uint32_t v = rig.model.triangle[t][corner];
                    c[corner] = rig.model.position[v] + moment.age * rig.model.velocity[v];
                    if (moment.follower == 0) c[corner] += moment.follow;
                }
                const TrianglePoint at = closest_point_on_triangle(point[k], c[0], c[1], c[2]);
                if (at.squared_distance < best.at.squared_distance) best.triangle = t, best.at = at;
            }
            ASSERT_EQ(found.triangle, best.triangle);
            ASSERT_EQ(found.at.squared_distance, best.at.squared_distance);
        }
    }
}

// The triangles found around a point give the exact nearest one within their stated validity: points move on
// a surface that deforms, yields and returns; some are at its corners, where six triangles are equally near.
// Breaks when a displacement is omitted from the drift bound, when a triangle that was never evaluated may be
// nearer, or when ties are resolved differently.
TEST(HapticShell, TrianglesAroundAPointTellTheNearest) {
    ShellRig rig(make_joined_patch(make_sphere(Vec3d::Zero(), 0.03, 5)), {{{0, 0, 0}, {0, 0, 1}, kNone}});
    double fastest = 0;
    for (size_t v = 0; v < rig.model.position.size(); ++v) {
        const Vec3d& p = rig.model.position[v];
        rig.model.velocity[v] = 0.03 * Vec3d(std::sin(150 * p.y()), std::cos(130 * p.z()), std::sin(110 * p.x()));
        fastest = std::max(fastest, rig.model.velocity[v].norm());
    }
    rig.publish();
    std::mt19937 random(6);
    std::uniform_real_distribution<double> any(-1, 1);
    const auto vector = [&] { return Vec3d(any(random), any(random), any(random)); };
    const SurfaceTree& tree = rig.model.point_shell.tree[0];
    struct Asked {
        Vec3d point, at;
        SurfaceMoment moment;
        TrianglesAround found;
    };
    std::vector<Asked> asked(60);
    for (Asked& a : asked) a.point = 0.03 * vector().normalized();
    PlacedSurface placed;
    uint32_t told = 0, asks = 0, none = 0, judged = 0;
    for (uint32_t tick = 0; tick < 400; ++tick) {
        const double t = 1e-3 * tick;
        const SurfaceMoment moment{0.02 * std::sin(25 * t), 0, Vec3d(1e-3 * std::sin(20 * t), 0, 5e-4 * std::cos(31 * t))};
        begin_moment(rig.model, moment, placed);
        for (uint32_t k = 0; k < asked.size(); ++k) {
            Asked& a = asked[k];
            a.point += 5e-5 * vector();
            if (k < 20) a.point = rig.model.position[37 * k] + moment.age * rig.model.velocity[37 * k] + moment.follow;
            const double reach = (tick + k) % 5 == 0 ? 1e-4 : 3e-3;
            const NearestTriangle wanted = find_nearest(rig.model, tree, a.point, kNone, reach, placed);
            NearestTriangle nearest;
            const double gone =
                (a.point - a.at).norm() + fastest * std::abs(moment.age - a.moment.age) + (moment.follow - a.moment.follow).norm();
            const bool tells = nearest_of(rig.model, a.found, a.point, gone, 1, reach, placed, nearest);
            if (!tells) {
                const uint32_t hint = tick % 2 == 0 ? wanted.triangle : kNone;
                nearest = find_nearest_around(rig.model, tree, a.point, hint, reach, k % 3 == 0 ? 1e-4 : 1e-3, placed, a.found);
                a.at = a.point, a.moment = moment;
            }
            if (tells && wanted.at.squared_distance > 0 && wanted.triangle != kNone) {
                NearestTriangle other;
                ASSERT_FALSE(
                    nearest_of(rig.model, a.found, a.point, gone, 0.9 * std::sqrt(wanted.at.squared_distance), reach, placed, other))
                    << "something faster may be nearer";
            }
            ++asks, told += tells, none += tells && wanted.triangle == kNone;
            ASSERT_EQ(nearest.triangle, wanted.triangle) << tick << " " << k;
            ASSERT_EQ(nearest.at.squared_distance, wanted.at.squared_distance) << tick << " " << k;
            ASSERT_EQ(nearest.point, wanted.point) << tick << " " << k;
            if (tells || k % 6 > 0 || judged > 300) continue;
            ++judged;
            for (uint32_t index = 0; index < rig.model.triangle.size(); ++index) {
                const auto position = std::find(a.found.triangle.begin(), a.found.triangle.end(), index) - a.found.triangle.begin();
                std::array<Vec3d, 3> c;
                for (size_t i = 0; i < 3; ++i) {
                    const uint32_t v = rig.model.triangle[index][i];
                    c[i] = rig.model.position[v] + moment.age * rig.model.velocity[v] + moment.follow;
                }
                const double distance = std::sqrt(closest_point_on_triangle(a.point, c[0], c[1], c[2]).squared_distance);
                ASSERT_GE(distance, position < 4 ? 0 : position < 8 ? a.found.others[0] * (1 - 1e-12) : a.found.others[1] * (1 - 1e-12));
            }
        }
    }
    EXPECT_GT(told, 0.6 * asks);
    EXPECT_GT(none, 100u);
    EXPECT_GT(judged, 200u);
}

}  // namespace
}  // namespace trocar
