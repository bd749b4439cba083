#pragma once
#include <array>
#include <vector>

#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

// What a hand device reports.
struct DeviceState {
    double time = 0;                       // s
    Vec3d position = Vec3d::Zero();        // m, world (after the workspace transform)
    Quat orientation;
    Vec3d velocity = Vec3d::Zero();        // m/s
    uint32_t buttons = 0;
};

// What it is told to do.
struct DeviceCommand {
    Vec3d force = Vec3d::Zero();  // N, on the hand
};

// A tool held by a device. Constant after load.
struct HandTool {
    uint32_t body = kNone;
    Vec3d tip = Vec3d::Zero();       // m, centre of the tip sphere in the body frame
    double tip_radius = 0;           // m
    double coupling_stiffness = 500; // N/m
    double coupling_damping = 5;     // N s/m
    double max_force = 3.3;          // N, of the device
    double friction = 0.1;
    uint32_t path = kNone;           // row of Paths: the scripted hand
};

// Surface within reach of a tool, frozen at one contact pass. Immutable once published; the tick reads nothing else.
struct LocalContactModel {
    double time = 0;                     // s, of the positions
    std::vector<Vec3d> position;         // m, world
    std::vector<Vec3d> velocity;         // m/s
    std::vector<Triangle> triangle;
    std::vector<std::array<uint32_t, 3>> neighbour;  // kNone where the patch ends
};

// State of one tool's force rendering between ticks.
struct ToolState {
    DeviceState device;
    Vec3d proxy = Vec3d::Zero();        // m, world: centre of the tip sphere, kept outside the surface
    bool proxy_valid = false;
    uint32_t contacts = 0;              // surface constraints active on the proxy
    DeviceCommand command;
    Vec3d coupling_force = Vec3d::Zero();  // N, of the coupling on the simulated tool, last substep
    Vec3d contact_impulse = Vec3d::Zero(); // N s, of the tissue on the simulated tool, summed over the period
};

struct Haptics {
    std::vector<HandTool> tool;      // constant
    std::vector<ToolState> state;    // one per tool
    uint64_t ticks = 0;
    double max_force = 0;            // N, largest commanded
    uint64_t rejected_samples = 0;   // device samples refused (not finite, jump)
};

}  // namespace trocar
