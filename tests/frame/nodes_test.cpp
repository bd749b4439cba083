// The node tree: folded poses, groups that are switched, and bodies with one coordinate, in whole frames.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <numbers>

#include "engine/base/error.hpp"
#include "engine/files/capture_file.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/motion/node_drive.hpp"
#include "systems/frame/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"
#include "tests/frame/written_scene.hpp"
namespace {
using namespace trocar;
namespace fs = std::filesystem;

World world_of(const std::string& text) { return std::move(WrittenScene("nodes", text).build().world); }
std::string error_of(const std::string& text) { return WrittenScene("nodes", text).error(); }

void run_for(World world, double seconds, const std::function<void(Frame&)>& each, uint32_t threads = 1) {
    run(
        std::move(world), static_cast<int>(std::lround(seconds * 60)), [&](Frame& frame, int) { each(frame); }, threads);
}

// ---- the tree ----

constexpr const char* kTree = R"(
[[node]]
name = "table"
position = [1.0, 2.0, 3.0]
rotation = [0.0, 0.0, 1.0, 90.0]
scale = 2.0
[[node]]
name = "tray"
parent = "table"
position = [0.1, 0.0, 0.2]
rotation = [1.0, 0.0, 0.0, 30.0]
[[node]]
name = "corner"
parent = "tray"
position = [0.0, 0.3, 0.0]
rotation = [1.0, 1.0, 0.0, -50.0]
scale = 0.5
[[body]]
name = "still"
node = "corner"
shape = "box"
size = 0.1
triangles = 12
position = [0.01, 0.02, 0.03]
rotation = [0.0, 1.0, 0.0, 20.0]
[[body]]
name = "moving"
node = "tray"
shape = "sphere"
scale = 0.1
triangles = 80
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.5]
rotation = [0.0, 0.0, 1.0, 10.0]
[[body.path]]
time = 1.0
position = [0.4, 0.0, 0.5]
rotation = [0.0, 0.0, 1.0, 10.0]
)";

Eigen::Affine3d frame_of(const Vec3d& position, const Vec3d& axis, double degrees, double scale) {
    return Eigen::Translation3d(position) * Eigen::AngleAxisd(degrees * M_PI / 180, axis.normalized()) * Eigen::Scaling(scale);
}

// Compares every vertex with the product of 4 x 4 matrices. Breaks when a parent is processed after its
// child, or a scale does not affect the positions below it.
TEST(Nodes, PlacesAreTheProductOfTheFramesAbove) {
    const World w = world_of(kTree);
    const Eigen::Affine3d table = frame_of({1, 2, 3}, {0, 0, 1}, 90, 2), tray = table * frame_of({0.1, 0, 0.2}, {1, 0, 0}, 30, 1),
                          corner = tray * frame_of({0, 0.3, 0}, {1, 1, 0}, -50, 0.5);
    const Eigen::Affine3d still = corner * frame_of({0.01, 0.02, 0.03}, {0, 1, 0}, 20, 0.1);
    const Surfaces s = surfaces_of(w);
    for (uint32_t v = 0; v < 8; ++v) {
        const Vec3d unit(v & 1 ? 0.5 : -0.5, v & 2 ? 0.5 : -0.5, v & 4 ? 0.5 : -0.5);
        const Vec3d wanted = still * unit;
        double nearest = 1;
        for (uint32_t u = 0; u < 8; ++u) nearest = std::min(nearest, (vertex_position(s, 0, u) - wanted).norm());
        EXPECT_LT(nearest, 1e-15 * 10);
    }
    for (uint32_t v = 0; v < w.meshes.info[w.bodies.mesh[1]].vertices.count; ++v)
        EXPECT_NEAR(s.meshes.position[s.meshes.info[w.bodies.mesh[1]].vertices.first + v].norm(), 0.1, 1e-12) << "0.5 m * 0.1 * 2";
    run_for(world_of(kTree), 0.5, [&](Frame& f) {
        if (f.world().clock.pass != 30) return;
        // the stage moved it to its pose at the start of the last pass
        const double t = 1e-3 * static_cast<double>(pass_tick(29, 60));
        EXPECT_LT((f.world().poses.origin[1] - tray * Vec3d(0.4 * t * t * (3 - 2 * t), 0, 0.5)).norm(), 1e-12)
            << "between two keys paths run by 3 t^2 - 2 t^3";
    });
}

