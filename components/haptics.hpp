#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/haptic_surface.hpp"
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
    uint32_t buttons = 0;            // one bit each
    double grip = 0;                 // rad, between the jaws; 0 = closed, or the device has none
    TROCAR_FIELDS(time, "s", position, "m", orientation, velocity, "m/s", buttons, grip, "rad");
};

// Where the devices are at every millisecond of a pass, both ends included: that of tool t at millisecond k in row
// t * per_tool + k.
struct DeviceSamples {
    uint32_t per_tool = 0;
    std::vector<DeviceState> intended;  // where hands mean to be; empty in live runs
    std::vector<DeviceState> placed;    // where they are, as forces and workspaces have it
    TROCAR_FIELDS(per_tool, intended, placed);
    const DeviceState& start(size_t tool) const { return placed[tool * per_tool]; }
    const DeviceState& end(size_t tool) const { return placed[tool * per_tool + per_tool - 1]; }
};

// What a device reported before, in ascending time. Constant after load.
struct DeviceTrace {
    std::vector<DeviceState> sample;
    TROCAR_FIELDS(sample);
};

// What it is told to do: a force field around a place, so that a device with a faster loop of its own may follow the
// hand between two commands: force(x) = force - stiffness * (x - at).
struct DeviceCommand {
    Vec3d force = Vec3d::Zero();        // N, on the hand, when it is at `at`
    Vec3d torque = Vec3d::Zero();       // N m, on the hand, about the tip
    Vec3d at = Vec3d::Zero();           // m
    std::array<double, 9> stiffness{};  // N/m, row by row, symmetric, not negative
    TROCAR_FIELDS(force, "N", torque, "N m", at, "m", stiffness, "N/m");
};

// What a device must not be asked beyond. Vectors are scaled, so their direction stays.
struct DeviceLimits {
    double torque = 0.2;             // N m; the largest force is HandTool::max_force
    double force_slew = 0;           // N/s; 0 = from none to the largest force in 3 ms
    double torque_slew = 0;          // N m/s; 0 = the same
    double dissipation = 10;         // N s/m, most damping by which energy that sampling made is taken back; 0 = none
    double turn_dissipation = 0.01;  // N m s/rad, the same for turning
    double surface_age = 0;          // s, an older surface is not trusted: force falls to zero; 0 = HapticParams::model_timeout
    TROCAR_FIELDS(torque, "N m", force_slew, "N/s", torque_slew, "N m/s", dissipation, "N s/m", turn_dissipation, "N m s/rad", surface_age,
                  "s");
};

// Where the space that a hand reaches lies in the world: world = origin + turn (scale * device).
struct Workspace {
    Vec3d origin = Vec3d::Zero();  // m
    Quat turn;
    double scale = 1;
    uint32_t clutch = 0;  // buttons (bits): while one is held the tool stays and the hand moves alone; 0 = none
    TROCAR_FIELDS(origin, "m", turn, scale, clutch);
};

// Instrument through a point of the body wall: two angles, insertion and roll are free.
enum class PivotKind : uint8_t {
    kNone,
    kHandle,  // the device is the handle outside: the tip moves the other way, scaled by the lever
    kTip,     // the device is the tip inside: it moves as the hand does
};
struct Pivot {
    PivotKind kind = PivotKind::kNone;
    Vec3d point = Vec3d::Zero();  // m, world
    double length = 0.33;         // m, kHandle: from the device to the tip
    Vec3d axis{0, 0, -1};         // unit, in the frame of the device: from handle to tip
    TROCAR_FIELDS(kind, point, "m", length, "m", axis);
};

// A hand with an arm behind it that follows a path and gives way to forces: mass on a spring and damper between it and
// where it means to be. mass = 0: a hand that no force moves.
struct HandModel {
    double mass = 0;         // kg, of hand and device
    double damping = 0;      // N s/m, of the device
    double stiffness = 0;    // N/m, of the arm
    double arm_damping = 0;  // N s/m, of the arm
    double friction = 0;     // N, Coulomb, of the device
    double encoder = 0;      // m, step of the reported position; 0 = exact
    uint32_t delay = 0;      // ticks until a command acts, 0..7
    double tremor = 0;       // m, amplitude
    double tremor_rate = 9;  // Hz
    TROCAR_FIELDS(mass, "kg", damping, "N s/m", stiffness, "N/m", arm_damping, "N s/m", friction, "N", encoder, "m", delay, tremor, "m",
                  tremor_rate, "Hz");
};
inline constexpr uint32_t kMostHandDelay = 7;
struct HandModelState {
    bool placed = false;
    Vec3d position = Vec3d::Zero();  // m
    Vec3d velocity = Vec3d::Zero();  // m/s
    std::array<Vec3d, kMostHandDelay + 1> force{Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero(),
                                                Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero()};  // N, newest first
    Vec3d reported = Vec3d::Zero();                                                                           // m, through the encoder
    Vec3d reported_velocity = Vec3d::Zero();                                                                  // m/s
    TROCAR_FIELDS(placed, position, "m", velocity, "m/s", force, "N", reported, "m", reported_velocity, "m/s");
};

