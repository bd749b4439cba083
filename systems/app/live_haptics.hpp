#pragma once
#include <memory>
#include <span>
#include <vector>

#include "engine/device.hpp"
#include "engine/device_link.hpp"
#include "engine/latest.hpp"
#include "engine/real_time.hpp"
#include "systems/haptic_tool.hpp"
namespace trocar {

// What one live tick of one tool consumed and answered: enough to repeat it in lockstep.
struct LiveTick {
    uint64_t tick = 0;  // periods since the start
    double time = 0;    // s, the same
    uint32_t tool = 0;
    uint64_t model_sequence = 0;   // LocalContactModel::sequence of the surface it used
    DeviceState sample;            // of the device, in its frame
    Vec3d force = Vec3d::Zero();   // N, that the device was told
    Vec3d torque = Vec3d::Zero();  // N m
};

// Called on the haptic thread after every tick of every tool; must not wait or allocate. May be empty.
struct LiveRecorder {
    void (*record)(void* user, const LiveTick& tick) = nullptr;
    void* user = nullptr;
};

struct LiveFigures {
    TimeHistogram contact_age;  // of the surface under the force, ns
    double max_force = 0;       // N
};

// Copies what a tick found (device, proxy, contacts, command, counters) into the state that the simulation goes on
// from; the forces of coupling, contacts and links and what the last pass found stay, they are the simulation's own.
void take_tool_state(const ToolState& newest, ToolState& state);

// What one tool is held by: a device that talks to us, or the hand of the scene.
struct LiveTool {
    HandTool tool;
    std::span<const HapticEffect> effects;
    Device device;               // without a link
    DeviceLink* link = nullptr;  // its samples; told what to do after every tick
    bool in_hand = true;         // at the start; instruments that are exchanged for one another have one device
};

// The tool that is asked first, in a tick of all tools, whether a new surface waits for it; then those after it, round to
// the first again, and the one that has one takes it: a tick on a new surface costs several others, so never more than one
// tool has its own in the same tick, and none waits longer than there are tools.
inline uint32_t first_asked(uint64_t tick, uint32_t tools) { return static_cast<uint32_t>(tick % tools); }

// Haptic ticks on an own 1 kHz thread. The simulation gives it surfaces and takes its states through newest-value
// mailboxes; nobody waits for anybody. Tools take new surfaces one a tick (first_asked), those that share a device together: at its
// end, for the next one.
class LiveHaptics {
 public:
    // What `tools` view must outlive this. A tool whose link has given no sample yet does not tick.
    LiveHaptics(const HapticParams& params, std::span<const LiveTool> tools, LiveRecorder recorder = {});
    // The same for tools without effects and links; `devices` one per tool.
    LiveHaptics(const HapticParams& params, std::span<const HandTool> tools, std::span<const Device> devices, LiveRecorder recorder = {});
    ~LiveHaptics();

    // Starts ticking: tick n at start_ns + n periods (monotonic clock), which is simulated time n periods.
    void start(const PeriodicOptions& options, int64_t start_ns);
    void stop();

    // Simulation thread: where to write the next model of a tool, and the word that it is complete.
    LocalContactModel& model_to_fill(uint32_t tool);
    void publish_model(uint32_t tool);
    // Simulation thread: how far (s) simulated time is behind the ticks because passes were late. Added to the time of
    // every model from then on, so that its age is what passed since its positions were current.
    void set_slip(double seconds) { slip_ = seconds; }
    // Simulation thread: take_tool_state of each tool's newest tick, and the counters' sum. False if no tick came since
    // the last call.
    bool take_states(Haptics& haptics);

    // After stop.
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