TEST(Nodes, AreRefusedWithTheLineAndTheName) {
    const auto with = [](const std::string& more) { return error_of(std::string(kTree) + more); };
    EXPECT_NE(with("[[node]]\nname = \"tray\"\n").find("two nodes are named \"tray\""), std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"x\"\nparent = \"y\"\n").find("parent \"y\" names no node before it"), std::string::npos);
    EXPECT_NE(with("[[body]]\nname = \"c\"\nshape = \"box\"\ntriangles = 12\nnode = \"nowhere\"\n").find("no node is named \"nowhere\""),
              std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"x\"\nscale = 1e6\n[[node]]\nname = \"y\"\nparent = \"x\"\nscale = 1e6\n").find("scales beyond"),
              std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"d\"\nbehaviour = \"dial\"\n").find("has a behaviour but no body"), std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"d\"\nbehaviour = \"dial\"\n[[body]]\nname = \"c\"\nshape = \"box\"\ntriangles = 12\nnode = \"d\"\n")
                  .find("must have motion = \"free\""),
              std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"d\"\nbehaviour = \"wheel\"\n").find("none of button, slider, dial"), std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"b\"\nbehaviour = \"button\"\nstiffness = 1.0\n").find("limits"), std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"b\"\n[[node.switch]]\nenabled = false\n").find("needs one of time"), std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"b\"\n[[node.switch]]\ndriven = \"still\"\n").find("hangs on no node with a behaviour"),
              std::string::npos);
    EXPECT_NE(with("[[node]]\nname = \"b\"\nstiffness = 2.0\n").find("stiffness"), std::string::npos) << "of a node without a behaviour";
}

// ---- groups ----

constexpr const char* kShelf = R"(
gravity = [0.0, 0.0, -9.81]
[[node]]
name = "shelf"
[[node.switch]]
time = 0.5
enabled = false
[[node.switch]]
time = 0.7
enabled = true
[[node]]
name = "board"
parent = "shelf"
[[body]]
name = "board"
node = "board"
shape = "box"
triangles = 12
size = 1.0
position = [0.0, 0.0, -0.5]
[[body]]
name = "stone"
shape = "box"
triangles = 12
size = 0.1
motion = "free"
position = [0.0, 0.0, 0.0501]
[[body]]
name = "flyer"
node = "shelf"
shape = "sphere"
triangles = 80
size = 0.1
motion = "free"
position = [5.0, 0.0, 0.0]
velocity = [1.0, 0.0, 2.0]
spin = [0.0, 3.0, 1.0]
)";

// A body on a board that is disabled falls through it by the closed form. A disabled body keeps every bit of
// its state and continues as if no time had passed. Breaks when a child of a switched node stays active, or a
// disabled body moves.
TEST(Nodes, ADisabledGroupIsNeitherTouchedNorMoved) {
    std::vector<Vec3d> path;  // of the flyer, after each pass
    double rest = 0;
    run_for(world_of(kShelf), 0.9, [&](Frame& f) {
        const World& w = f.world();
        path.push_back(w.poses.origin[2]);
        const uint64_t pass = w.clock.pass;  // completed passes
        if (pass == 30) rest = w.poses.origin[1].z();
        if (pass > 30 && pass <= 42) {
            EXPECT_EQ(path[pass - 1], path[29]) << pass;
            if (f.times().picture) {
                EXPECT_EQ(w.picture.body[0].mesh, kNone);
            }
            const double t = 1e-3 * static_cast<double>(w.clock.tick - pass_tick(30, 60));
            // it slept there, so its first kick is a half kick: velocities are half a step behind positions
            EXPECT_NEAR(w.poses.origin[1].z(), rest - 0.5 * 9.81 * t * t, 1e-6) << pass;
        }
    });
    EXPECT_NEAR(rest, 0.05, 2e-4);
    EXPECT_NE(path[42], path[29]);
    // its own clock is 0.2 s behind
    const Vec3d start(5, 0, 0), speed(1, 0, 2);
    for (size_t p = 42; p < path.size(); ++p) {
        const double t = 1e-3 * static_cast<double>(pass_tick(p + 1, 60) - (pass_tick(42, 60) - pass_tick(30, 60)));
        EXPECT_LT((path[p] - (start + t * speed - Vec3d(0, 0, 0.5 * 9.81 * t * t))).norm(), 1e-9);
    }
}

// ---- bodies with one coordinate ----

std::string driven(const std::string& behaviour, const std::string& body = "") {
    return "gravity = [0.0, 0.0, 0.0]\n[[node]]\nname = \"n\"\nposition = [0.3, 0.1, 0.2]\nrotation = [1.0, 2.0, -1.0, 70.0]\naxis = [1.0, "
           "0.5, 2.0]\n" +
           behaviour +
           "[[body]]\nname = \"b\"\nnode = \"n\"\nshape = \"box\"\ntriangles = 12\nsize = 0.02\nmotion = \"free\"\nmass = 0.01\n" + body;
}
constexpr double kSide = 0.02, kMass = 0.01;

void set_rate(World& w, double rate) {
    const NodeDrive& drive = w.nodes.drive[0];
    w.node_state.drive[0].rate = rate;
    (turns(drive) ? w.poses.angular_velocity : w.poses.velocity)[drive.body] = rate * drive.axis;
}