enum class EffectKind : uint8_t {
    kSpringPoint,  // stiffness (point - x)
    kSpringLine,   // the same without its part along `direction`
    kSpringPlane,  // its part along `direction` alone
    kConstant,     // force along direction
    kImpulse,      // a half sine of `duration` along direction whose integral is `impulse`
    kVibration,    // force sin(2 pi frequency t) along direction
    kViscosity,    // -damping v
    kInertia,      // -mass a
    kMagnet,       // towards the surface nearer than `reach`, growing linearly to `force` where it is touched
};
enum class EffectTrigger : uint8_t {
    kTime,     // at `start`
    kButton,   // when one of `buttons` is pressed; stops when it is released, or after duration
    kTouch,    // when a surface is touched
    kRelease,  // when it is left
};
// A force of its own on one tool's hand, beside contact. Constant after load.
struct HapticEffect {
    EffectKind kind = EffectKind::kConstant;
    EffectTrigger trigger = EffectTrigger::kTime;
    double start = 0;             // s, kTime
    double duration = 0;          // s; 0 = for ever, or while the button is held
    uint32_t buttons = 0;         // kButton
    Vec3d point = Vec3d::Zero();  // m, world
    Vec3d direction{0, 0, 1};     // unit, world
    double stiffness = 0;         // N/m
    double damping = 0;           // N s/m, springs and viscosity
    double force = 0;             // N
    double impulse = 0;           // N s
    double frequency = 0;         // Hz
    double mass = 0;              // kg
    double reach = 0;             // m
    TROCAR_FIELDS(kind, trigger, start, "s", duration, "s", buttons, point, "m", direction, stiffness, "N/m", damping, "N s/m", force, "N",
                  impulse, "N s", frequency, "Hz", mass, "kg", reach, "m");
};
inline constexpr uint32_t kMaxEffects = 16;  // of a tool
struct EffectState {
    bool running = false;
    double since = 0;  // s
    TROCAR_FIELDS(running, since, "s");
};

enum class HapticEventKind : uint8_t { kTouch, kRelease, kButtonDown, kButtonUp, kPassThrough, kLimit, kCount };
struct HapticEvent {
    HapticEventKind kind = HapticEventKind::kTouch;
    double time = 0;     // s
    uint32_t value = 0;  // buttons that changed, body that was passed through; else 0
    TROCAR_FIELDS(kind, time, "s", value);
};
inline constexpr uint32_t kKeptEvents = 16;
// The last events of a tool and how many there were of each kind.
struct HapticEvents {
    std::array<HapticEvent, kKeptEvents> last{};  // event n at n % kKeptEvents
    uint64_t total = 0;
    std::array<uint32_t, static_cast<size_t>(HapticEventKind::kCount)> count{};
    TROCAR_FIELDS(last, total, count);
};

// What the last stage before the device remembers.
struct SafetyState {
    Vec3d contact_force = Vec3d::Zero();  // N, of contact, let through at the last tick ...
    Vec3d pull = Vec3d::Zero();           // N, ... and of the coupling on what the proxy touches
    Vec3d from_device = Vec3d::Zero();    // m, where the device and the proxy were then
    Vec3d from_proxy = Vec3d::Zero();
    double energy = 0;         // J, that contact took from the hand; below zero it gave some
    double lowest_energy = 0;  // J
    double dissipated = 0;     // J, taken back by damping
    bool started = false;
    double gain = 1;        // share let through after a silence, 0..1
    bool limiting = false;  // a limit cut the last command
    uint64_t limited_ticks = 0;
    uint64_t safe_ticks = 0;  // ticks with the force held at or on its way to zero by trouble
    // the same of the turning of a tool with a shell, a coupling of its own
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
    Vec3d offset = Vec3d::Zero();  // m, world, added to where the workspace puts the device
    Vec3d tool = Vec3d::Zero();    // m, world, where the tool was put last
    TROCAR_FIELDS(started, offset, "m", tool, "m");
};

