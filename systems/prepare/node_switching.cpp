#include "systems/prepare/node_switching.hpp"

#include <algorithm>
#include <array>
#include <span>

#include "engine/geometry/quaternion.hpp"
#include "engine/motion/node_switches.hpp"
namespace trocar {
namespace {

uint32_t buttons_down(const Haptics& haptics, uint32_t tool) {
    if (tool != kNone) return haptics.state[tool].device.buttons;
    uint32_t down = 0;
    for (const ToolState& t : haptics.state) down |= t.device.buttons;
    return down;
}

// Whether a switch acts now; records the buttons and events it has seen.
bool is_due(double time, const NodeSwitch& s, const Haptics& haptics, const NodeState& state, uint64_t& seen) {
    const uint64_t before = seen;
    if (s.buttons != 0) {
        seen = buttons_down(haptics, s.tool) & s.buttons;
        return (seen & ~before) != 0;
    }
    if (s.drive != kNone) {
        seen = state.drive[s.drive].events.count[static_cast<size_t>(s.event)];
        return seen > before;
    }
    seen = time >= s.time;
    return seen > before;
}

void wake_all(const SpawnState& spawning, Sleep& sleep) {
    for (uint32_t body = 0; body < sleep.still.size(); ++body)
        if (!is_away(spawning, body)) sleep.still[body] = 0, sleep.group[body] = kNone;
}

void let_go(ToolState& tool) {
    tool.proxy_valid = false;
    tool.contacts = 0;
    tool.contact.clear();
    tool.touched = kNone;
    tool.command = tool.output = {};
    tool.sliding = false;
    tool.carried = tool.pull = tool.pull_torque = Vec3d::Zero();
    tool.safety.contact_force = tool.safety.pull = tool.safety.contact_torque = tool.safety.pull_torque = Vec3d::Zero();
}

// Transfers the hand, with its accumulated state, to the other instrument.
void exchange(const Haptics& haptics, const ToolExchange& e, std::span<ToolState> tools, Poses& poses) {
    tools[e.to] = tools[e.from];
    let_go(tools[e.from]);
    tools[e.from].device.buttons = 0;  // its device is not held
    let_go(tools[e.to]);
    const HandTool& tool = haptics.tool[e.to];
    const DeviceState& device = tools[e.to].device;
    poses.orientation[tool.body] = device.orientation;
    poses.origin[tool.body] = device.position - rotate(device.orientation, tool.tip);
    poses.velocity[tool.body] = poses.angular_velocity[tool.body] = Vec3d::Zero();
}

// True if any was exchanged.
bool exchange_tools(double time, const Nodes& nodes, Haptics& haptics, Poses& poses, NodeState& state) {
    std::array<uint8_t, kMaxTools> laid_down{};
    std::copy(state.laid_down.begin(), state.laid_down.end(), laid_down.begin());
    bool any = false;
    for (uint32_t i = 0; i < nodes.exchange.size(); ++i) {
        const ToolExchange& e = nodes.exchange[i];
        NodeSwitch s;
        s.time = e.time, s.buttons = e.buttons;
        s.tool = laid_down[e.from] ? kNone : e.from;
        const bool due = is_due(time, s, haptics, state, state.seen[nodes.toggle.size() + i]);
        if (!due || laid_down[e.from]) continue;
        exchange(haptics, e, haptics.state, poses);
        state.laid_down[e.from] = 1, state.laid_down[e.to] = 0;
        any = true;
    }
    return any;
}

}  // namespace

void switch_nodes(double time, const Nodes& nodes, const SpawnState& spawning, Haptics& haptics, Poses& poses, NodeState& state,
                  Sleep& sleep) {
    bool changed = exchange_tools(time, nodes, haptics, poses, state);
    for (uint32_t i = 0; i < nodes.toggle.size(); ++i) {
        const NodeSwitch& s = nodes.toggle[i];
        if (!is_due(time, s, haptics, state, state.seen[i])) continue;
        const uint8_t to = s.to == 2 ? !state.enabled[s.node] : s.to;
        changed |= to != state.enabled[s.node];
        state.enabled[s.node] = to;
    }
    if (changed) {
        find_bodies_off(static_cast<uint32_t>(state.off.size()), nodes, haptics.tool, state);
        wake_all(spawning, sleep);
        for (uint32_t t = 0; t < haptics.tool.size(); ++t)
            if (is_off(state, haptics.tool[t].body)) let_go(haptics.state[t]);
    }
    // a disabled body must not fall asleep: that would clear its velocities
    for (uint32_t body = 0; body < std::min(state.off.size(), sleep.still.size()); ++body)
        if (state.off[body] && sleep.group[body] == kNone) sleep.still[body] = 0;
}

}  // namespace trocar
