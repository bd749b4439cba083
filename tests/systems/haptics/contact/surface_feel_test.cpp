// Surfaces with haptic properties of their own: stiffness, damping, two friction coefficients, textures;
// against closed forms.
#include "systems/haptics/contact/surface_feel.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "engine/geometry/quaternion.hpp"
#include "systems/haptics/tool.hpp"
#include "tests/reference/haptic_rig.hpp"
#include "tests/reference/local_patches.hpp"
#include "tests/reference/shell_rig.hpp"
namespace trocar {
namespace {

using namespace reference;
constexpr double kStiffness = 600;  // N/m, of the tool
constexpr double kDepth = 2e-3;     // m

// A plane with the properties `surface`, and whole ticks on it without active limits.
struct SurfaceRig {
    HapticRig rig = still_rig(make_patch(make_plane(20)));
    HandTool& tool = rig.tool;
    ToolState& state = rig.state;

    explicit SurfaceRig(HapticSurface surface) {
        surface.body = 0;
        rig.model.surface.push_back(surface);
        tool.coupling_stiffness = kStiffness;
        tool.limits.force_slew = 1e9;
        tool.limits.dissipation = 0;
        at({0, 0, 0.01});
        for (int k = 0; k < 100; ++k) at({0, 0, kRigRadius + 1e-4});  // full gain
    }
    // N, commanded to the device
    Vec3d at(const Vec3d& position, const Vec3d& velocity = Vec3d::Zero()) {
        DeviceState sample;
        sample.time = rig.time();
        sample.position = position;
        sample.velocity = velocity;
        tick_tool(rig.params, rig.model, rig.time(), tool, {}, sample, rig.scratch, state);
        ++rig.tick;
        return state.output.force;
    }
    Vec3d press(double x, double depth) { return at({x, 0, kRigRadius - depth}); }
    Vec3d rest(double x, double depth) {
        for (int k = 0; k < 20; ++k) press(x, depth);
        return press(x, depth);
    }
    // in steps too small for the ramp of new contacts
    void go(double x, double from, double to) {
        for (int k = 1; k <= 100; ++k) press(x, from + (to - from) * k / 100);
    }
};

// 600 and 300 N/m in series are 200; the device's own loop gets that stiffness. Breaks when either is used
// alone.
TEST(HapticSurface, StiffnessIsInARowWithTheCoupling) {
    HapticSurface s;
    s.stiffness = 300;
    SurfaceRig rig(s);
    rig.go(0, 0, kDepth);
    EXPECT_NEAR(rig.rest(0, kDepth).z(), 200 * kDepth, 1e-9);
    EXPECT_NEAR(rig.state.output.stiffness[8], 200, 1e-9);
    // another body's properties do not apply
    rig.rig.model.surface[0].body = 7;
    EXPECT_NEAR(rig.rest(0, kDepth).z(), 600 * kDepth, 1e-9);
}

// Drags a tip on a surface with friction 0.5 and 0.2 along by 400 steps: the tangential force grows with the
// given stiffness (N/m) up to 0.5 of the normal force, breaks away, and stays at 0.2 of it while sliding.
template <typename Rig>
void drag_from_rest(Rig& rig, double stiffness, double step) {
    const double press = stiffness * kDepth;
    double most = 0;
    int slid = 0;
    for (int k = 1; k <= 400; ++k) {
        const Vec3d f = rig.press(step * k, kDepth);
        EXPECT_NEAR(f.z(), press, 1e-6);
        most = std::max(most, -f.x());
        if (step * k < 0.5 * kDepth - 1e-9) {
            ASSERT_NEAR(f.x(), -stiffness * step * k, 1e-6) << k;
            EXPECT_FALSE(rig.state.sliding) << k;
        }
        if (step * k < 0.5 * kDepth + 20 * step) continue;
        ASSERT_NEAR(f.x(), -0.2 * press, 1e-6) << k;
        EXPECT_TRUE(rig.state.sliding) << k;
        ++slid;
    }
    EXPECT_NEAR(most, 0.5 * press, stiffness * step);
    EXPECT_GT(slid, 250);
}

// Dragged at 10 mm/s it slides with one coefficient; at rest it sticks again, up to 0.5 in the opposite
// direction. Breaks when one coefficient is used for both.
TEST(HapticSurface, SticksByOneCoefficientAndSlidesByTheOther) {
    HapticSurface s;
    s.static_friction = 0.5, s.dynamic_friction = 0.2;
    SurfaceRig rig(s);
    rig.go(0, 0, kDepth);
    const double press = kStiffness * kDepth, step = 1e-5;
    drag_from_rest(rig, kStiffness, step);
    rig.rest(400 * step, kDepth);
    EXPECT_FALSE(rig.state.sliding);
    const double stuck = rig.state.proxy.x();
    double least = 0;
    for (int k = 1; k <= 300; ++k) {
        const double x = 400 * step - step * k;
        const Vec3d f = rig.press(x, kDepth);
        least = std::max(least, f.x());
        if (stuck - x < 0.5 * kDepth - 1e-9) {
            ASSERT_NEAR(f.x(), kStiffness * (stuck - x), 1e-6) << k;
        }
    }
    EXPECT_NEAR(least, 0.5 * press, kStiffness * step);
    // below 1 mm/s it does not slide: the static coefficient applies throughout
    SurfaceRig slow(s);
    slow.go(0, 0, kDepth);
    for (int k = 1; k <= 3000; ++k) slow.press(5e-7 * k, kDepth);
    EXPECT_NEAR(slow.state.output.force.x(), -0.5 * press, 1e-6);
}

// In and out at one speed v: damping dissipates 2 (b v (D - d) + k d^2 / 2), d = b v / k, because it never
// exceeds the spring. The observer finds no generated energy. Breaks when the surface's damping is omitted or
// acts only while pressing.
TEST(HapticSurface, DampingTakesWhatItsFormulaSays) {
    HapticSurface s;
    s.damping = 4;
    SurfaceRig rig(s);
    rig.tool.coupling_damping = 2;
    const double v = 0.02, displacement = v * kRigTick, b = 6, d = b * v / kStiffness;
    double work = 0, deepest = 0;
    Vec3d before = rig.at({0, 0, kRigRadius}, {0, 0, -v});
    const auto go = [&](double depth, double speed) {
        const Vec3d f = rig.at({0, 0, kRigRadius - depth}, {0, 0, -speed});
        work += 0.5 * (before.z() + f.z()) * speed * kRigTick;
        before = f;
        deepest = std::max(deepest, depth);
    };
    for (int k = 1; k <= 200; ++k) go(k * displacement, v);
    before = rig.at({0, 0, kRigRadius - 200 * displacement}, {0, 0, v});  // reverses
    for (int k = 199; k >= 0; --k) go(k * displacement, -v);
    const double taken = 2 * (b * v * (deepest - d) + 0.5 * kStiffness * d * d);
    EXPECT_NEAR(work, taken, 0.01 * taken);
    EXPECT_GT(rig.state.safety.lowest_energy, -1e-6);
}

// Over a grating of amplitude H the force is k (D + h D / (D + H)) up and -k (D - H ln(1 + D / H)) h' along,
// h = H sin(2 pi x / L) at the tip. Breaks when height or slope is taken at another point or the depth is
// omitted.
TEST(HapticSurface, AGratingIsFeltAsItsFormula) {
    HapticSurface s;
    s.texture = TextureKind::kGrating, s.height = 2e-4, s.length = 5e-3;
    SurfaceRig rig(s);
    rig.go(0, 0, kDepth);
    double least = 10, most = 0;
    for (int k = 1; k <= 1200; ++k) {
        const double x = 1e-5 * k, phase = 2 * std::numbers::pi * x / s.length, h = s.height * std::sin(phase);
        const double slope = s.height * 2 * std::numbers::pi / s.length * std::cos(phase);
        const Vec3d f = rig.press(x, kDepth);
        ASSERT_NEAR(f.z(), kStiffness * (kDepth + h * kDepth / (kDepth + s.height)), 1e-7) << x;
        ASSERT_NEAR(f.x(), -kStiffness * (kDepth - s.height * std::log(1 + kDepth / s.height)) * slope, 1e-7) << x;
        least = std::min(least, f.z()), most = std::max(most, f.z());
    }
    EXPECT_NEAR(most - least, 2 * kStiffness * s.height * kDepth / (kDepth + s.height), 1e-4);
}

// Pressed in on a hill, drawn into the valley, released and moved back above: the work over the cycle is
// zero. Without the force along the surface every cycle would generate 0.3 mJ.
TEST(HapticSurface, ATextureAloneGivesNoEnergy) {
    HapticSurface s;
    s.texture = TextureKind::kGrating, s.height = 5e-4, s.length = 5e-3;
    SurfaceRig rig(s);
    double work = 0, one_leg = 0;
    Vec3d at(1.25e-3, 0, kRigRadius), before = rig.at(at);
    const auto to = [&](double x, double depth) {
        const Vec3d from = at, target(x, 0, kRigRadius - depth);
        for (int k = 1; k <= 400; ++k) {
            const Vec3d next = from + (target - from) * (k / 400.0);
            const Vec3d f = rig.at(next);
            work -= 0.5 * (before + f).dot(next - at);
            before = f, at = next;
        }
    };
    to(1.25e-3, kDepth);
    one_leg = work;
    to(3.75e-3, kDepth);
    to(3.75e-3, 0);
    EXPECT_GT(one_leg, 1e-3);
    EXPECT_NEAR(work, 0, 2e-5);
    EXPECT_GT(rig.state.safety.lowest_energy, -5e-5);
}

// Noise: bounded by its height, continuous, with the gradient it reports, unchanged at the same point of a
// body that moved, and varying over the surface.
TEST(HapticSurface, NoiseIsBoundedSmoothAndGoesWithTheBody) {
    HapticSurface s;
    s.texture = TextureKind::kNoise, s.height = 1e-3, s.length = 2e-3;
    double least = 1, most = -1;
    for (int i = 0; i < 4000; ++i) {
        const Vec3d p(1.3e-5 * i - 0.02, 0.7e-5 * i, -1.1e-5 * i + 0.01);
        const TextureHeight h = texture_height(s, p);
        least = std::min(least, h.height), most = std::max(most, h.height);
        EXPECT_LE(std::abs(h.height), s.height);
        for (int k = 0; k < 3; ++k) {
            const Vec3d step = 1e-8 * Vec3d::Unit(k);
            EXPECT_NEAR((texture_height(s, p + step).height - texture_height(s, p - step).height) / 2e-8, h.slope[k], 1e-4);
        }
    }
    EXPECT_LT(least, -0.5e-3);
    EXPECT_GT(most, 0.5e-3);
    // at a later `age`, or with a body that moved along
    HapticSurface moving = s;
    moving.origin = {0.3, -0.2, 0.1}, moving.orientation = from_rotation_vector({0.3, 0.2, -0.1});
    moving.velocity = {0.1, 0, 0.2}, moving.spin = {0, 2, 1};
    HapticSurface moved = moving;
    const double age = 0.01;
    moved.origin += age * moving.velocity, moved.orientation = multiply(from_rotation_vector(age * moving.spin), moving.orientation);
    moved.velocity = moved.spin = Vec3d::Zero();
    ToolState state, along;
    state.proxy = {0.31, -0.2, 0.1}, state.device.position = {0.31, -0.2, 0.099};
    const Vec3d force(0, 0, 0.6);
    EXPECT_NEAR((textured_force(moving, age, kStiffness, state, force) - textured_force(moved, 0, kStiffness, state, force)).norm(), 0,
                1e-12);
    EXPECT_GT((textured_force(moving, 0, kStiffness, state, force) - textured_force(moved, 0, kStiffness, state, force)).norm(), 1e-3);
    // tissue moves its texture along with the proxy
    s.deformable = true;
    along = state;
    along.carried = {1e-3, -2e-3, 5e-4};
    along.proxy += along.carried, along.device.position += along.carried;
    EXPECT_NEAR((textured_force(s, age, kStiffness, along, force) - textured_force(s, 0, kStiffness, state, force)).norm(), 0, 1e-12);
}

// ---- tools with a point shell ----

// Whole ticks of a shell on a plane with the properties `surface`.
struct ShellSurfaceRig {
    ShellRig rig;
    HapticScratch scratch;
    ToolState& state = rig.state;
    double series = 0;  // N/m, of coupling and surface springs