// Point of an instrument's surface that feels other surfaces.
struct ShellPoint {
    Vec3d arm = Vec3d::Zero();     // m, from the tip, axes of the body
    Vec3d inward = Vec3d::Zero();  // unit, into the instrument, axes of the body
    uint32_t jaw = kNone;          // row of HandTool::shell_jaw: then arm is from the jaw's pivot, and both in axes of the jaw
    TROCAR_FIELDS(arm, "m", inward, jaw);
};

// A body of its own that turns about an axis of an instrument as far as the device's grip says. Constant after load.
struct ToolJaw {
    uint32_t body = kNone;
    Vec3d pivot = Vec3d::Zero();  // m, frame of the instrument: where the jaw's origin is
    Quat closed;                  // jaw frame to that of the instrument, at grip 0
    Vec3d axis{1, 0, 0};          // unit, frame of the instrument
    double share = 0.5;           // of the grip that it turns by, against the clock about the axis; negative: with it
    TROCAR_FIELDS(body, "row of bodies", pivot, "m", closed, axis, share);
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
    uint32_t path = kNone;    // row of Paths: the scripted hand
    uint32_t trace = kNone;   // row of Haptics::trace: the recorded hand
    double pass_through = 0;  // N, harder presses go through the surface; 0 = never
    HandModel hand;           // of a scripted hand that gives way
    Workspace workspace;
    Pivot pivot;
    DeviceLimits limits;
    Range effects;           // rows of Haptics::effect
    Range jaws;              // rows of Haptics::jaw
    double grip_closed = 0;  // rad, a grip below counts as the first button down
    // The rest is of tools whose whole instrument feels (dof = 6); those with a sphere at the tip have no shell.
    std::vector<ShellPoint> shell;   // neighbours in space follow each other
    double shell_radius = 0;         // m, of the farthest point of the shell
    double turn_stiffness = 0;       // N m/rad, of the coupling
    double turn_damping = 0;         // N m s/rad
    double inertia = 0;              // kg m^2, about the tip, of what the simulated coupling turns; the same every way
    double surface_stiffness = 0;    // N/m, of a point of the shell against a surface
    std::vector<ToolJaw> shell_jaw;  // its jaws, as in Haptics::jaw
    TROCAR_FIELDS(body, "row of bodies", tip, "m", tip_radius, "m", coupling_stiffness, "N/m", coupling_damping, "N s/m", max_force, "N",
                  friction, path, "row of paths or none", trace, "row of traces or none", pass_through, "N", hand, workspace, pivot, limits,
                  effects, "rows of effects", jaws, "rows of jaws", grip_closed, "rad", shell, shell_radius, "m", turn_stiffness, "N m/rad",
                  turn_damping, "N m s/rad", inertia, "kg m^2", surface_stiffness, "N/m", shell_jaw);
};

// How forces are rendered; the same for all tools.
struct HapticParams {
    double dt = 1e-3;              // s, period of the tick
    double tool_speed = 0.5;       // m/s, a model reaches as far as this speed (or 1.5 x the present one) goes ...
    double greatest_age = 35e-3;   // s, ... in this time ...
    double reach_margin = 5e-3;    // m, ... and this much farther
    double device_speed = 2;       // m/s, a sample farther from the last good one than this and ...
    double device_slack = 5e-3;    // m, ... this allow is refused; so is a velocity that says so
    double motion_filter = 8e-3;   // s, over which a device's velocity is made from its places
    double model_timeout = 0.1;    // s, an older model is not trusted: force falls to zero
    double device_timeout = 8e-3;  // s, the same for an older sample
    double fall_time = 5e-3;       // s, from full force to none on a timeout
    double silence = 0.02;         // s, ticks farther apart than this: force comes back over rise_time
    double rise_time = 0.05;       // s, back to full force after trouble
    double force_slew = 200;       // N/s, change of force beyond what the motion of the device explains
};

