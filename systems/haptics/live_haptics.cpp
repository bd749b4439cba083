#include "systems/haptics/live_haptics.hpp"

#include "engine/base/check.hpp"
namespace trocar {

// Haptic-thread data of one tool. Only the tick writes it, except for the mailboxes.
struct LiveHaptics::Tool {
    LiveTool setup;
    DeviceState sample;   // used by this tick
    HandModelState hand;  // state of a scripted hand that yields to forces
    ToolState state;
    HapticScratch scratch;
    Latest<LocalContactModel> model;  // from the simulation
    Latest<ToolState> newest;         // to the simulation
};

LiveHaptics::LiveHaptics(const HapticParams& params, std::span<const LiveTool> tools, LiveRecorder recorder)
    : params_(params), recorder_(recorder) {
    for (const LiveTool& tool : tools) {
        tools_.push_back(std::make_unique<Tool>());
        tools_.back()->setup = tool;
        tools_.back()->model.back().in_hand = tool.in_hand;
        tools_.back()->model.publish();
        tools_.back()->model.update();
    }
}

LiveHaptics::LiveHaptics(const HapticParams& params, std::span<const HandTool> tools, std::span<const Device> devices,
                         LiveRecorder recorder)
    : params_(params), recorder_(recorder) {
    TROCAR_ASSERT(tools.size() == devices.size());
    for (size_t k = 0; k < tools.size(); ++k) {
        tools_.push_back(std::make_unique<Tool>());
        tools_.back()->setup = {tools[k], {}, devices[k], nullptr, true};
    }
}

LiveHaptics::~LiveHaptics() { stop(); }

// Reserves the contact arrays of point shells in all three buffers, so that a tick never allocates.
void LiveHaptics::make_room() {
    for (const std::unique_ptr<Tool>& t : tools_) {
        t->state.contact.reserve(t->setup.tool.point_shell.size());
        for (int buffer = 0; buffer < 3; ++buffer) {
            t->newest.back().contact.reserve(t->setup.tool.point_shell.size());
            t->newest.publish();
            t->newest.update();
        }
    }
}

void LiveHaptics::start(const PeriodicOptions& options, int64_t start_ns) {
    start_ns_ = start_ns;
    make_room();
    thread_.start(options, start_ns, [this, period = options.period](uint64_t index, int64_t now_ns) {
        tick(index, static_cast<double>(index) * static_cast<double>(period) * 1e-9, now_ns);
    });
}

void LiveHaptics::stop() { thread_.stop(); }

// Reads the newest sample of the tool's device; false if there is none yet.
bool LiveHaptics::take_sample(Tool& t, double time) const {
    if (!t.setup.link) {
        t.sample = hand_sample(t.setup.tool, read_device(t.setup.device, time), params_.dt, t.state.output, t.hand);
        return true;
    }
    const LinkSample& newest = t.setup.link->read();
    if (newest.received_ns == 0) return false;
    t.sample = newest.state;
    // device clocks are not synchronised with ours: use the arrival time
    t.sample.time = static_cast<double>(newest.received_ns - start_ns_) * 1e-9;
    return true;
}

bool LiveHaptics::take_model(Tool& t) const {
    if (!t.model.update()) return false;
    rehearse_tick(params_, t.model.front(), t.setup.tool, t.state, t.scratch);
    return true;
}

// One tool takes its new surface. Instruments that are exchanged for one another switch at the same time.
void LiveHaptics::take_model(uint64_t index) {
    const auto count = static_cast<uint32_t>(tools_.size());
    for (uint32_t n = 0, first = count > 0 ? first_asked(index, count) : 0; n < count; ++n) {
        Tool& taken = *tools_[(first + n) % count];
        if (!take_model(taken)) continue;
        for (const std::unique_ptr<Tool>& t : tools_)
            if (taken.setup.link && t->setup.link == taken.setup.link) take_model(*t);
        return;
    }
}

void LiveHaptics::tick(uint64_t index, double time, int64_t now_ns) {
    for (uint32_t k = 0; k < tools_.size(); ++k) {
        Tool& t = *tools_[k];
        if (!take_sample(t, time)) continue;
        const LocalContactModel& model = t.model.front();
        tick_tool(params_, model, time, t.setup.tool, t.setup.effects, t.sample, t.scratch, t.state);
        if (t.setup.link && model.in_hand) t.setup.link->write(t.state.output, now_ns);
        if (model.reach > 0) figures_.contact_age.add(static_cast<int64_t>((time - model.time) * 1e9));
        figures_.max_force = std::max(figures_.max_force, t.state.largest_force);
        figures_.max_force_wanted = std::max(figures_.max_force_wanted, t.state.largest_wanted);
        t.newest.back() = t.state;
        t.newest.publish();
        if (recorder_.record)
            recorder_.record(recorder_.user, {index, time, k, model.sequence, t.sample, t.state.output.force, t.state.output.torque});
    }
    // the forces have been sent, so there is time to prepare surfaces for the next tick
    take_model(index + 1);
}

LocalContactModel& LiveHaptics::model_to_fill(uint32_t tool) { return tools_[tool]->model.back(); }

const ToolState& LiveHaptics::state(uint32_t tool) const { return tools_[tool]->state; }

void LiveHaptics::publish_model(uint32_t tool) {
    tools_[tool]->model.back().time += slip_;
    tools_[tool]->model.publish();
}

void take_tool_state(const ToolState& newest, ToolState& state) {
    const Vec3d coupling_force = state.coupling_force, contact_impulse = state.contact_impulse;
    const Vec3d coupling_torque = state.coupling_torque, contact_moment = state.contact_moment;
    const Vec3d link_force = state.link_force, link_force_before = state.link_force_before;
    const double grip_moment = state.grip_moment, grip_torque = state.grip_torque;
    const ToolPass last_pass = state.last_pass;
    const ToolPierce pierce = state.pierce;
    const ToolExit exit = state.exit;
    state = newest;
    state.last_pass = last_pass;
    state.pierce = pierce;
    state.exit = exit;
    state.link_force = link_force;
    state.link_force_before = link_force_before;
    state.coupling_force = coupling_force;
    state.contact_impulse = contact_impulse;
    state.coupling_torque = coupling_torque;
    state.contact_moment = contact_moment;
    state.grip_moment = grip_moment;
    state.grip_torque = grip_torque;
}

bool LiveHaptics::take_states(Haptics& haptics) {
    TROCAR_ASSERT(haptics.state.size() == tools_.size());
    bool fresh = false;
    for (size_t k = 0; k < tools_.size(); ++k) {
        if (!tools_[k]->newest.update()) continue;
        fresh = true;
        take_tool_state(tools_[k]->newest.front(), haptics.state[k]);
    }
    if (fresh) sum_tool_counters(haptics);
    return fresh;
}

}  // namespace trocar
