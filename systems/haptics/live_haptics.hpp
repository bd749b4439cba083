#pragma once
#include <memory>
#include <span>
#include <vector>

#include "engine/base/latest.hpp"
#include "engine/devices/device.hpp"
#include "engine/devices/link.hpp"
#include "engine/jobs/real_time.hpp"
#include "systems/haptics/tool.hpp"
namespace trocar {

// Input and output of one live tick of one tool: enough to repeat it in lockstep.
struct LiveTick {
    uint64_t tick = 0;  // periods since the start
    double time = 0;    // s since the start
    uint32_t tool = 0;
    uint64_t model_sequence = 0;   // LocalContactModel::sequence of the surface used
    DeviceState sample;            // from the device, in its frame
    Vec3d force = Vec3d::Zero();   // N, sent to the device
    Vec3d torque = Vec3d::Zero();  // N m
};

// Called on the haptic thread after every tick of every tool; must not wait or allocate. May be empty.
struct LiveRecorder {
    void (*record)(void* user, const LiveTick& tick) = nullptr;
    void* user = nullptr;
};

struct LiveFigures {
    TimeHistogram contact_age;    // age of the surface used for each force, ns
    double max_force = 0;         // N, within the limits
    double max_force_wanted = 0;  // N, before them
};

// Copies the results of a tick (device, proxy, contacts, command, counters) into the simulation's tool state,
// except what the simulation computes: forces of coupling, contacts and links, and results of the last pass.
void take_tool_state(const ToolState& newest, ToolState& state);

// What holds a tool: a connected device, or the scene's scripted hand.
struct LiveTool {
    HandTool tool;
    std::span<const HapticEffect> effects;
    Device device;               // used without a link
    DeviceLink* link = nullptr;  // source of samples; receives the command after every tick
    bool in_hand = true;         // at the start; exchanged instruments share a device
};

// Index of the tool that is checked first for a new surface in this tick; the following tools are checked
// next, cyclically, and the first one with a new surface takes it. A tick with a new surface costs several
// ordinary ones, so at most one tool changes surface per tick, and no tool waits longer than `tools` ticks.
inline uint32_t first_asked(uint64_t tick, uint32_t tools) { return static_cast<uint32_t>(tick % tools); }

// Runs haptic ticks on their own 1 kHz thread. The simulation passes surfaces in and reads tool states
// through newest-value mailboxes; no thread waits for the other. One tool changes its surface per tick
// (first_asked), at its end, for the next tick; tools that share a device change together.
class LiveHaptics {
 public:
    // The objects that `tools` points to must outlive this one. A tool without a sample yet does not tick.
    LiveHaptics(const HapticParams& params, std::span<const LiveTool> tools, LiveRecorder recorder = {});
    // The same for tools without effects and links; `devices` has one entry per tool.
    LiveHaptics(const HapticParams& params, std::span<const HandTool> tools, std::span<const Device> devices, LiveRecorder recorder = {});
    ~LiveHaptics();

    // Starts ticking: tick n is due at start_ns + n periods (monotonic clock), simulated time n periods.
    void start(const PeriodicOptions& options, int64_t start_ns);
    void stop();

    // Simulation thread: buffer for the next model of a tool, and the call that publishes it.
    LocalContactModel& model_to_fill(uint32_t tool);
    void publish_model(uint32_t tool);
    // Simulation thread: delay (s) of simulated time relative to the ticks, caused by late passes. Added to
    // the time stamp of later models, so that a model's age counts from when its positions were current.
    void set_slip(double seconds) { slip_ = seconds; }
    // Simulation thread: applies take_tool_state with each tool's newest tick and sums the counters. False if
    // there was no tick since the previous call.
    bool take_states(Haptics& haptics);

    // Valid after stop().
    const PeriodicFigures& timing() const { return thread_.figures(); }
    const LiveFigures& figures() const { return figures_; }
    const ToolState& state(uint32_t tool) const;

 private:
    struct Tool;
    void tick(uint64_t index, double time, int64_t now_ns);
    void make_room();
    void take_model(uint64_t index);
    bool take_model(Tool& tool) const;
    bool take_sample(Tool& tool, double time) const;
    HapticParams params_;
    std::vector<std::unique_ptr<Tool>> tools_;
    LiveRecorder recorder_;
    LiveFigures figures_;
    double slip_ = 0;
    int64_t start_ns_ = 0;
    PeriodicThread thread_;
};

}  // namespace trocar