// A slider with spring and damper: m q'' + c q' + k q = 0 from q' = v, checked at every pass, for any axis;
// the body stays on the axis to rounding. Breaks when the mass is not the body's, or the first kick is not a
// half kick.
TEST(DrivenBodies, SpringAndDamperFollowTheClosedForm) {
    const double k = 400, c = 0.1, v = 0.2;
    World world = world_of(driven("behaviour = \"slider\"\nstiffness = 400.0\ndamping = 0.1\n"));
    const NodeDrive drive = world.nodes.drive[0];
    set_rate(world, v);
    const double decay = 0.5 * c / kMass, omega = std::sqrt(k / kMass - decay * decay);
    EXPECT_NEAR(drive.axis.norm(), 1, 1e-15);
    double largest = 0;
    run_for(std::move(world), 0.5, [&](Frame& f) {
        const World& w = f.world();
        const double t = seconds_of(f), q = v / omega * std::exp(-decay * t) * std::sin(omega * t);
        // error of leapfrog with steps of a millisecond: the phase error per radian is (w dt)^2 / 24 from the
        // spring, and decay dt / 2 from damping before the kick
        const double dt = 1e-3, phase = (omega * omega * dt * dt / 24 + 0.5 * decay * dt) * omega * t;
        EXPECT_LT(std::abs(w.node_state.drive[0].coordinate - q), 1.1 * (phase + decay * dt) * v / omega * std::exp(-decay * t)) << t;
        largest = std::max(largest, std::abs(q));
        const Vec3d displacement = w.poses.origin[0] - drive.origin;
        EXPECT_LT(displacement.cross(drive.axis).norm(), 4e-16);
        EXPECT_EQ(w.poses.orientation[0].w, drive.orientation.w);
        EXPECT_LT(std::abs(w.energy.balance), 0.01 * 0.5 * kMass * v * v);
    });
    EXPECT_GT(largest, 0.5 * v / omega);
}

// A dial off its axis, with I about the axis computed by hand (cube: m s^2 / 6 about any axis, plus Steiner)
// and a torque from a distant spring: angle = rest (1 - cos(sqrt(k/I) t)), initially 1/2 torque/I t^2.
TEST(DrivenBodies, ADialTurnsByTorqueOverInertia) {
    World world = world_of(driven("behaviour = \"dial\"\nstiffness = 1e-4\nrest = 5729.5779513082325\n",
                                  "position = [0.03, 0.0, 0.0]\n"));  // 100 rad: 0.01 N m
    const NodeDrive drive = world.nodes.drive[0];
    const Vec3d axis = Vec3d(1, 0.5, 2).normalized();
    const double inertia = kMass * kSide * kSide / 6 + kMass * Vec3d(0.03, 0, 0).cross(axis).squaredNorm();
    EXPECT_NEAR(drive.inertia, inertia, 1e-12 * inertia);
    const double omega = std::sqrt(1e-4 / inertia), radius = Vec3d(0.03, 0, 0).cross(axis).norm();
    run_for(std::move(world), 0.3, [&](Frame& f) {
        const World& w = f.world();
        const double t = seconds_of(f), angle = 100 * (1 - std::cos(omega * t));
        EXPECT_NEAR(w.node_state.drive[0].coordinate, angle, 1e-3 * angle);
        EXPECT_NEAR(0.5 * 0.01 / inertia * t * t, angle, 0.1 * angle);
        const Vec3d arm = w.poses.origin[0] - Vec3d(0.3, 0.1, 0.2);
        EXPECT_NEAR(arm.cross(drive.axis).norm(), radius, 1e-14) << "it stays on its circle";
        EXPECT_NEAR((w.poses.velocity[0] - w.poses.angular_velocity[0].cross(arm)).norm(), 0, 1e-12);
    });
}

// Coulomb friction stops it at the angle I w^2 / (2 T), at the time I w / T, and holds it there.
TEST(DrivenBodies, DryFrictionStopsADialAtTheComputedAngle) {
    World world = world_of(driven("behaviour = \"dial\"\nfriction = 2e-5\n"));
    const double inertia = kMass * kSide * kSide / 6, w0 = 10, stop = 0.5 * inertia * w0 * w0 / 2e-5, at = inertia * w0 / 2e-5;
    set_rate(world, w0);
    double last = -1;
    run_for(std::move(world), 1.5 * at, [&](Frame& f) {
        const double t = seconds_of(f), q = f.world().node_state.drive[0].coordinate;
        if (t < at - 0.01) {
            EXPECT_NEAR(q, w0 * t - 0.5 * 2e-5 / inertia * t * t, 2e-3 * stop);
        }
        if (t > at + 0.01 && last >= 0) {
            EXPECT_EQ(q, last);
        }
        if (t > at + 0.01) last = q;
        EXPECT_LT(std::abs(f.world().energy.balance), 0.01 * 0.5 * inertia * w0 * w0);
    });
    EXPECT_NEAR(last, stop, 2e-3 * stop);
}