// Corners of the triangles of a group, a lane for each triangle: s seconds later a corner is moved by s velocity. Lanes without a triangle
// lie kFarLane away.
inline constexpr uint32_t kGroupTriangles = 8, kBlockGroups = 16;
using GroupLanes = std::array<float, kGroupTriangles>;
using BlockLanes = std::array<float, kBlockGroups>;
inline constexpr float kFarLane = 1e9F;  // m
struct TriangleLanes {
    std::array<std::array<GroupLanes, 3>, 3>
        corner{};  // m, by corner and world axis, from the centre of the group, at the time of the model
    std::array<std::array<GroupLanes, 3>, 3> velocity{};  // m/s, likewise, less that of the group
    TROCAR_FIELDS(corner, "m", velocity, "m/s");
};
// Balls around the groups of a block, or the blocks of a cluster: s seconds later all of a group is within radius + spread |s|
// of its centre moved by s velocity.
struct GroupBalls {
    std::array<BlockLanes, 3> centre{};    // m, world axes, from the centre of the block, at the time of the model
    std::array<BlockLanes, 3> velocity{};  // m/s, less that of the block
    BlockLanes radius{};                   // m; -infinity: no group
    BlockLanes spread{};                   // m/s
    BlockLanes speed{};                    // m/s, nothing of it is faster
    TROCAR_FIELDS(centre, "m", velocity, "m/s", radius, "m", spread, "m/s", speed, "m/s");
};
// What lanes round, of the lengths that come together: from the centre of the group or block to where it is asked for, its radius, how far
// it spread.
inline constexpr double kLaneRounding = 4e-6;

// Triangles of a body in a local contact model that lie together, and a ball around them; or groups that do, or blocks.
struct TriangleGroup {
    Range triangles;  // rows of triangle, in a block rows of group, in a cluster rows of block
    uint32_t body = kNone;
    double half_thickness = 0;       // m, see LocalContactModel
    Vec3d centre = Vec3d::Zero();    // m, world, at the time of the model
    double radius = 0;               // m
    Vec3d velocity = Vec3d::Zero();  // m/s, mean of the corners
    double spread = 0;               // m/s, no corner's velocity differs from the mean by more
    TROCAR_FIELDS(triangles, body, half_thickness, "m", centre, "m", radius, "m", velocity, "m/s", spread, "m/s");
};

// How a pressed surface goes with the device that presses it, until the next contact pass says where it is.
struct SurfaceGive {
    uint32_t body = kNone;                  // whose surface; kNone: none goes along
    double share = 0;                       // of the device's way along the normal, 0..1
    Vec3d normal = Vec3d::Zero();           // unit
    Vec3d device = Vec3d::Zero();           // m, where the device was ...
    Vec3d device_velocity = Vec3d::Zero();  // m/s, how it moved ...
    double time = 0;                        // s, and when that was
    double gap = 0;                         // m, added to the tip's radius against that body: contacts hold the
                                            // simulated tip a hair off its surface, or let it in
    TROCAR_FIELDS(body, share, normal, device, "m", device_velocity, "m/s", time, "s", gap, "m");
};

// Up to four parts of a surface side by side, a lane each, and boxes around them at the time of their model.
// Rounded outwards; ticks search hundreds of nodes, so they are kept small.
struct alignas(64) SurfaceNode {
    using Lanes = std::array<float, 4>;
    std::array<Lanes, 3> low{}, high{};                    // m, world, by axis
    std::array<Lanes, 3> velocity_low{}, velocity_high{};  // m/s, of the vertices
    std::array<Range, 4> part{};                           // rows of LocalContactModel::triangle; none: `first` is a node
    Lanes speed{};                                         // m/s, of the fastest of the vertices
    uint32_t lanes = 0;                                    // that hold a part
    TROCAR_FIELDS(low, "m", high, "m", velocity_low, "m/s", velocity_high, "m/s", speed, "m/s", part, lanes);
};

// A body's surface in a model: a tree of nodes.
struct SurfaceTree {
    uint32_t body = kNone;
    uint32_t root = 0;          // node
    double half_thickness = 0;  // m, of a sheet, or 0
    TROCAR_FIELDS(body, root, half_thickness, "m");
};

// Triangles of one tree around a point, the nearest first: while neither has gone far, one of them stays the nearest.
struct TrianglesAround {
    std::array<uint32_t, 8> triangle{kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};  // rows; kNone where there are fewer
    std::array<double, 2> others{};  // m, all but the first four were not nearer, all but these eight
};

