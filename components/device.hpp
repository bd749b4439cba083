#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// What a hand device reports.
struct DeviceState {
    double time = 0;                 // s
    Vec3d position = Vec3d::Zero();  // m, world (after the workspace transform)
    Quat orientation;
    Vec3d velocity = Vec3d::Zero();  // m/s
    uint32_t buttons = 0;            // one bit each
    double grip = 0;                 // rad, between the jaws; 0 = closed, or the device has none
    TROCAR_FIELDS(time, "s", position, "m", orientation, velocity, "m/s", buttons, grip, "rad");
};

// Samples of the devices at every millisecond of a pass, both ends included: element t * per_tool + k is
// tool t at millisecond k.
struct DeviceSamples {
    uint32_t per_tool = 0;
    std::vector<DeviceState> intended;  // where the hands aim; empty in live runs
    std::vector<DeviceState> placed;    // actual samples, moved by forces and workspaces
    TROCAR_FIELDS(per_tool, intended, placed);
    const DeviceState& start(size_t tool) const { return placed[tool * per_tool]; }
    const DeviceState& end(size_t tool) const { return placed[tool * per_tool + per_tool - 1]; }
};

// Recorded samples of a device, in ascending time. Constant after load.
struct DeviceTrace {
    std::vector<DeviceState> sample;
    TROCAR_FIELDS(sample);
};

// What the device is commanded: a force field around a point, force(x) = force - stiffness * (x - at), so
// that a device with a faster loop of its own may follow the hand between two commands.
struct DeviceCommand {
    Vec3d force = Vec3d::Zero();        // N, on the hand, when it is at `at`
    Vec3d torque = Vec3d::Zero();       // N m, on the hand, about the tip
    Vec3d at = Vec3d::Zero();           // m
    std::array<double, 9> stiffness{};  // N/m, row-major, symmetric, positive semidefinite
    TROCAR_FIELDS(force, "N", torque, "N m", at, "m", stiffness, "N/m");
};

// What a device must never be commanded beyond. Vectors are scaled, so their direction is kept.
struct DeviceLimits {
    double torque = 0.2;             // N m; the largest force is HandTool::max_force
    double force_slew = 0;           // N/s; 0 = from none to the largest force in 3 ms
    double torque_slew = 0;          // N m/s; 0 = the same
    double dissipation = 10;         // N s/m, largest damping that takes back the energy which sampling generated; 0 = none
    double turn_dissipation = 0.01;  // N m s/rad, the same for rotation
    double surface_age = 0;          // s, an older surface is not trusted: force falls to zero; 0 = HapticParams::model_timeout
    TROCAR_FIELDS(torque, "N m", force_slew, "N/s", torque_slew, "N m/s", dissipation, "N s/m", turn_dissipation, "N m s/rad", surface_age,
                  "s");
};

// Maps the space that a hand reaches into the world: world = origin + turn (scale * device).
struct Workspace {
    Vec3d origin = Vec3d::Zero();  // m
    Quat turn;
    double scale = 1;
    uint32_t clutch = 0;  // buttons (bits): while one is held the tool stays and only the hand moves; 0 = none
    TROCAR_FIELDS(origin, "m", turn, scale, clutch);
};

// Instrument through a point of the body wall: two angles, insertion and roll are free.
enum class PivotKind : uint8_t {
    kNone,
    kHandle,  // the device is the handle outside: the tip moves in the opposite direction, scaled by the lever
    kTip,     // the device is the tip inside: it moves as the hand does
};
struct Pivot {
    PivotKind kind = PivotKind::kNone;
    Vec3d point = Vec3d::Zero();  // m, world
    double length = 0.33;         // m, kHandle: from the device to the tip
    Vec3d axis{0, 0, -1};         // unit, in the frame of the device: from handle to tip
    TROCAR_FIELDS(kind, point, "m", length, "m", axis);
};

}  // namespace trocar