// Twelve detents of 2 mN m, overdamped: a torque of 1.8 mN m leaves it in the first notch, 2.2 mN m turns it
// past the others to its limit.
TEST(DrivenBodies, DetentsHoldBelowTheirTorqueAndGiveWayAbove) {
    for (const double torque : {1.8e-3, 2.2e-3}) {
        char text[400];
        std::snprintf(text, sizeof text,
                      "behaviour = \"dial\"\ndamping = 2.5e-4\ndetents = 12\ndetent = 2e-3\nlimits = [-90.0, 200.0]\nstiffness = "
                      "1e-5\nrest = %.12g\n",
                      torque / 1e-5 * 180 / M_PI);
        double coordinate = 0;
        uint32_t notches = 0, limits = 0;
        run_for(world_of(driven(text)), 2, [&](Frame& f) {
            const DriveState& d = f.world().node_state.drive[0];
            coordinate = d.coordinate;
            notches = d.events.count[static_cast<size_t>(NodeEventKind::kDetent)];
            limits = d.events.count[static_cast<size_t>(NodeEventKind::kLimit)];
            EXPECT_LE(d.coordinate, 200 * M_PI / 180);
        });
        if (torque < 2e-3) {
            EXPECT_NEAR(coordinate, std::asin(torque / 2e-3) / 12, 2e-3) << "where spring and detent are even";
            EXPECT_EQ(notches, 0u);
        } else {
            EXPECT_DOUBLE_EQ(coordinate, 200 * M_PI / 180);
            EXPECT_EQ(notches, 7u) << "at 15, 45, ... 195 degrees";
            EXPECT_EQ(limits, 1u);
        }
    }
}

// The detent force has a potential: drive_force is minus its gradient everywhere, for all combinations of
// options.
TEST(DrivenBodies, TheForceIsTheSlopeOfTheEnergy) {
    NodeDrive d;
    d.stiffness = 300, d.rest = -1e-3, d.click_at = 2e-3, d.click_width = 5e-4, d.click = 0.7, d.detents = 900, d.detent = 0.2;
    for (int i = -200; i <= 800; ++i) {
        const double q = i * 1e-5, h = 1e-8;
        EXPECT_NEAR(drive_force(d, q), -(drive_energy(d, q + h) - drive_energy(d, q - h)) / (2 * h), 2e-5) << q;
    }
}

// ---- with tools ----

constexpr const char* kPress = R"(
gravity = [0.0, 0.0, 0.0]
[[node]]
name = "button"
behaviour = "button"
axis = [0.0, 0.0, -1.0]
limits = [0.0, 0.008]
stiffness = 350.0
rest = -0.001
damping = 1.0
[[body]]
name = "button"
node = "button"
shape = "box"
size = 0.02
triangles = 108
motion = "free"
mass = 0.01
[[body]]
name = "probe"
shape = "probe"
triangles = 600
motion = "hand"
position = [0.002, 0.001, 0.03]
[[tool]]
body = "probe"
tip_radius = 0.007
stiffness = 600.0
[[tool.path]]
time = 0.0
position = [0.002, 0.001, 0.03]
[[tool.path]]
time = 0.5
position = [0.002, 0.001, 0.013]
[[tool.path]]
time = 1.0
position = [0.002, 0.001, 0.013]
)";

// At rest three forces are equal: the spring's on the button, the tissue's on the simulated tool, and the
// hand's; the position is that of two springs in series. Breaks when the tick does not know the button's
// position.
TEST(DrivenBodies, TheHandFeelsTheSpringOfAPressedButton) {
    double worst_energy_error = 0;
    run_for(world_of(kPress), 1, [&](Frame& f) {
        const World& w = f.world();
        worst_energy_error = std::max(worst_energy_error, std::abs(w.energy.balance));
        if (w.clock.pass < 60) return;
        const double q = w.node_state.drive[0].coordinate, spring = 350 * (q + 0.001);
        const ToolState& tool = w.haptics.state[0];
        // the device is 4 mm past first contact: 600 (4 mm - q) = 350 (q + 1 mm)
        EXPECT_NEAR(q, (600 * 0.004 - 350 * 0.001) / 950, 2e-5);
        EXPECT_NEAR(tool.command.force.norm(), spring, 0.01 * spring);
        EXPECT_NEAR(tool.command.force.z(), spring, 0.01 * spring);
        EXPECT_NEAR(tool.contact_impulse.norm() / (1e-3 * w.clock.period), spring, 0.01 * spring);
        EXPECT_LT(worst_energy_error, 0.01 * w.energy.work_hand) << "of the work of the hand";
        EXPECT_EQ(w.node_state.drive[0].events.count[static_cast<size_t>(NodeEventKind::kPressed)], 0u) << "4 mm were not reached";
    });
}