// What a shell knows of the surface around it when its model was made.
struct ShellOutlook {
    Vec3d tip = Vec3d::Zero();  // m, world, where the shell was then
    Quat turn;
    double grip = 0;  // rad
    std::vector<SurfaceNode> node;
    std::vector<SurfaceTree> tree;       // one a body
    std::vector<double> clear;           // m, per tree and point of the shell: no surface was nearer; 0: perhaps inside
    std::vector<uint32_t> nearest;       // likewise: triangle of the model, or kNone where none is within reach
    std::vector<TrianglesAround> found;  // likewise, at the time of the model; none where nothing was near. No answer depends on them
    std::vector<Vec3d> place;            // m, world, per point of the shell: where it was then
    std::vector<double> speed;           // m/s, per tree and point: nothing faster comes nearer to that place than `around` ...
    double around = 0;                   // m, ...
    double ahead = 0;                    // s, ... up to this age of the model, going on as that says
    TROCAR_FIELDS(tip, "m", turn, grip, "rad", node, tree, clear, "m", nearest, place, "m", speed, "m/s", around, "m", ahead, "s");
    TROCAR_OTHER_FIELDS(found);
};

// Surface within reach of a tool, frozen at one contact pass. Immutable once published; the tick reads nothing else.
struct LocalContactModel {
    double time = 0;             // s, of the positions
    uint64_t sequence = 0;       // contact pass that made it, from 1; 0 = none did
    Vec3d from = Vec3d::Zero();  // m, world: every surface nearer than reach to the segment from -> to is here
    Vec3d to = Vec3d::Zero();    // m
    double reach = 0;            // m, from the segment; 0 = nothing was looked at yet
    double fastest = 0;          // m/s, of its vertices
    SurfaceGive give;
    // N, of what links hold on the simulated tool, mean over the pass before this one and over the one before that: the
    // hand feels the way from one to the other while the next pass is under way, so without a step and a pass late
    Vec3d pull = Vec3d::Zero(), pull_before = Vec3d::Zero();
    double period = 0;            // s, of a pass
    std::vector<Vec3d> position;  // m, world
    std::vector<Vec3d> velocity;  // m/s
    std::vector<Triangle> triangle;
    std::vector<std::array<uint32_t, 3>> neighbour;  // kNone where the patch ends
    std::vector<uint32_t> body;                      // per triangle
    std::vector<TriangleLanes> lanes;                // one per group
    std::vector<TriangleGroup> group;                // all triangles in runs of neighbours in memory
    std::vector<TriangleGroup> block;                // all groups in runs
    std::vector<TriangleGroup> cluster;              // all blocks in runs
    std::vector<GroupBalls> ball;                    // one per block
    std::vector<GroupBalls> cluster_ball;            // one per cluster
    std::vector<double> half_thickness;              // m, per triangle; > 0: a sheet, it stops the tool on both sides; 0: of a closed body
    ShellOutlook shell;                              // of a tool that has one
    std::vector<HapticSurface> surface;              // of bodies that feel otherwise than the tool says
    bool in_hand = true;                             // false: another instrument was exchanged for this one
    TROCAR_FIELDS(time, "s", sequence, from, "m", to, "m", reach, "m", fastest, "m/s", position, "m", velocity, "m/s", triangle, neighbour,
                  body, half_thickness, "m", lanes, group, block, cluster, ball, cluster_ball, give, pull, "N", pull_before, "N", period,
                  "s", shell, surface, in_hand);
};

// What a contact pass found of one tool, for the next one to compare with.
struct ToolPass {
    uint32_t touched = kNone;      // body
    Vec3d tip = Vec3d::Zero();     // m, world, of the simulated tool
    Vec3d device = Vec3d::Zero();  // m
    TROCAR_FIELDS(touched, "row of bodies or none", tip, "m", device, "m");
};

// A point of a shell that a surface holds.
struct ShellContact {
    uint32_t point = 0;           // of HandTool::shell
    uint32_t body = kNone;        // whose surface
    Vec3d arm = Vec3d::Zero();    // m, world axes, from the tip
    Vec3d force = Vec3d::Zero();  // N, on the tool
    Vec3d slip = Vec3d::Zero();   // m, world, how far friction is stretched along the surface
    double depth = 0;             // m
    double side = 1;              // of a sheet that the point is held on: where its normals point, or -1
    bool sliding = false;         // along the surface, faster than 1 mm/s
    TROCAR_FIELDS(point, body, "row of bodies or none", arm, "m", force, "N", slip, "m", depth, "m", side, sliding);
};

// The body that a tool is stuck through.
struct ToolPierce {
    uint32_t body = kNone;
    uint32_t seen = 0;  // pass-throughs that the simulation knows of
    TROCAR_FIELDS(body, "row of bodies or none", seen);
};

// How a device moves by what its places say, smoothed twice: constant acceleration lags by half a sample.
struct DeviceMotion {
    Vec3d once = Vec3d::Zero(), twice = Vec3d::Zero();  // m/s
    Vec3d velocity() const { return 2 * once - twice; }
    TROCAR_FIELDS(once, "m/s", twice, "m/s");
};

