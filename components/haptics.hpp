#pragma once
#include <array>
#include <vector>

#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

inline constexpr size_t kMaxTools = 8;

// What a hand device reports.
struct DeviceState {
    double time = 0;                 // s
    Vec3d position = Vec3d::Zero();  // m, world (after the workspace transform)
    Quat orientation;
    Vec3d velocity = Vec3d::Zero();  // m/s
    uint32_t buttons = 0;
};

// What a device reported before, in ascending time. Constant after load.
struct DeviceTrace {
    std::vector<DeviceState> sample;
};

// What it is told to do.
struct DeviceCommand {
    Vec3d force = Vec3d::Zero();  // N, on the hand
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
    uint32_t path = kNone;   // row of Paths: the scripted hand
    uint32_t trace = kNone;  // row of Haptics::trace: the recorded hand
};

// How forces are rendered; the same for all tools.
struct HapticParams {
    double dt = 1e-3;              // s, period of the tick
    double tool_speed = 0.5;       // m/s, a model reaches as far as this speed (or 1.5 x the present one) goes ...
    double greatest_age = 35e-3;   // s, ... in this time ...
    double reach_margin = 5e-3;    // m, ... and this much farther
    double device_speed = 2;       // m/s, a sample farther from the last good one than this and ...
    double device_slack = 5e-3;    // m, ... this allow is refused
    double model_timeout = 0.1;    // s, an older model is not trusted: force falls to zero
    double device_timeout = 0.01;  // s, the same for an older sample
    double fall_time = 0.01;       // s, from full force to none on a timeout
    double rise_time = 0.05;       // s, back to full force after trouble
    double force_slew = 200;       // N/s, change of force beyond what the motion of the device explains
};

// Triangles of a local contact model that lie together, and a ball around them.
struct TriangleGroup {
    Range triangles;                 // rows of triangle
    Vec3d centre = Vec3d::Zero();    // m, world, at the time of the model
    double radius = 0;               // m
    Vec3d velocity = Vec3d::Zero();  // m/s, mean of the corners
    double spread = 0;               // m/s, no corner's velocity differs from the mean by more
};

// How a pressed surface goes with the device that presses it, until the next contact pass says where it is.
struct SurfaceGive {
    uint32_t body = kNone;                    // whose surface; kNone: none goes along
    double share = 0;                         // of the device's way along the normal, 0..1
    Vec3d normal = Vec3d::Zero();             // unit
    Vec3d device = Vec3d::Zero();             // m, where the device was
    Vec3d device_velocity = Vec3d::Zero();    // m/s, how it moved
};

// Surface within reach of a tool, frozen at one contact pass. Immutable once published; the tick reads nothing else.
struct LocalContactModel {
    double time = 0;              // s, of the positions
    uint64_t sequence = 0;        // contact pass that made it, from 1; 0 = none did
    Vec3d from = Vec3d::Zero();   // m, world: every surface nearer than reach to the segment from -> to is here
    Vec3d to = Vec3d::Zero();     // m
    double reach = 0;             // m, from the segment; 0 = nothing was looked at yet
    double fastest = 0;           // m/s, of its vertices
    SurfaceGive give;
    std::vector<Vec3d> position;  // m, world
    std::vector<Vec3d> velocity;  // m/s
    std::vector<Triangle> triangle;
    std::vector<std::array<uint32_t, 3>> neighbour;  // kNone where the patch ends
    std::vector<uint32_t> body;                      // per triangle
    std::vector<TriangleGroup> group;                // all triangles in runs of neighbours in memory
    std::vector<double>
        half_thickness;  // m, per triangle; > 0: a sheet, it stops the tool on both sides; 0: of a closed body
};

// What a contact pass found of one tool, for the next one to compare with.
struct ToolPass {
    uint32_t touched = kNone;            // body
    Vec3d tip = Vec3d::Zero();           // m, world, of the simulated tool
    Vec3d device = Vec3d::Zero();        // m
};

// State of one tool's force rendering between ticks.
struct ToolState {
    DeviceState device;
    Vec3d proxy = Vec3d::Zero();  // m, world: centre of the tip sphere, kept outside the surface
    bool proxy_valid = false;     // false until the sphere is seen clear of every surface: no force
    uint32_t contacts = 0;        // surface constraints active on the proxy
    uint32_t touched = kNone;     // body whose surface holds the proxy; kNone without contacts
    DeviceCommand command;
    bool device_valid = false;  // `device` is a sample that was accepted
    double time = 0;            // s, of the last tick
    uint64_t ticks = 0;
    double model_age = 0;                   // s, of the surface under the force at the last tick
    double gain = 1;                        // share of the force let through, 0..1: timeouts and recovery
    double largest_force = 0;               // N, commanded so far
    uint64_t rejected_samples = 0;          // refused: not finite, out of order, farther than a hand can move
    Vec3d coupling_force = Vec3d::Zero();   // N, of the coupling on the simulated tool, last substep
    Vec3d contact_impulse = Vec3d::Zero();  // N s, of the tissue on the simulated tool, summed over the period
    ToolPass last_pass;                     // of the simulation, not of the tick
};

struct Haptics {
    std::vector<HandTool> tool;      // constant
    std::vector<DeviceTrace> trace;  // constant
    std::vector<ToolState> state;    // one per tool
    uint64_t ticks = 0;
    double max_force = 0;           // N, largest commanded
    uint64_t rejected_samples = 0;  // device samples refused (not finite, jump)
};

}  // namespace trocar