// Pressed beyond its travel the button is at its stop, and the hand feels the coupling against it.
TEST(DrivenBodies, AButtonStandsAtItsStop) {
    World world = std::move(WrittenScene("nodes", kPress).build({{"node.button.limits", "[0.0, 0.001]"}}).world);
    run_for(std::move(world), 1, [&](Frame& f) {
        const World& w = f.world();
        EXPECT_LE(w.node_state.drive[0].coordinate, 0.001);
        if (w.clock.pass < 60) return;
        EXPECT_DOUBLE_EQ(w.node_state.drive[0].coordinate, 0.001);
        EXPECT_NEAR(w.haptics.state[0].command.force.z(), 600 * 0.003, 0.01 * 600 * 0.003);
        EXPECT_EQ(w.node_state.drive[0].events.count[static_cast<size_t>(NodeEventKind::kPressed)], 1u);
        EXPECT_LT(w.report.deepest_residual, 1e-5);
    });
}

World small_panel() { return std::move(small_scene("dial_and_button", "400").world); }

// The scene's events: the button is pressed and released once, the lamp is on, the dial turns through its
// detents; bit-identical for any number of threads, and after saving and loading a state.
TEST(DrivenBodies, TheSceneOfDialAndButtonGoesThroughItsEvents) {
    uint64_t hash[2] = {0, 0};
    for (const uint32_t threads : {1u, 2u}) {
        run_for(
            small_panel(), 6,
            [&](Frame& f) {
                const World& w = f.world();
                if (w.clock.pass < 360) return;
                hash[threads - 1] = state_hash(w);
                const auto count = [&](size_t row, NodeEventKind kind) {
                    return w.node_state.drive[row].events.count[static_cast<size_t>(kind)];
                };
                EXPECT_EQ(count(0, NodeEventKind::kPressed), 1u);
                EXPECT_EQ(count(0, NodeEventKind::kReleased), 1u);
                EXPECT_EQ(count(0, NodeEventKind::kLimit), 2u) << "down, and back up";
                EXPECT_GE(count(1, NodeEventKind::kDetent), 4u);
                const double coordinate = w.node_state.drive[1].coordinate, notch = coordinate * 16 / (2 * M_PI);
                EXPECT_GT(coordinate, 1.2);
                // friction holds it where the detent torque is smaller: asin(2 / 8) / 16
                EXPECT_LT(std::abs(notch - std::round(notch)) * 2 * M_PI / 16, std::asin(0.25) / 16 + 1e-3) << "it rests in a detent";
                EXPECT_LT(std::abs(w.energy.balance), 0.02 * w.energy.work_hand);
                EXPECT_EQ(find_fault(w), "");
            },
            threads);
    }
    EXPECT_EQ(hash[0], hash[1]);
}

constexpr const char* kExchange = R"(
[[body]]
name = "floor"
shape = "box"
size = 1.0
triangles = 12
position = [0.0, 0.0, -0.5]
[[body]]
name = "probe"
shape = "probe"
triangles = 600
motion = "hand"
position = [0.0, 0.0, 0.03]
[[body]]
name = "ball"
shape = "sphere"
size = 0.02
triangles = 320
motion = "hand"
position = [0.3, 0.0, 0.5]
[[tool]]
body = "probe"
tip_radius = 0.007
stiffness = 600.0
friction = 0.0
[[tool.exchange]]
body = "ball"
tip_radius = 0.01
time = 1.0
[[tool.exchange]]
body = "probe"
time = 2.0
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.03]
[[tool.path]]
time = 0.4
position = [0.0, 0.0, 0.006]
[[tool.path]]
time = 0.7
position = [0.0, 0.0, 0.006]
[[tool.path]]
time = 0.9
position = [0.0, 0.0, 0.03]
[[tool.path]]
time = 1.3
position = [0.0, 0.0, 0.008]
[[tool.path]]
time = 3.0
position = [0.0, 0.0, 0.008]
)";

// 1 mm deep with the probe's tip, 2 mm with the ball; then the probe again, clear of the floor. The tool that
// is not in the hand stays where it is.
TEST(ToolExchange, AnotherTipTakesThePlaceOfTheFirst) {
    Vec3d laid_down;
    run_for(world_of(kExchange), 2.5, [&](Frame& f) {
        const World& w = f.world();
        const auto force = [&](size_t tool) { return w.haptics.state[tool].command.force.z(); };
        EXPECT_NE(is_off(w.node_state, 1), is_off(w.node_state, 2)) << w.clock.pass;
        const double t = seconds_of(f);
        if (w.clock.pass == 39) {
            EXPECT_NEAR(force(0), 600 * 0.001, 0.006);
        }
        if (w.clock.pass == 62) laid_down = w.poses.origin[1];
        if (w.clock.pass == 110) {
            EXPECT_NEAR(force(1), 600 * 0.002, 0.012);
            EXPECT_EQ(w.poses.origin[1], laid_down);
            EXPECT_EQ(force(0), 0);
            EXPECT_GT(w.haptics.state[1].ticks, 1500u) << "the hand goes on";
        }
        if (t > 2.05) {
            EXPECT_EQ(w.haptics.state[0].output.force.norm(), 0) << "a tip of 7 mm, 8 mm above the floor";
        }
    });
    std::string same = kExchange;
    same.replace(same.find("body = \"ball\""), 13, "body = \"probe\"");
    EXPECT_NE(error_of(same).find("is in a hand already"), std::string::npos);
}

