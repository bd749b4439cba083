#include "systems/app/station/exercise.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

constexpr const char* kToolEvents[] = {"touch", "release", "button_down", "button_up", "pass_through", "limit"};
static_assert(std::size(kToolEvents) == static_cast<size_t>(HapticEventKind::kCount));
constexpr const char* kDriveEvents[] = {"pressed", "unpressed", "end_stop", "detent"};
static_assert(std::size(kDriveEvents) == static_cast<size_t>(NodeEventKind::kCount));

}  // namespace

std::vector<ExercisePhase> phases_of(const Exercise& exercise) {
    if (exercise.sample.empty()) return {};
    const double begin = exercise.sample.front().time, end = exercise.sample.back().time;
    std::vector<ExercisePhase> phases{{"approach", begin, end}};
    bool touched = false;
    for (const ExerciseEvent& e : exercise.event) {
        std::string name;
        if (e.kind == "touch" && !touched) name = "contact", touched = true;
        if (e.kind == "attach" || e.kind == "mark") name = e.object;
        if (e.kind == "detach") name = "after " + e.object;
        if (name.empty()) continue;
        const double at = std::clamp(e.time, begin, end);
        if (at > phases.back().from) {
            phases.back().to = at;
            phases.push_back({name, at, end});
        } else {
            phases.back().name = name;  // two at once: the later one names it
        }
    }
    return phases;
}

ExerciseRecorder::ExerciseRecorder(const Frame& frame) {
    const World& w = frame.world();
    exercise_.rate = w.clock.contact_rate;
    for (const HandTool& tool : w.haptics.tool) exercise_.tool.push_back(w.bodies.name[tool.body]);
    tool_.resize(exercise_.tool.size());
    drive_.resize(w.node_state.drive.size());
    link_.resize(w.links.group.size());
}

void ExerciseRecorder::add_tool_events(const Frame& frame, uint32_t tool) {
    const World& w = frame.world();
    const HapticEvents& events = w.haptics.state[tool].events;
    uint64_t& seen = tool_[tool].events;
    if (events.total - seen > kKeptEvents) exercise_.lost_events += events.total - seen - kKeptEvents, seen = events.total - kKeptEvents;
    for (; seen < events.total; ++seen) {
        const HapticEvent& e = events.last[seen % kKeptEvents];
        const bool passes = e.kind == HapticEventKind::kPassThrough && e.value < w.bodies.name.size();
        exercise_.event.push_back({e.time, kToolEvents[static_cast<size_t>(e.kind)], passes ? w.bodies.name[e.value] : "", tool});
    }
}

void ExerciseRecorder::add_link_events(const Frame& frame) {
    const World& w = frame.world();
    link_.resize(std::max(link_.size(), w.links.group.size()));
    for (size_t g = 0; g < w.links.group.size(); ++g) {
        const LinkGroup& group = w.links.group[g];
        SeenLink& seen = link_[g];
        const bool holds = group.body != kNone && group.phase == LinkPhase::kHolding && group.links.count > 0;
        const double time = 1e-3 * static_cast<double>(w.clock.tick);
        if (holds != seen.holds) exercise_.event.push_back({time, holds ? "attach" : "detach", group.name});
        if (group.broken > seen.broken) exercise_.event.push_back({time, "torn", group.name});
        seen = {holds, group.broken};
    }
}

void ExerciseRecorder::add_node_events(const Frame& frame) {
    const World& w = frame.world();
    for (size_t d = 0; d < w.node_state.drive.size(); ++d) {
        const NodeEvents& events = w.node_state.drive[d].events;
        uint64_t& seen = drive_[d].events;
        if (events.total - seen > kKeptNodeEvents)
            exercise_.lost_events += events.total - seen - kKeptNodeEvents, seen = events.total - kKeptNodeEvents;
        for (; seen < events.total; ++seen) {
            const NodeEvent& e = events.last[seen % kKeptNodeEvents];
            exercise_.event.push_back({e.time, kDriveEvents[static_cast<size_t>(e.kind)], w.bodies.name[w.nodes.drive[d].body]});
        }
    }
}

