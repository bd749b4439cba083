#pragma once
#include <array>
#include <vector>

#include "components/device.hpp"
#include "components/fields.hpp"
#include "components/hand_model.hpp"
#include "components/haptic_effect.hpp"
#include "components/math.hpp"
namespace trocar {

// State of the safety stage, the last one before the device.
struct SafetyState {
    Vec3d contact_force = Vec3d::Zero();  // N, of contact, let through at the last tick ...
    Vec3d pull = Vec3d::Zero();           // N, ... and of the virtual coupling on the body in contact with the proxy
    Vec3d from_device = Vec3d::Zero();    // m, positions of device and proxy at that time
    Vec3d from_proxy = Vec3d::Zero();
    double energy = 0;         // J, that contact took from the hand; below zero it released some
    double lowest_energy = 0;  // J
    double dissipated = 0;     // J, taken back by damping
    bool started = false;
    double gain = 1;        // fraction let through after a silence, 0..1
    bool limiting = false;  // a limit cut the last command
    uint64_t limited_ticks = 0;
    uint64_t safe_ticks = 0;  // ticks with the force held constant or falling to zero because of trouble
    // the same for rotation of a tool with a point shell, which has its own coupling
    Vec3d contact_torque = Vec3d::Zero(), pull_torque = Vec3d::Zero();  // N m
    Quat from_device_turn, from_proxy_turn;
    double turn_energy = 0;         // J
    double lowest_turn_energy = 0;  // J
    TROCAR_FIELDS(contact_force, "N", from_device, "m", from_proxy, "m", energy, "J", lowest_energy, "J", dissipated, "J", started, gain,
                  limiting, limited_ticks, safe_ticks, pull, "N", pull_torque, "N m", contact_torque, "N m", from_device_turn,
                  from_proxy_turn, turn_energy, "J", lowest_turn_energy, "J");
};

struct ClutchState {
    bool started = false;
    Vec3d offset = Vec3d::Zero();  // m, world, added to the device position from the workspace
    Vec3d tool = Vec3d::Zero();    // m, world, tool position at the last tick
    TROCAR_FIELDS(started, offset, "m", tool, "m");
};

// What a contact pass found for one tool, compared by the next pass.
struct ToolPass {
    uint32_t touched = kNone;      // body
    Vec3d tip = Vec3d::Zero();     // m, world, of the simulated tool
    Vec3d device = Vec3d::Zero();  // m
    TROCAR_FIELDS(touched, "index of bodies or none", tip, "m", device, "m");
};

// Point of a shell in contact with a surface.
struct ShellContact {
    uint32_t point = 0;           // of HandTool::shell
    uint32_t body = kNone;        // body whose surface it touches
    Vec3d arm = Vec3d::Zero();    // m, world axes, from the tip
    Vec3d force = Vec3d::Zero();  // N, on the tool
    Vec3d slip = Vec3d::Zero();   // m, world, tangential stretch of the friction spring
    double depth = 0;             // m
    double side = 1;              // of a sheet, the side on which the point is: 1 = that of the normals, or -1
    bool sliding = false;         // along the surface, faster than 1 mm/s
    TROCAR_FIELDS(point, body, "index of bodies or none", arm, "m", force, "N", slip, "m", depth, "m", side, sliding);
};

// Point of a surface that the proxy of a tip touched at the last tick: it rides on it, from one local contact model to
// the next too.
struct ContactAnchor {
    uint32_t body = kNone;
    uint32_t triangle = kNone;       // of the body's mesh
    Vec3d weight = Vec3d::Zero();    // barycentric
    Vec3d position = Vec3d::Zero();  // m, world, at that tick
    double side = 0;                 // of the triangle, on which the proxy was: 1 = that of its normal, or -1; 0: beside it
    TROCAR_FIELDS(body, "index of bodies or none", triangle, weight, position, "m", side);
};

// The body that a tool has pierced.
struct ToolPierce {
    uint32_t body = kNone;
    uint32_t seen = 0;  // pass-throughs already seen by the simulation
    TROCAR_FIELDS(body, "index of bodies or none", seen);
};

// How a tool that starts or is found inside a body leaves it.
struct ToolExit {
    uint32_t body = kNone;            // that it is inside
    Vec3d direction = Vec3d::Zero();  // unit, world
    Vec3d goal = Vec3d::Zero();       // m, from the device to where the tool is outside; zero once it is
    TROCAR_FIELDS(body, "index of bodies or none", direction, goal, "m");
};

// Motion of a device estimated from its positions, smoothed twice: constant acceleration lags by half a
// sample.
struct DeviceMotion {
    Vec3d once = Vec3d::Zero(), twice = Vec3d::Zero();  // m/s
    Vec3d velocity() const { return 2 * once - twice; }
    TROCAR_FIELDS(once, "m/s", twice, "m/s");
};

// State of one tool's force rendering between ticks.
struct ToolState {
    DeviceState device;
    DeviceMotion motion;                // used for extrapolation instead of the velocity of a single sample
    Vec3d proxy = Vec3d::Zero();        // m, world: centre of the tip sphere, kept outside the surface (god object)
    bool proxy_valid = false;           // false until the sphere is clear of every surface: no force
    bool outside = false;               // a valid proxy is known to be outside every closed surface, not in a pierced body
    uint64_t surface = 0;               // sequence of the local contact model at the last tick
    ContactAnchor anchor;               // while the proxy of a tip is in contact
    uint32_t contacts = 0;              // surface constraints active on the proxy
    uint32_t touched = kNone;           // body whose surface the proxy is in contact with; kNone without contacts
    bool sliding = false;               // along the surface, faster than 1 mm/s
    Vec3d carried = Vec3d::Zero();      // m, displacement of the proxy by the moving surface since first contact
    Vec3d pull = Vec3d::Zero();         // N, virtual coupling force between device and proxy, which `command` approaches, and
    Vec3d pull_torque = Vec3d::Zero();  // N m, the torque of a coupling that rotates
    DeviceCommand command;              // of contact alone
    DeviceCommand output;               // what the device is commanded: contact and effects within limits
    bool device_valid = false;          // `device` is an accepted sample
    double time = 0;                    // s, of the last tick
    uint64_t ticks = 0;
    double model_age = 0;                   // s, age of the surface model used at the last tick
    double gain = 1;                        // fraction of the force let through, 0..1: timeouts and recovery
    double largest_force = 0;               // N, commanded so far, within the limits
    double largest_wanted = 0;              // N, before the limits
    uint64_t rejected_samples = 0;          // not finite, out of order, or farther or faster than a hand can move
    Vec3d coupling_force = Vec3d::Zero();   // N, of the coupling on the simulated tool, last substep
    Vec3d contact_impulse = Vec3d::Zero();  // N s, of tissue on the simulated tool, summed over the period
    HandModelState hand;
    ClutchState clutch;
    SafetyState safety;
    Vec3d effect_velocity = Vec3d::Zero();  // m/s, of the device at the last tick, for inertia
    std::array<EffectState, kMaxEffects> effect{};
    HapticEvents events;
    Vec3d link_force = Vec3d::Zero();         // N, of links on the simulated tool, mean over the last pass
    Vec3d link_force_before = Vec3d::Zero();  // and over the one before
    ToolPass last_pass;                       // for the simulation; the tick does not use it
    ToolPierce pierce;                        // likewise
    ToolExit exit;                            // likewise
    Vec3d pushed = Vec3d::Zero();             // m, from the device to where the tool is held while it leaves a body, and fading after that
    // of a tool with a point shell, whose tip is at `proxy`
    Quat proxy_turn;                        // of the instrument kept outside the surface
    std::vector<ShellContact> contact;      // points ascend
    Vec3d device_spin = Vec3d::Zero();      // rad/s, of the device at the last tick
    Vec3d coupling_torque = Vec3d::Zero();  // N m, as coupling_force, about the tip
    Vec3d contact_moment = Vec3d::Zero();   // N m s, as contact_impulse, about the tip
    // of any tool with jaws
    double grip_moment = 0;  // N m s, opening moment of tissue on the simulated jaws, summed over the period
    double grip_torque = 0;  // N m, its mean over the last pass: what the fingers that close them feel
    TROCAR_FIELDS(device, motion, proxy, "m", proxy_valid, outside, surface, anchor, contacts, command, output, coupling_force, "N",
                  contact_impulse, "N s", device_valid, time, "s", ticks, model_age, "s", gain, largest_force, "N", largest_wanted, "N",
                  rejected_samples, touched, "index of bodies or none", last_pass, pierce, exit, pushed, "m", link_force, "N",
                  link_force_before, "N", hand, clutch, safety, effect_velocity, "m/s", effect, events, proxy_turn, contact, device_spin,
                  "rad/s", coupling_torque, "N m", contact_moment, "N m s", sliding, carried, "m", pull, "N", pull_torque, "N m",
                  grip_moment, "N m s", grip_torque, "N m");
};

}  // namespace trocar