// With dof = 6 the other instrument has a point shell of its own: a ball of 20 mm instead of one of 10 mm, on
// a floor that stops both at their lowest point. Breaks when the first instrument's point shell stays in use.
TEST(ToolExchange, AShellGivesWayToAnother) {
    const auto ball = [](const std::string& name, const char* size) {
        return "[[body]]\nname = \"" + name + "\"\nshape = \"sphere\"\nsize = " + size +
               "\ntriangles = 1280\nmotion = \"hand\"\nposition = [0.0, 0.0, 0.03]\n";
    };
    const std::string scene = "[[body]]\nname = \"floor\"\nshape = \"box\"\nsize = 1.0\ntriangles = 12\nposition = [0.0, 0.0, -0.5]\n" +
                              ball("small", "0.02") + ball("large", "0.04") + R"(
[[tool]]
body = "small"
dof = 6
points = 1000
stiffness = 600.0
friction = 0.0
[[tool.exchange]]
body = "large"
time = 1.0
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.03]
[[tool.path]]
time = 0.4
position = [0.0, 0.0, 0.009]
[[tool.path]]
time = 0.7
position = [0.0, 0.0, 0.009]
[[tool.path]]
time = 0.9
position = [0.0, 0.0, 0.03]
[[tool.path]]
time = 1.3
position = [0.0, 0.0, 0.018]
)";
    run_for(world_of(scene), 2.0, [&](Frame& f) {
        const World& w = f.world();
        const auto force = [&](size_t tool) { return w.haptics.state[tool].command.force.z(); };
        // the point springs yield by a hundredth, and the lowest point of a triangulated ball is less than
        // 0.1 mm higher
        if (w.clock.pass == 40) {
            EXPECT_NEAR(force(0), 600 * 0.001, 0.05 * 0.6);
        }
        if (w.clock.pass == 110) {
            EXPECT_NEAR(force(1), 600 * 0.002, 0.05 * 1.2);
            EXPECT_EQ(force(0), 0);
        }
    });
    EXPECT_NE(world_of(scene).haptics.tool[0].shell_radius, world_of(scene).haptics.tool[1].shell_radius);
}

// ---- surfaces ----

// A body's own surface properties reach the hand: 600 and 300 N/m in series, pressed 2 mm; without the table
// they have no effect.
TEST(HapticSurface, OfAScene) {
    const std::string floor = "[[body]]\nname = \"floor\"\nshape = \"box\"\nsize = 1.0\ntriangles = 12\nposition = [0.0, 0.0, -0.5]\n";
    const std::string probe = R"(
[[body]]
name = "probe"
shape = "probe"
triangles = 600
motion = "hand"
[[tool]]
body = "probe"
tip_radius = 0.007
stiffness = 600.0
friction = 0.0
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.03]
[[tool.path]]
time = 0.5
position = [0.0, 0.0, 0.005]
)";
    const auto pressed = [&](const std::string& haptic) {
        double force = 0;
        run_for(world_of(floor + haptic + probe), 0.8, [&](Frame& f) { force = f.world().haptics.state[0].output.force.z(); });
        return force;
    };
    EXPECT_NEAR(pressed("[body.haptic]\nstiffness = 300.0\n"), 200 * 0.002, 1e-6);
    EXPECT_NEAR(pressed(""), 600 * 0.002, 1e-6);
    const auto error = [&](const std::string& haptic) { return error_of(floor + "[body.haptic]\n" + haptic + probe); };
    EXPECT_NE(error("static_friction = 0.1\ndynamic_friction = 0.2\n").find("must not be above"), std::string::npos);
    EXPECT_NE(error("dynamic_friction = 0.2\n").find("needs a static_friction"), std::string::npos);
    EXPECT_NE(error("texture = \"grating\"\n").find(":7:1: a texture needs a height"), std::string::npos)
        << error("texture = \"grating\"\n");
    EXPECT_NE(error("texture = \"velvet\"\n").find("none of none, grating, noise"), std::string::npos) << error("texture = \"velvet\"\n");
    EXPECT_NE(error("stifness = 1.0\n").find(":8:1"), std::string::npos) << error("stifness = 1.0\n");
    EXPECT_NE(error("damping = -1.0\n").find("damping"), std::string::npos);
    EXPECT_NE(error_of("[[body]]\nname = \"s\"\nshape = \"sphere\"\nmotion = \"deformable\"\n[body.haptic]\nstiffness = 100.0\n" + probe)
                  .find("static or kinematic"),
              std::string::npos);
}