// Forces of the tool's parts (the instrument and each jaw) on every other body. A pinch cancels in the sum, a pull is shared by the
// jaws: what the organ bears is taken as the larger of the net force and that of the strongest part.
void ExerciseRecorder::add_organ_forces(const Frame& frame, uint32_t tool, ExerciseSample& sample) {
    const World& w = frame.world();
    const double seconds = 1e-3 * w.clock.period;
    touched_.clear(), touched_force_.clear();
    const auto add = [&](uint32_t part, uint32_t organ, const Vec3d& force) {
        if (tool_of_body_[part] != tool || tool_of_body_[organ] == tool || force == Vec3d::Zero()) return;
        const std::pair<uint32_t, uint32_t> key{part, organ};
        const auto at = std::ranges::find(touched_, key);
        if (at == touched_.end())
            touched_.push_back(key), touched_force_.push_back(force);
        else
            touched_force_[static_cast<size_t>(at - touched_.begin())] += force;
    };
    const ContactConstraints& c = w.contact_constraints;
    for (size_t i = 0; i < c.body.size(); ++i) {
        if (c.impulse[i] == Vec3d::Zero()) continue;
        add(c.body[i], c.other[i], -c.impulse[i] / seconds);
        add(c.other[i], c.body[i], c.impulse[i] / seconds);
    }
    for (const LinkGroup& g : w.links.group)
        if (g.body != kNone && g.holder != kNone) add(g.holder, g.body, g.impulse / seconds);
    sample.organs.first = static_cast<uint32_t>(exercise_.organ_force.size());
    for (size_t i = 0; i < touched_.size(); ++i) {
        const uint32_t body = touched_[i].second;
        const auto same = [&](const auto& key) { return key.second == body; };
        if (std::any_of(touched_.begin(), touched_.begin() + static_cast<ptrdiff_t>(i), same)) continue;
        Vec3d net = Vec3d::Zero();
        double strongest = 0;
        for (size_t k = i; k < touched_.size(); ++k)
            if (same(touched_[k])) net += touched_force_[k], strongest = std::max(strongest, touched_force_[k].norm());
        uint32_t& organ = organ_of_body_[body];
        if (organ == kNone) organ = static_cast<uint32_t>(exercise_.organ.size()), exercise_.organ.push_back(w.bodies.name[body]);
        exercise_.organ_force.push_back({organ, std::max(net.norm(), strongest)});
    }
    sample.organs.count = static_cast<uint32_t>(exercise_.organ_force.size()) - sample.organs.first;
}

void ExerciseRecorder::after_pass(const Frame& frame) {
    const World& w = frame.world();
    if (w.haptics.tool.empty()) return;
    organ_of_body_.resize(w.bodies.mesh.size(), kNone);
    if (tool_of_body_.size() != w.bodies.mesh.size()) {
        tool_of_body_.assign(w.bodies.mesh.size(), kNone);
        for (uint32_t t = 0; t < w.haptics.tool.size(); ++t) {
            const HandTool& tool = w.haptics.tool[t];
            tool_of_body_[tool.body] = t;
            for (uint32_t j = tool.jaws.first; j < tool.jaws.end(); ++j) tool_of_body_[w.haptics.jaw[j].body] = t;
        }
    }
    const std::vector<double>& ticks = frame.times().tick_force;
    for (uint32_t t = 0; t < w.haptics.tool.size(); ++t) {
        const ToolState& s = w.haptics.state[t];
        ExerciseSample sample;
        sample.time = 1e-3 * static_cast<double>(w.clock.tick);
        sample.tool = t;
        sample.tip = s.device.position, sample.turn = s.device.orientation, sample.proxy = s.proxy_valid ? s.proxy : s.device.position;
        sample.grip = s.device.grip, sample.buttons = s.device.buttons;
        sample.hand = s.output.force, sample.torque = s.output.torque;
        sample.hand_peak = s.output.force.norm();
        for (size_t ms = 0; ms < w.clock.period && (t + 1) * w.clock.period <= ticks.size(); ++ms)
            sample.hand_peak = std::max(sample.hand_peak, ticks[t * w.clock.period + ms]);
        sample.tissue = s.contact_impulse / (1e-3 * w.clock.period);
        sample.contacts = s.contacts;
        add_organ_forces(frame, t, sample);
        add_tool_events(frame, t);
        exercise_.sample.push_back(sample);
    }
    add_link_events(frame);
    add_node_events(frame);
}

void ExerciseRecorder::add_ticks(std::span<const LiveTick> ticks, std::span<const double> slip) {
    const size_t tools = exercise_.tool.size();
    if (tools == 0) return;
    std::vector<size_t> at(tools, 0);  // pass
    for (const LiveTick& tick : ticks) {
        size_t& pass = at[tick.tool];
        const auto ends = [&](size_t k) { return exercise_.sample[k * tools].time + (k < slip.size() ? slip[k] : 0); };
        while ((pass + 1) * tools < exercise_.sample.size() && ends(pass) < tick.time) ++pass;
        if (pass * tools + tick.tool >= exercise_.sample.size()) continue;
        double& peak = exercise_.sample[pass * tools + tick.tool].hand_peak;
        peak = std::max(peak, tick.force.norm());
    }
}

}  // namespace trocar