    ShellSurfaceRig(HapticSurface surface, const std::vector<Vec3d>& arms) : rig(make_joined_patch(make_plane(10, 0.1)), points(arms)) {
        surface.body = 0;
        rig.model.surface.push_back(surface);
        rig.tool.coupling_stiffness = kStiffness;
        rig.tool.limits.force_slew = rig.tool.limits.torque_slew = rig.tool.limits.torque = 1e9;
        rig.tool.limits.dissipation = rig.tool.limits.turn_dissipation = 0;
        series = 1 / (1 / kStiffness + 1 / (static_cast<double>(arms.size()) * rig.tool.surface_stiffness));
        at({0, 0, 0.005});
        for (int k = 0; k < 100; ++k) at({0, 0, 1e-4});
    }
    static std::vector<ShellPoint> points(const std::vector<Vec3d>& arms) {
        std::vector<ShellPoint> point_shell;
        for (const Vec3d& arm : arms) point_shell.push_back({arm, Vec3d(0, 0, 1)});
        return point_shell;
    }
    Vec3d at(const Vec3d& position, const Vec3d& velocity = Vec3d::Zero()) {
        DeviceState sample;
        sample.time = rig.time();
        sample.position = position;
        sample.velocity = velocity;
        if (!state.device_valid) state.device = sample;
        if (rig.tick % 16 == 0) rig.publish();
        tick_tool(rig.params, rig.model, rig.time(), rig.tool, {}, sample, scratch, state);
        ++rig.tick;
        return state.output.force;
    }
    Vec3d press(double x, double depth) { return at({x, 0, -depth}); }
    Vec3d rest(double x, double depth) {
        for (int k = 0; k < 20; ++k) press(x, depth);
        return press(x, depth);
    }
    void go(double x, double from, double to) {
        for (int k = 1; k <= 100; ++k) press(x, from + (to - from) * k / 100);
    }
};

const std::vector<Vec3d> kOnePoint = {Vec3d::Zero()},
                         kFourPoints = {{-0.01, -0.01, 0}, {0.01, -0.01, 0}, {-0.01, 0.01, 0}, {0.01, 0.01, 0}};

// Coupling, body and surface springs in series, for any number of contact points; only if the body has its
// own stiffness. Breaks when the body's stiffness is omitted or counted for every point.
TEST(HapticSurface, AShellFeelsItInARowWithItsCoupling) {
    HapticSurface s;
    s.stiffness = 300;
    for (const auto& arms : {kOnePoint, kFourPoints}) {
        ShellSurfaceRig rig(s, arms);
        rig.go(0, 0, kDepth);
        const double row = 1 / (1 / rig.series + 1 / s.stiffness);
        EXPECT_NEAR(rig.rest(0, kDepth).z(), row * kDepth, 1e-9);
        EXPECT_LT(rig.state.output.torque.norm(), 1e-12);
        EXPECT_NEAR(rig.state.output.stiffness[8], 200, 1e-9);
        rig.rig.model.surface[0].body = 7;
        EXPECT_NEAR(rig.rest(0, kDepth).z(), rig.series * kDepth, 1e-9);
    }
}

// As with a tip: the tangential force grows with the springs in series up to 0.5 of the normal force, breaks
// away and stays at 0.2 of it.
TEST(HapticSurface, AShellSticksByOneCoefficientAndSlidesByTheOther) {
    HapticSurface s;
    s.static_friction = 0.5, s.dynamic_friction = 0.2;
    ShellSurfaceRig rig(s, kOnePoint);
    rig.go(0, 0, kDepth);
    rig.rest(0, kDepth);
    const double press = rig.series * kDepth, step = 1e-5;
    drag_from_rest(rig, rig.series, step);
    rig.rest(400 * step, kDepth);
    EXPECT_FALSE(rig.state.sliding);
    // below 1 mm/s it does not slide
    ShellSurfaceRig slow(s, kOnePoint);
    slow.go(0, 0, kDepth);
    for (int k = 1; k <= 3000; ++k) slow.press(5e-7 * k, kDepth);
    EXPECT_NEAR(slow.state.output.force.x(), -0.5 * press, 1e-6);
}

// On an incline a vertical press slides as soon as the slope is steeper than the cone: m g sin against mu m g
// cos, here of a device that moves down into a plane of 30 degrees. 0.6 holds it, 0.5 does not.
TEST(HapticSurface, AShellHoldsOnAnInclineBelowItsFriction) {
    for (const double mu : {0.6, 0.5}) {
        HapticSurface s;
        s.static_friction = s.dynamic_friction = mu;
        ShellSurfaceRig rig(s, kOnePoint);
        // the plane is level: the press has 30 degrees to its normal
        const double tilt = 30 * std::numbers::pi / 180;
        const Vec3d displacement = kDepth * Vec3d(std::sin(tilt), 0, -std::cos(tilt));
        for (int k = 0; k <= 100; ++k) rig.at(0.01 * k * displacement);
        Vec3d f;
        for (int k = 0; k < 50; ++k) f = rig.at(displacement);
        const double normal = rig.series * kDepth * std::cos(tilt), along = rig.series * kDepth * std::sin(tilt);
        EXPECT_NEAR(f.z(), normal, 1e-6);
        EXPECT_NEAR(-f.x(), std::min(along, mu * normal), 1e-6) << mu;
        EXPECT_EQ(-f.x() < along - 1e-6, mu == 0.5);
    }
}

// In and out at one speed v: damping dissipates 2 (b v (D - d) + k d^2 / 2), d = b v / k. Breaks when it acts
// only while pressing or counts every point.
TEST(HapticSurface, AShellsDampingTakesWhatItsFormulaSays) {
    for (const auto& arms : {kOnePoint, kFourPoints}) {
        HapticSurface s;
        s.damping = 6;
        ShellSurfaceRig rig(s, arms);
        const double v = 0.02, displacement = v * kRigTick, d = s.damping * v / rig.series;
        double work = 0, deepest = 0;
        Vec3d before = rig.at({0, 0, 0}, {0, 0, -v});
        const auto go = [&](double depth, double speed) {
            const Vec3d f = rig.at({0, 0, -depth}, {0, 0, -speed});
            work += 0.5 * (before.z() + f.z()) * speed * kRigTick;
            before = f;
            deepest = std::max(deepest, depth);
        };
        for (int k = 1; k <= 200; ++k) go(k * displacement, v);
        before = rig.at({0, 0, -200 * displacement}, {0, 0, v});
        for (int k = 199; k >= 0; --k) go(k * displacement, -v);
        const double taken = 2 * (s.damping * v * (deepest - d) + 0.5 * rig.series * d * d);
        EXPECT_NEAR(work, taken, 0.01 * taken);
        EXPECT_GT(rig.state.safety.lowest_energy, -1e-6);
    }
}

// A grating is felt at the centre of the contact points, 20 mm from the tip: force by its formula there,
// torque that force times the arm in addition to the contact forces' torque. Breaks when height or slope is
// taken at the tip.
TEST(HapticSurface, AShellFeelsATextureWhereItTouches) {
    HapticSurface s;
    s.texture = TextureKind::kGrating, s.height = 2e-4, s.length = 5e-3;
    ShellSurfaceRig rig(s, {{0.02, -0.01, 0}, {0.02, 0.01, 0}});
    rig.rig.tool.turn_stiffness = 10;
    rig.go(0, 0, kDepth);
    double highest = 0;
    for (int k = 0; k <= 100; ++k) {
        const double x = 1e-4 * k;
        const Vec3d f = rig.rest(x, kDepth);
        Vec3d bare = Vec3d::Zero(), torque = Vec3d::Zero(), arm = Vec3d::Zero();
        for (const ShellContact& c : rig.state.contact) bare += c.force, torque += c.arm.cross(c.force), arm += 0.5 * c.arm;
        ASSERT_EQ(rig.state.contact.size(), 2u);
        const double phase = 2 * std::numbers::pi * (rig.state.proxy + arm).x() / s.length, H = s.height;
        const double h = H * std::sin(phase), slope = 2 * std::numbers::pi * H / s.length * std::cos(phase);
        const double D = (rig.state.proxy - rig.state.device.position).norm();
        EXPECT_NEAR(bare.z(), kStiffness * D, 1e-6);
        EXPECT_NEAR(f.z(), kStiffness * (D + h * D / (D + H)), 1e-6) << x;
        EXPECT_NEAR(f.x(), -kStiffness * (D - H * std::log1p(D / H)) * slope, 1e-6) << x;
        EXPECT_LT((rig.state.output.torque - torque - arm.cross(f - bare)).norm(), 1e-7) << x;
        highest = std::max(highest, f.z());
    }
    EXPECT_GT(highest, 1.05 * kStiffness * kDepth * 0.9);
}

}  // namespace
}  // namespace trocar
