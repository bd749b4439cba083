#include "systems/app/run/live_replay.hpp"

#include "engine/base/error.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/run/live_run.hpp"
namespace trocar {

// Haptic-thread data of one tool.
struct LiveReplay::Tool {
    std::vector<uint32_t> tick;           // indices into LiveRecording::tick
    std::deque<LocalContactModel> model;  // models that the following ticks may have used, oldest first
    ToolState state;
    HapticScratch scratch;
};

LiveReplay::LiveReplay(const HapticParams& params, const LiveRecording& recording, const std::string& file, Frame& frame)
    : params_(params), recording_(recording), file_(file), frame_(frame), tools_(recording.tools) {
    if (recording.start_hash != scene_hash(frame.world()) || (!recording.lockstep && recording.tools != frame.world().haptics.tool.size()))
        throw InputError(file + ": was recorded with another scene, other settings (--set) or another version of the program");
    const std::vector<uint8_t>& laid_down = frame.world().node_state.laid_down;
    for (uint32_t t = 0; t < tools_.size(); ++t) {
        LocalContactModel& none = tools_[t].model.emplace_back();  // no surface before the first pass
        none.in_hand = laid_down.empty() || !laid_down[t];
    }
    for (uint32_t row = 0; row < recording.tick.size(); ++row) tools_[recording.tick[row].tool].tick.push_back(row);
    if (!recording.lockstep) first_device_states(frame.world());
    frame.set_contact_hook({[](void* user, World&) { static_cast<LiveReplay*>(user)->keep_models(); }, this});
}

LiveReplay::~LiveReplay() { frame_.set_contact_hook({}); }

uint64_t LiveReplay::end_tick() const { return pass_tick(recording_.slip.size(), frame_.world().clock.contact_rate); }

void LiveReplay::begin_pass(RunWatch* watch) {
    Haptics& haptics = frame_.world().haptics;
    for (uint32_t t = 0; t < tools_.size(); ++t) {
        const uint64_t taken = recording_.taken[pass_ * tools_.size() + t];
        if (taken == tools_[t].state.ticks) continue;
        advance_tool(t, taken);
        take_tool_state(tools_[t].state, haptics.state[t]);
        sum_tool_counters(haptics);
    }
    for (; next_command_ < recording_.command.size() && recording_.command[next_command_].pass <= pass_; ++next_command_)
        actions_.obey(recording_.command[next_command_], frame_, watch);
    actions_.before_pass(frame_);
    ++pass_;
}

// Repeats the ticks of one tool until it has done `ticks` of them.
void LiveReplay::advance_tool(uint32_t tool, uint64_t ticks) {
    Tool& t = tools_[tool];
    if (ticks < t.state.ticks || ticks > t.tick.size())
        throw InputError(file_ + ": recording is inconsistent: contact pass " + std::to_string(pass_) +
                         " starts from a tick that is not there");
    while (t.state.ticks < ticks) {
        const LiveTick& tick = recording_.tick[t.tick[t.state.ticks]];
        while (t.model.size() > 1 && t.model.front().sequence < tick.model_sequence) t.model.pop_front();
        if (t.model.front().sequence != tick.model_sequence)
            throw InputError(file_ + ": recording is inconsistent: tick " + std::to_string(tick.tick) +
                             " felt a surface that was not there yet or no longer");
        const Haptics& haptics = frame_.world().haptics;
        tick_tool(params_, t.model.front(), tick.time, haptics.tool[tool], effects_of(haptics, haptics.tool[tool]), tick.sample, t.scratch,
                  t.state);
        if (t.state.output.force == tick.force && t.state.output.torque == tick.torque) continue;
        if (different_ticks_++ == 0) first_different_tick_ = tick.tick;
    }
}

void LiveReplay::keep_models() {
    const World& w = frame_.world();
    for (uint32_t t = 0; t < tools_.size(); ++t) {
        tools_[t].model.push_back(w.local_contact[t]);
        tools_[t].model.back().time += recording_.slip[pass_ - 1];
    }
}

std::string LiveReplay::difference() const {
    const uint64_t hash = state_hash(frame_.world());
    if (different_ticks_ > 0)
        return format("%llu haptic ticks gave another force or torque, the first at %.3f s",
                      static_cast<unsigned long long>(different_ticks_), static_cast<double>(first_different_tick_) * 1e-3);
    return hash == recording_.state_hash ? "" : "state hash " + hex(hash) + ", recorded " + hex(recording_.state_hash);
}

}  // namespace trocar
