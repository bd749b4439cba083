#pragma once
#include <vector>

#include "components/device.hpp"
#include "components/fields.hpp"
#include "components/hand_model.hpp"
#include "components/math.hpp"
namespace trocar {

inline constexpr size_t kMaxTools = 8;

// Point of an instrument's surface that is tested against other surfaces.
struct ShellPoint {
    Vec3d arm = Vec3d::Zero();     // m, from the tip, axes of the body
    Vec3d inward = Vec3d::Zero();  // unit, into the instrument, axes of the body
    uint32_t jaw = kNone;          // index into HandTool::shell_jaw: then arm is from the jaw's pivot, and both vectors in axes of the jaw
    TROCAR_FIELDS(arm, "m", inward, jaw);
};

// A body that rotates about an axis of an instrument as the device's grip opens. Constant after load.
struct ToolJaw {
    uint32_t body = kNone;
    Vec3d pivot = Vec3d::Zero();  // m, frame of the instrument: origin of the jaw
    Quat closed;                  // jaw frame to that of the instrument, at grip 0
    Vec3d axis{1, 0, 0};          // unit, frame of the instrument
    double share = 0.5;           // fraction of the grip angle that it rotates by, counter-clockwise about the axis; negative: clockwise
    TROCAR_FIELDS(body, "index of bodies", pivot, "m", closed, axis, share);
};

// A tool held by a device. Constant after load.
struct HandTool {
    uint32_t body = kNone;
    Vec3d tip = Vec3d::Zero();        // m, centre of the tip sphere in the body frame
    double tip_radius = 0;            // m
    double coupling_stiffness = 500;  // N/m
    double coupling_damping = 5;      // N s/m
    double max_force = 3.3;           // N, of the device
    double friction = 0.1;
    uint32_t path = kNone;    // index into Paths: the scripted hand
    uint32_t trace = kNone;   // index into Haptics::trace: the recorded hand
    double pass_through = 0;  // N, a stronger press passes through the surface; 0 = never
    HandModel hand;           // of a scripted hand that yields to forces
    Workspace workspace;
    Pivot pivot;
    DeviceLimits limits;
    Range effects;           // range of Haptics::effect
    Range jaws;              // range of Haptics::jaw
    double grip_closed = 0;  // rad, a grip below this counts as the first button pressed
    // The remaining members apply to tools with a point shell over the whole instrument (dof = 6); tools with
    // a sphere at the tip have none.
    std::vector<ShellPoint> point_shell;  // neighbours in space are close in the array
    double shell_radius = 0;              // m, of the farthest point of the shell
    double turn_stiffness = 0;            // N m/rad, of the coupling
    double turn_damping = 0;              // N m s/rad
    double inertia = 0;                   // kg m^2, about the tip, isotropic, of what the simulated coupling rotates
    double surface_stiffness = 0;         // N/m, of a point of the shell against a surface
    std::vector<ToolJaw> shell_jaw;       // its jaws, as in Haptics::jaw
    TROCAR_FIELDS(body, "index of bodies", tip, "m", tip_radius, "m", coupling_stiffness, "N/m", coupling_damping, "N s/m", max_force, "N",
                  friction, path, "index of paths or none", trace, "index of traces or none", pass_through, "N", hand, workspace, pivot,
                  limits, effects, "range of effects", jaws, "range of jaws", grip_closed, "rad", point_shell, shell_radius, "m",
                  turn_stiffness, "N m/rad", turn_damping, "N m s/rad", inertia, "kg m^2", surface_stiffness, "N/m", shell_jaw);
};

// How forces are rendered; the same for all tools.
struct HapticParams {
    double dt = 1e-3;              // s, period of the tick
    double tool_speed = 0.5;       // m/s, a model covers the distance travelled at this speed (or 1.5 x the present one) ...
    double greatest_age = 35e-3;   // s, ... in this time ...
    double reach_margin = 5e-3;    // m, ... plus this
    double device_speed = 2;       // m/s, a sample farther from the last accepted one than this speed and ...
    double device_slack = 5e-3;    // m, ... this slack allow is refused; so is a velocity that implies it
    double motion_filter = 8e-3;   // s, filter time over which a device's velocity is estimated from its positions
    double model_timeout = 0.1;    // s, an older model is not trusted: the force falls to zero
    double device_timeout = 8e-3;  // s, the same for an older sample
    double fall_time = 5e-3;       // s, from full force to none on a timeout
    double silence = 0.02;         // s, after a longer pause between ticks the force returns over rise_time
    double rise_time = 0.05;       // s, to return to full force after trouble
    double force_slew = 200;       // N/s, change of force beyond what the motion of the device explains
};

}  // namespace trocar