// ---- jaws ----

const std::string kJaws = R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "handle"
shape = "sphere"
size = 0.004
triangles = 80
motion = "hand"
[[body]]
name = "left"
shape = "grasper_jaw"
triangles = 400
motion = "hand"
[[body]]
name = "right"
shape = "grasper_jaw"
triangles = 400
motion = "hand"
[[tool]]
body = "handle"
tip_radius = 0.002
stiffness = 600.0
grip_closed = 5.0
[[tool.jaw]]
body = "left"
pivot = [0.0, 0.001, 0.0]
axis = [1.0, 0.0, 0.0]
share = -0.5
[[tool.jaw]]
body = "right"
pivot = [0.0, -0.001, 0.0]
rotation = [0.0, 0.0, 1.0, 180.0]
axis = [1.0, 0.0, 0.0]
share = 0.5
[[tool.path]]
time = 0.0
grip = 60.0
[[tool.path]]
time = 0.2
grip = 60.0
[[tool.path]]
time = 0.5
position = [0.0, 0.0, 0.01]
rotation = [0.0, 1.0, 0.0, 90.0]
grip = 20.0
[[tool.path]]
time = 0.8
position = [0.0, 0.0, 0.01]
grip = 0.0
)";

// Pose of the jaws, to rounding: pivots move with the instrument, each jaw turns by half the grip angle. A
// grip angle below the limit counts as the first button.
TEST(ToolJaws, TurnByTheGripAboutTheInstrument) {
    int closed = 0;
    run_for(world_of(kJaws), 1.0, [&](Frame& f) {
        const World& w = f.world();
        const ToolState& tool = w.haptics.state[0];
        if (seconds_of(f) < 0.05) return;
        const Quat turn = w.poses.orientation[0];
        // the simulated instrument is where its hand will be at the end of the pass
        const double t = seconds_of(f);
        const double u = t >= 0.8 ? 1 : t >= 0.5 ? (t - 0.5) / 0.3 : t >= 0.2 ? (t - 0.2) / 0.3 : 0, rise = u * u * (3 - 2 * u);
        const double grip = std::numbers::pi / 180 * (t >= 0.5 ? 20 - 20 * rise : 60 - 40 * rise);
        for (uint32_t k = 0; k < 2; ++k) {
            const Vec3d pivot = w.poses.origin[0] + rotate(turn, Vec3d(0, k == 0 ? 1e-3 : -1e-3, 0));
            EXPECT_LT((w.poses.origin[1 + k] - pivot).norm(), 1e-12) << t;
            const Quat closed_turn = k == 0 ? Quat{} : from_rotation_vector({0, 0, std::numbers::pi});
            const Quat wanted = multiply(turn, multiply(from_rotation_vector(Vec3d((k == 0 ? -0.5 : 0.5) * grip, 0, 0)), closed_turn));
            EXPECT_LT(rotation_vector(wanted, w.poses.orientation[1 + k]).norm(), 1e-4) << t << " " << grip;
        }
        EXPECT_EQ((tool.device.buttons & 1) != 0, tool.device.grip < 5 * std::numbers::pi / 180);
        closed += (tool.device.buttons & 1) != 0;
    });
    EXPECT_GT(closed, 10);
    const auto with = [&](const std::string& from, const std::string& to) {
        std::string text = kJaws;
        text.replace(text.find(from), from.size(), to);
        return error_of(text);
    };
    EXPECT_NE(with("body = \"left\"\npivot", "body = \"lost\"\npivot").find("no body is named \"lost\""), std::string::npos);
    EXPECT_NE(with("body = \"left\"\npivot", "body = \"handle\"\npivot").find("be nothing else"), std::string::npos);
    EXPECT_NE(with("grip = 20.0", "grip = 200.0").find("grip"), std::string::npos);
}