// State of one tool's force rendering between ticks.
struct ToolState {
    DeviceState device;
    DeviceMotion motion;                // what is foretold follows this, not one sample's velocity
    Vec3d proxy = Vec3d::Zero();        // m, world: centre of the tip sphere, kept outside the surface
    bool proxy_valid = false;           // false until the sphere is seen clear of every surface: no force
    uint32_t contacts = 0;              // surface constraints active on the proxy
    uint32_t touched = kNone;           // body whose surface holds the proxy; kNone without contacts
    bool sliding = false;               // along the surface, faster than 1 mm/s
    Vec3d carried = Vec3d::Zero();      // m, that surface took the proxy along since it was touched
    Vec3d pull = Vec3d::Zero();         // N, of the coupling of device and proxy: what `command` is on its way to, and
    Vec3d pull_torque = Vec3d::Zero();  // N m, of one that turns
    DeviceCommand command;              // of contact alone
    DeviceCommand output;               // what the device is told: contact and effects within limits
    bool device_valid = false;          // `device` is a sample that was accepted
    double time = 0;                    // s, of the last tick
    uint64_t ticks = 0;
    double model_age = 0;                   // s, of the surface under the force at the last tick
    double gain = 1;                        // share of the force let through, 0..1: timeouts and recovery
    double largest_force = 0;               // N, commanded so far
    uint64_t rejected_samples = 0;          // refused: not finite, out of order, farther or faster than a hand can move
    Vec3d coupling_force = Vec3d::Zero();   // N, of the coupling on the simulated tool, last substep
    Vec3d contact_impulse = Vec3d::Zero();  // N s, of the tissue on the simulated tool, summed over the period
    HandModelState hand;
    ClutchState clutch;
    SafetyState safety;
    Vec3d effect_velocity = Vec3d::Zero();  // m/s, of the device at the last tick, for inertia
    std::array<EffectState, kMaxEffects> effect{};
    HapticEvents events;
    Vec3d link_force = Vec3d::Zero();         // N, of links on the simulated tool, mean over the last pass
    Vec3d link_force_before = Vec3d::Zero();  // and over the one before
    ToolPass last_pass;                       // of the simulation, not of the tick
    ToolPierce pierce;                        // likewise
    // of a tool with a shell, whose tip is at `proxy`
    Quat proxy_turn;                        // of the instrument kept outside the surface
    std::vector<ShellContact> contact;      // points ascend
    Vec3d device_spin = Vec3d::Zero();      // rad/s, of the device at the last tick
    Vec3d coupling_torque = Vec3d::Zero();  // N m, as coupling_force, about the tip
    Vec3d contact_moment = Vec3d::Zero();   // N m s, as contact_impulse, about the tip
    // of any tool with jaws
    double grip_moment = 0;  // N m s, of the tissue on the simulated jaws that opens them, summed over the period
    double grip_torque = 0;  // N m, its mean over the last pass: what the fingers that close them feel
    TROCAR_FIELDS(device, motion, proxy, "m", proxy_valid, contacts, command, output, coupling_force, "N", contact_impulse, "N s",
                  device_valid, time, "s", ticks, model_age, "s", gain, largest_force, "N", rejected_samples, touched,
                  "row of bodies or none", last_pass, pierce, link_force, "N", link_force_before, "N", hand, clutch, safety,
                  effect_velocity, "m/s", effect, events, proxy_turn, contact, device_spin, "rad/s", coupling_torque, "N m", contact_moment,
                  "N m s", sliding, carried, "m", pull, "N", pull_torque, "N m", grip_moment, "N m s", grip_torque, "N m");
};

struct Haptics {
    std::vector<HandTool> tool;          // constant
    std::vector<DeviceTrace> trace;      // constant
    std::vector<HapticEffect> effect;    // constant
    std::vector<ToolJaw> jaw;            // constant
    std::vector<HapticSurface> surface;  // constant; one a body that feels otherwise than its tool says
    std::vector<ToolState> state;        // one per tool
    uint64_t ticks = 0;
    double max_force = 0;           // N, largest commanded
    uint64_t rejected_samples = 0;  // device samples refused (not finite, jump)
    TROCAR_FIELDS(tool, trace, effect, surface, jaw, state, ticks, max_force, "N", rejected_samples);
    static constexpr size_t kConstantFields = 5;  // the first of the list
};

}  // namespace trocar
