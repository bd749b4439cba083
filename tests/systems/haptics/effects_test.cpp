#include "systems/haptics/effects.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "engine/geometry/quaternion.hpp"
#include "systems/haptics/manipulator.hpp"
#include "systems/haptics/tool.hpp"
#include "tests/reference/local_patches.hpp"

// Forces of effects against their closed forms, their starts and stops; manipulators by virtual work; events.
namespace trocar {
namespace {

constexpr double kRise = 0.05;  // s
const double kPi = std::numbers::pi;

EffectInput input_at(double age, const Vec3d& x = {0.01, 0.02, -0.03}, const Vec3d& v = {0.1, -0.2, 0.3}) {
    EffectInput in;
    in.age = age;
    in.position = x;
    in.velocity = v;
    in.acceleration = {1, -2, 3};
    return in;
}
HapticEffect effect(EffectKind kind) {
    HapticEffect e;
    e.kind = kind;
    return e;
}
Eigen::Matrix3d matrix(const std::array<double, 9>& k) { return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(k.data()); }

// ---- forces ----

TEST(HapticEffects, SpringsPullToTheirPointLineAndPlane) {
    HapticEffect e = effect(EffectKind::kSpringPoint);
    e.point = {0.05, 0, 0};
    e.direction = Vec3d(1, 2, 2) / 3;
    e.stiffness = 200;
    e.damping = 3;
    const EffectInput in = input_at(1);
    const Vec3d displacement = e.point - in.position;
    EXPECT_NEAR((effect_force(e, kRise, in) - (200 * displacement - 3 * in.velocity)).norm(), 0, 1e-12);
    e.kind = EffectKind::kSpringPlane;
    const Vec3d plane = effect_force(e, kRise, in);
    EXPECT_NEAR((plane - e.direction * (200 * displacement - 3 * in.velocity).dot(e.direction)).norm(), 0, 1e-12);
    e.kind = EffectKind::kSpringLine;
    const Vec3d line = effect_force(e, kRise, in);
    EXPECT_NEAR(line.dot(e.direction), 0, 1e-12);
    EXPECT_NEAR((line + plane - (200 * displacement - 3 * in.velocity)).norm(), 0, 1e-12);
    // half-way through its rise time it has half the force
    EffectInput young = in;
    young.age = 0.5 * kRise;
    EXPECT_NEAR((effect_force(e, kRise, young) - 0.5 * line).norm(), 0, 1e-12);
}

// Breaks when the stiffness sent to the device is not the gradient of the force.
TEST(HapticEffects, StiffnessIsTheSlopeOfTheForce) {
    for (const EffectKind kind : {EffectKind::kSpringPoint, EffectKind::kSpringLine, EffectKind::kSpringPlane, EffectKind::kConstant}) {
        HapticEffect e = effect(kind);
        e.direction = Vec3d(2, -1, 2) / 3;
        e.stiffness = 300;
        e.force = 1;
        for (int k = 0; k < 3; ++k) {
            const double h = 1e-4;
            const EffectInput a = input_at(1, h * Vec3d::Unit(k)), b = input_at(1, -h * Vec3d::Unit(k));
            const Vec3d slope = (effect_force(e, kRise, a) - effect_force(e, kRise, b)) / (2 * h);
            EXPECT_NEAR((slope + matrix(effect_stiffness(e)).col(k)).norm(), 0, 1e-8);
        }
    }
}

TEST(HapticEffects, ConstantVibrationViscosityInertiaFollowTheirForms) {
    HapticEffect e = effect(EffectKind::kConstant);
    e.direction = {0, 0.6, 0.8};
    e.force = -2;
    EXPECT_NEAR((effect_force(e, kRise, input_at(3)) - Vec3d(0, -1.2, -1.6)).norm(), 0, 1e-15);
    e.kind = EffectKind::kVibration;
    e.frequency = 80;
    for (const double t : {0.0, 1e-3, 3.125e-3, 0.0178})
        EXPECT_NEAR(effect_force(e, kRise, input_at(t)).dot(e.direction), -2 * std::sin(2 * kPi * 80 * t), 1e-12);
    e.kind = EffectKind::kViscosity;
    e.damping = 4;
    EXPECT_NEAR((effect_force(e, kRise, input_at(1)) + 4 * Vec3d(0.1, -0.2, 0.3)).norm(), 0, 1e-15);
    e.kind = EffectKind::kInertia;
    e.mass = 0.05;
    EXPECT_NEAR((effect_force(e, kRise, input_at(1)) + 0.05 * Vec3d(1, -2, 3)).norm(), 0, 1e-15);
}

TEST(HapticEffects, AnImpulseGivesItsImpulseWhateverItsLength) {
    for (const double duration : {0.0, 1e-3, 4.5e-3, 0.02, 0.1}) {
        HapticEffect e = effect(EffectKind::kImpulse);
        e.impulse = 0.03;
        e.duration = duration;
        double sum = 0, largest = 0;
        for (int k = 0; k < 200; ++k) {
            const double f = effect_force(e, kRise, input_at(1e-3 * k)).z();
            sum += 1e-3 * f;
            largest = std::max(largest, f);
        }
        EXPECT_NEAR(sum, 0.03, 1e-12) << duration;
        if (duration >= 0.02) {
            EXPECT_NEAR(largest, 0.03 * kPi / (2 * duration), 0.01 * largest);
        }
    }
}

TEST(HapticEffects, AMagnetPullsToTheNearestSurface) {
    const LocalContactModel plane = reference::make_patch(reference::make_plane());
    HapticEffect e = effect(EffectKind::kMagnet);
    e.force = 2;
    e.reach = 4e-3;
    for (const double gap : {0.0, 1e-3, 2e-3, 3.9e-3, 4.1e-3, 0.02}) {
        EffectInput in = input_at(1);
        find_near_surface(plane, 0, {0.001, 0.002, 3e-3 + gap}, 3e-3, e.reach, in);
        const Vec3d force = effect_force(e, kRise, in);
        EXPECT_NEAR(force.z(), gap < e.reach ? -2 * (1 - gap / e.reach) : 0, 1e-9) << gap;
        EXPECT_NEAR(force.head<2>().norm(), 0, 1e-12);
    }
}

// ---- starts and stops ----

// Ticks at which one effect is active, out of 100, as "first-last" pieces.
template <typename Setup>
std::string runs_of(const HapticEffect& e, Setup&& setup) {
    EffectState state;
    std::string text;
    bool was = false;
    EffectTriggers before;
    for (int k = 0; k <= 100; ++k) {
        EffectTriggers t;
        t.time = 1e-3 * k;
        t.buttons_before = before.buttons;
        setup(k, t);
        run_triggers({&e, 1}, t, {&state, 1});
        if (state.running != was) text += (was ? "-" + std::to_string(k - 1) + " " : std::to_string(k));
        was = state.running;
        before = t;
    }
    return text + (was ? "-" : "");
}

TEST(HapticEffects, StartStopAndDuration) {
    const auto nothing = [](int, EffectTriggers&) {};
    HapticEffect e;
    EXPECT_EQ(runs_of(e, nothing), "0-");
    e.start = 0.02;
    EXPECT_EQ(runs_of(e, nothing), "20-");
    e.duration = 0.03;
    EXPECT_EQ(runs_of(e, nothing), "20-49 ");
    e.kind = EffectKind::kImpulse, e.duration = 0;
    EXPECT_EQ(runs_of(e, nothing), "20-20 ");

    const auto button = [](int k, EffectTriggers& t) { t.buttons = (k >= 10 && k < 30) || (k >= 60 && k < 70) ? 2 : 0; };
    e = {};
    e.trigger = EffectTrigger::kButton;
    e.buttons = 2;
    EXPECT_EQ(runs_of(e, button), "10-29 60-69 ");
    e.duration = 0.005;
    EXPECT_EQ(runs_of(e, button), "10-14 60-64 ");
    e.buttons = 1;
    EXPECT_EQ(runs_of(e, button), "");

    const auto touch = [](int k, EffectTriggers& t) { t.touch = k == 20 || k == 50, t.release = k == 40; };
    e = {};
    e.trigger = EffectTrigger::kTouch;
    EXPECT_EQ(runs_of(e, touch), "20-39 50-");
    e.trigger = EffectTrigger::kRelease;
    EXPECT_EQ(runs_of(e, touch), "40-49 ");
    e.duration = 0.02;
    EXPECT_EQ(runs_of(e, touch), "40-59 ");
}

// ---- manipulators ----

DeviceState device_at(const Vec3d& position, const Quat& turn = {}, uint32_t buttons = 0) {
    DeviceState state;
    state.position = position;
    state.orientation = turn;
    state.buttons = buttons;
    return state;
}

TEST(HapticManipulator, WorkspaceMountsAndScales) {
    HandTool tool;
    tool.workspace = {{1, 2, 3}, from_rotation_vector({0, 0, 0.5 * kPi}), 2, 0};
    ClutchState clutch;
    DeviceState device = device_at({0.1, 0, 0});
    device.velocity = {0, 1, 0};
    const DeviceState placed = place_tool(tool, device, clutch);
    EXPECT_NEAR((placed.position - Vec3d(1, 2.2, 3)).norm(), 0, 1e-15);
    EXPECT_NEAR((placed.velocity - Vec3d(-2, 0, 0)).norm(), 0, 1e-15);
    EXPECT_NEAR(rotate(placed.orientation, Vec3d::UnitX()).y(), 1, 1e-15);
    DeviceCommand command;
    command.force = {0, 3, 1};
    command.at = placed.position;
    const DeviceCommand told = command_for_device(tool, placed, clutch, command);
    EXPECT_NEAR((told.force - Vec3d(6, 0, 2)).norm(), 0, 1e-12);
    EXPECT_NEAR((told.at - device.position).norm(), 0, 1e-12);
}

// While the clutch is pressed the tool stays; after its release the tool continues from there without a jump.
TEST(HapticManipulator, ClutchLetsTheHandMoveAlone) {
    HandTool tool;
    tool.workspace.clutch = 4;
    tool.workspace.scale = 3;
    ClutchState clutch;
    EXPECT_EQ(place_tool(tool, device_at({0.01, 0, 0}), clutch).position.x(), 0.03);
    for (int twice = 0; twice < 2; ++twice) {  // a repeated sample gives the same position
        DeviceState moving = device_at({-0.02, 0, 0}, {}, 4);
        moving.velocity = {1, 0, 0};
        const DeviceState held = place_tool(tool, moving, clutch);
        EXPECT_EQ(held.position.x(), 0.03);
        EXPECT_EQ(held.velocity.norm(), 0);
    }
    EXPECT_NEAR(place_tool(tool, device_at({-0.02, 0, 0}), clutch).position.x(), 0.03, 1e-15);
    EXPECT_NEAR(place_tool(tool, device_at({-0.01, 0, 0}), clutch).position.x(), 0.06, 1e-15);
    // and a non-finite sample has no lasting effect
    place_tool(tool, device_at({std::nan(""), 0, 0}, {}, 4), clutch);
    EXPECT_NEAR(place_tool(tool, device_at({-0.01, 0, 0}), clutch).position.x(), 0.06, 1e-15);
}

struct PivotRig {
    HandTool tool;
    ClutchState clutch;
    explicit PivotRig(PivotKind kind) { tool.pivot = {kind, {0.02, -0.01, 0.1}, 0.3, {0, 0, -1}}; }
    DeviceState pose_at(const Vec3d& position, const Quat& turn = {}) { return place_tool(tool, device_at(position, turn), clutch); }
};

// The instrument is a straight line through the pivot for every hand motion: its tip is `length` from the
// handle on the far side, and moving the handle across moves the tip in the opposite direction by the lever.
TEST(HapticManipulator, TheShaftPassesThroughThePivot) {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    const auto any = [&](double size) { return Vec3d(size * Vec3d(normal(random), normal(random), normal(random))); };
    for (int k = 0; k < 200; ++k) {
        PivotRig rig(PivotKind::kHandle);
        const Vec3d handle = rig.tool.pivot.point + Vec3d(0, 0, 0.15) + any(0.03);
        const DeviceState placed = rig.pose_at(handle, from_rotation_vector(any(1)));
        EXPECT_NEAR((placed.position - handle).norm(), 0.3, 1e-14);
        const Vec3d shaft = (placed.position - handle).normalized();
        EXPECT_NEAR((rig.tool.pivot.point - handle).cross(shaft).norm(), 0, 1e-14);
        EXPECT_NEAR((rotate(placed.orientation, rig.tool.pivot.axis) - shaft).norm(), 0, 1e-12);
        PivotRig inside(PivotKind::kTip);
        const Vec3d tip = inside.tool.pivot.point - Vec3d(0, 0, 0.15) + any(0.03);
        const DeviceState same = inside.pose_at(tip, from_rotation_vector(any(1)));
        EXPECT_EQ(same.position, tip);
        EXPECT_NEAR(rotate(same.orientation, inside.tool.pivot.axis).cross((tip - inside.tool.pivot.point).normalized()).norm(), 0, 1e-12);
    }
    PivotRig rig(PivotKind::kHandle);
    const Vec3d handle = rig.tool.pivot.point + Vec3d(0, 0, 0.1), h = Vec3d(1e-6, 0, 0);
    const Vec3d across = (rig.pose_at(handle + h).position - rig.pose_at(handle - h).position) / 2e-6;
    EXPECT_NEAR(across.x(), -(0.3 - 0.1) / 0.1, 1e-6);  // inverted, twice as far
    const Vec3d along = (rig.pose_at(handle + Vec3d(0, 0, 1e-6)).position - rig.pose_at(handle).position) / 1e-6;
    EXPECT_NEAR((along - Vec3d::UnitZ()).norm(), 0, 1e-6);
}

// Roll is transmitted unchanged: rotating the device about the shaft rotates the instrument about it.
TEST(HapticManipulator, RollPassesThePivot) {
    PivotRig rig(PivotKind::kHandle);
    const Vec3d handle = rig.tool.pivot.point + Vec3d(0.02, 0.03, 0.12);
    const DeviceState a = rig.pose_at(handle);
    const Vec3d carried = rotate(Quat{}, rig.tool.pivot.axis);
    const DeviceState b = rig.pose_at(handle, from_rotation_vector(0.7 * carried));
    const Vec3d turn = rotation_vector(a.orientation, b.orientation);
    EXPECT_NEAR((turn - 0.7 * rotate(a.orientation, rig.tool.pivot.axis)).norm(), 0, 1e-12);
}

// Virtual work: for any small motion of the device, the work of the device's force equals that of the tool's
// force and torque, by finite differences of place_tool.
TEST(HapticManipulator, ForcesDoTheSameWorkOnBothSides) {
    std::mt19937_64 random(4);
    std::normal_distribution<double> normal;
    const auto any = [&](double size) { return Vec3d(size * Vec3d(normal(random), normal(random), normal(random))); };
    for (const PivotKind kind : {PivotKind::kNone, PivotKind::kHandle, PivotKind::kTip}) {
        for (int k = 0; k < 50; ++k) {
            PivotRig rig(kind);
            rig.tool.workspace = {any(0.02), from_rotation_vector(any(1)), 1.7, 0};
            const Vec3d wanted = rig.tool.pivot.point + Vec3d(0, 0, kind == PivotKind::kTip ? -0.15 : 0.15) + any(0.03);
            const Vec3d x = rotate_back(rig.tool.workspace.turn, wanted - rig.tool.workspace.origin) / 1.7;
            const Quat turn = from_rotation_vector(any(0.3));
            const DeviceState placed = rig.pose_at(x, turn);
            DeviceCommand command;
            command.force = any(1);
            const Vec3d shaft = rotate(placed.orientation, rig.tool.pivot.axis);
            // across the shaft: roll that a pivot's motion causes is borne by the hand
            command.torque = kind == PivotKind::kNone ? Vec3d(Vec3d::Zero()) : Vec3d(any(0.1));
            command.torque -= command.torque.dot(shaft) * shaft;
            command.at = placed.position;
            const DeviceCommand told = command_for_device(rig.tool, placed, rig.clutch, command);
            const Vec3d step = any(1).normalized();
            const double h = 1e-6;
            const DeviceState a = rig.pose_at(x - h * step, turn), b = rig.pose_at(x + h * step, turn);
            const double work =
                command.force.dot(b.position - a.position) + command.torque.dot(rotation_vector(a.orientation, b.orientation));
            EXPECT_NEAR(told.force.dot(2 * h * step), work, 1e-9 * 2 * h * 10) << static_cast<int>(kind);
            EXPECT_NEAR((told.at - x).norm(), 0, 1e-12);
            // the velocity is that of the motion
            DeviceState moving = device_at(x, turn);
            moving.velocity = step;
            ClutchState fresh;
            EXPECT_NEAR((place_tool(rig.tool, moving, fresh).velocity - (b.position - a.position) / (2 * h)).norm(), 0, 1e-6);
        }
    }
}

// ---- events ----

struct ToolRig {
    HapticParams params;
    LocalContactModel model = reference::make_patch(reference::make_plane());
    HandTool tool;
    std::vector<HapticEffect> effects;
    HapticScratch scratch;
    ToolState state;
    uint64_t tick = 0;
    ToolRig() {
        params.model_timeout = params.device_timeout = 1e9;
        tool.tip_radius = 3e-3;
        tool.friction = 0;
    }
    void at(const Vec3d& position, uint32_t buttons = 0) {
        DeviceState sample = device_at(position, {}, buttons);
        sample.time = 1e-3 * static_cast<double>(tick);
        tick_tool(params, model, sample.time, tool, effects, sample, scratch, state);
        ++tick;
    }
    void go(const Vec3d& from, const Vec3d& to, int ticks) {
        for (int k = 0; k <= ticks; ++k) at(from + (to - from) * (double(k) / ticks));
    }
    uint32_t count(HapticEventKind kind) const { return state.events.count[static_cast<size_t>(kind)]; }
};

TEST(HapticEvents, TouchReleaseButtonsAndLimit) {
    ToolRig rig;
    rig.tool.max_force = 2;
    rig.go({0, 0, 0.01}, {0, 0, -0.004}, 100);
    EXPECT_EQ(rig.count(HapticEventKind::kTouch), 1u);
    EXPECT_EQ(rig.count(HapticEventKind::kRelease), 0u);
    rig.go({0, 0, -0.004}, {0, 0, 0.01}, 100);
    EXPECT_EQ(rig.count(HapticEventKind::kRelease), 1u);
    rig.at({0, 0, 0.01}, 3);
    rig.at({0, 0, 0.01}, 3);
    rig.at({0, 0, 0.01}, 1);
    EXPECT_EQ(rig.count(HapticEventKind::kButtonDown), 1u);
    EXPECT_EQ(rig.count(HapticEventKind::kButtonUp), 1u);
    ASSERT_EQ(rig.state.events.total, 4u);
    EXPECT_EQ(rig.state.events.last[2].value, 3u);
    EXPECT_EQ(rig.state.events.last[3].value, 2u);
    EXPECT_LT(rig.state.events.last[0].time, rig.state.events.last[1].time);
    HapticEffect pull;
    pull.force = 5;
    rig.effects = {pull};
    rig.go({0, 0, 0.01}, {0, 0, 0.01}, 20);
    EXPECT_EQ(rig.count(HapticEventKind::kLimit), 1u);
    EXPECT_NEAR(rig.state.output.force.norm(), 2, 1e-9);
}

// Pressed beyond the limit of the surface, the tool passes through: no force on the far side, and contact
// again outside.
TEST(HapticEvents, PassThroughASurfaceThatGivesIn) {
    ToolRig rig;
    rig.tool.pass_through = 1.5;
    rig.go({0, 0, 0.01}, {0, 0, 0.0006}, 100);  // 1.2 N
    EXPECT_EQ(rig.count(HapticEventKind::kPassThrough), 0u);
    EXPECT_GT(rig.state.output.force.z(), 1.1);
    rig.go({0, 0, 0.0006}, {0, 0, -0.008}, 100);
    EXPECT_EQ(rig.count(HapticEventKind::kPassThrough), 1u);
    EXPECT_EQ(rig.state.output.force.norm(), 0);
}

TEST(HapticEvents, EffectsReachTheDeviceWithinItsLimits) {
    ToolRig rig;
    HapticEffect spring = effect(EffectKind::kSpringPoint);
    spring.stiffness = 100;
    spring.point = {0.01, 0, 0.05};
    rig.effects = {spring};
    rig.go({0, 0, 0.05}, {0, 0, 0.05}, 200);
    EXPECT_NEAR((rig.state.output.force - Vec3d(1, 0, 0)).norm(), 0, 1e-12);
    EXPECT_EQ(rig.state.command.force.norm(), 0);  // contact force only
    EXPECT_NEAR(rig.state.output.stiffness[0], 100, 1e-9);
    spring.stiffness = 1e4;
    rig.effects = {spring};
    rig.go({0, 0, 0.05}, {0, 0, 0.05}, 200);
    EXPECT_NEAR(rig.state.output.force.norm(), rig.tool.max_force, 1e-9);
    EXPECT_NEAR(rig.state.output.force.normalized().x(), 1, 1e-12);
}

}  // namespace
}  // namespace trocar