// Jaws close on an unsupported soft ball and lift it by contact and friction alone: it follows, and the
// energy accounting closes, for a tool with a spherical tip and for one with a point shell on the jaws. While
// the second one closes in place, the fingers do all the work, against the torque reported to them. Breaks
// when jaws exert no force, when the reaction on the tool is lost, when the jaws' own work is not accounted,
// or when the torque is about another axis.
TEST(ToolJaws, GraspAndLiftByFriction) {
    std::string scene = kJaws.substr(0, kJaws.find("[[tool.path]]")) + R"(
[[tool.path]]
time = 0.0
grip = 100.0
[[tool.path]]
time = 0.5
grip = 6.0
[[tool.path]]
time = 0.7
grip = 6.0
[[tool.path]]
time = 1.2
position = [0.0, 0.0, -0.02]
[[body]]
name = "ball"
shape = "sphere"
size = 0.008
triangles = 320
motion = "deformable"
anchor = "shape"
position = [0.0, 0.0, 0.014]
[body.tissue]
youngs_modulus = 5e3
friction = 0.8
)";
    for (const bool feels : {false, true}) {
        if (feels) scene.replace(scene.find("tip_radius = 0.002"), 18, "dof = 6\npoints = 400");
        const World made = world_of(scene);
        uint32_t ball = 0;
        while (made.bodies.name[ball] != "ball") ++ball;
        const auto middle = [&](const World& w) {
            Vec3d sum = Vec3d::Zero();
            for (uint32_t v = 0; v < w.bodies.particles[ball].count; ++v) sum += vertex_position(surfaces_of(w), ball, v);
            return Vec3d(sum / w.bodies.particles[ball].count);
        };
        const double from = middle(made).z();
        double to = 0, work = 0, balance = 0, closing = 0, fingers = 0, grip = made.haptics.state[0].device.grip, hardest = 0;
        uint32_t felt = 0;
        bool first = true;
        run_for(world_of(scene), 1.3, [&](Frame& f) {
            const World& w = f.world();
            const ToolState& tool = w.haptics.state[0];
            to = middle(w).z();
            // in a pass the jaws move from one sample of the grip to the next
            if (!first && seconds_of(f) < 0.55) fingers += tool.grip_torque * (grip - tool.device.grip), closing = w.energy.work_hand;
            first = false;
            grip = tool.device.grip;
            hardest = std::max(hardest, tool.grip_torque);
            for (const ShellContact& c : tool.contact)
                felt += c.point < w.haptics.tool[0].point_shell.size() && w.haptics.tool[0].point_shell[c.point].jaw != kNone;
            work = std::max(work, std::abs(w.energy.work_hand));
            balance = std::max(balance, std::abs(w.energy.balance));
        });
        std::printf(
            "lifted %.1f mm of 20, hand's work %.4f mJ, books to %.6f mJ; closing %.4f mJ, by the fingers' torque %.4f mJ, at most %.3f mN "
            "m\n",
            1e3 * (from - to), 1e3 * work, 1e3 * balance, 1e3 * closing, 1e3 * fingers, 1e3 * hardest);
        EXPECT_NEAR(to, from - 0.02, 0.003);
        EXPECT_LT(balance, 0.02 * work);
        if (!feels) continue;
        EXPECT_GT(felt, 100u);
        EXPECT_GT(hardest, 1e-4);
        EXPECT_NEAR(fingers, closing, 0.05 * closing);
    }
}

// Closing the grip links the tissue between the jaws, and opening releases it; the hand feels the link force.
// Breaks when links are made earlier, stay, or are made to the wrong jaw.
TEST(ToolJaws, AttachAtClosing) {
    size_t open = 0, held = 0, after = 0;
    double pulled = 0, let_go = 0, twist = 0, work = 0, balance = 0, felt = 0, tissue = 0, most = 0, stuck = 0;
    const std::vector<Override> coarse = {{"gallbladder.triangles", "1500"}};
    BuiltScene scene = build_scene(read_scene_file(source_folder() / "content/scenes/grasp_by_hand.toml", coarse), Looks::kPlain);
    run_for(std::move(scene.world), 4.9, [&](Frame& f) {
        const World& w = f.world();
        const double t = seconds_of(f);
        const auto force = [&] { return w.haptics.state[0].output.force.norm(); };
        const auto tissue_force = [&] { return w.haptics.state[0].contact_impulse.norm() / (1e-3 * w.clock.period); };
        if (t < 1.0) open = std::max(open, w.links.node.size());
        if (t > 1.5 && t < 3.1) held = std::max(held, w.links.node.size());
        if (t > 2.8 && t < 3.1) tissue = tissue_force(), felt = force();
        if (t > 3.8 && t < 4.4) most = std::max(most, force());
        if (t > 2.4 && t < 3.1) pulled = std::max(pulled, force()), twist = std::max(twist, w.haptics.state[0].output.torque.norm());
        if (t > 4.5)
            after = std::max(after, w.links.node.size()), let_go = std::max(let_go, force()), stuck = std::max(stuck, tissue_force());
        work = std::max(work, std::abs(w.energy.work_hand));
        balance = std::max(balance, std::abs(w.energy.balance));
    });
    std::printf(
        "links %zu before, %zu held, %zu after; pull %.3f N (tissue %.3f) and %.2f mN m, %.3f N letting go, then %.3f N; books to %.3f "
        "%%\n",
        open, held, after, felt, tissue, 1e3 * twist, most, let_go, 100 * balance / work);
    EXPECT_EQ(open, 0u);
    EXPECT_GT(held, 8u);
    EXPECT_EQ(after, 0u);
    EXPECT_NEAR(felt, tissue, 0.1 * tissue);
    EXPECT_LT(most, 1.5 * pulled);
    EXPECT_LT(let_go, 0.05 * pulled);
    EXPECT_LT(stuck, 0.05 * pulled);
    EXPECT_LT(balance, 0.01 * work);
}

}  // namespace
