#include "systems/prepare/link_bodies.hpp"

#include <algorithm>
namespace trocar {
namespace {

void wake(Sleep& sleep, uint32_t body) {
    if (body < sleep.still.size()) sleep.still[body] = 0;
}

bool wants_to_hold(const LinkGroup& g, double now, std::span<const ToolState> tools) {
    if (g.tool != kNone) return g.tool < tools.size() && (tools[g.tool].device.buttons & 1) != 0;
    return now >= g.begin && now < g.end;
}

}  // namespace

void link_bodies(double now, std::span<const ToolState> tools, const LinkWorld& world, LinkScratch& scratch, Links& links, Sleep& sleep,
                 Energy& energy, Report& report) {
    if (links.group.empty()) return;
    const uint64_t broken = static_cast<uint64_t>(std::count(links.whole.begin(), links.whole.end(), uint8_t{0}));
    drop_broken_links(links);
    bool changed = broken > 0 || links.stable_dt.size() != world.surfaces.bodies.mesh.size();
    for (uint32_t index = 0; index < links.group.size(); ++index) {
        LinkGroup& g = links.group[index];
        g.impulse.setZero();
        if (g.body == kNone || g.phase == LinkPhase::kDone) continue;
        const bool holds = g.phase == LinkPhase::kHolding, wants = wants_to_hold(g, now, tools);
        if (holds == wants) continue;
        if (wants && make_links(world, index, scratch, links, energy) == 0) continue;
        if (!wants) release_links(index, g.tool != kNone, links, energy);
        wake(sleep, g.body);
        wake(sleep, g.holder);
        changed = true;
    }
    if (changed) update_link_limits(world.surfaces.bodies, world.solids, world.surfaces.particles, scratch, links);
    report.links = links.node.size();
}

void note_link_forces(double seconds, std::span<const HandTool> tools, std::span<const ToolJaw> jaws, const Actions& actions, Links& links,
                      ActionState& action_state, std::span<ToolState> states) {
    for (LinkGroup& g : links.group) g.largest_force = std::max(g.largest_force, g.impulse.norm() / seconds);
    const auto holds = [&](const HandTool& tool, uint32_t body) {
        bool any = body == tool.body;
        for (const ToolJaw& jaw : jaws.subspan(tool.jaws.first, tool.jaws.count)) any = any || body == jaw.body;
        return any;
    };
    for (size_t t = 0; t < tools.size(); ++t) {
        states[t].link_force_before = states[t].link_force;
        states[t].link_force.setZero();
        for (const LinkGroup& g : links.group) {
            if (g.body != kNone && holds(tools[t], g.holder)) states[t].link_force -= g.impulse / seconds;
        }
    }
    for (ToolGrasp& grasp : action_state.grasp) {
        const uint32_t group = find_link_group(links, grasp.group);
        if (group == kNone) states[actions.action[grasp.action].tool].link_force -= grasp.impulse / seconds;
        const double force = group == kNone ? grasp.impulse.norm() / seconds : links.group[group].largest_force;
        grasp.largest_force = std::max(grasp.largest_force, force);
    }
}

void find_joined_bodies(const Bodies& bodies, const Links& links, std::span<const HandTool> tools, std::span<const ToolJaw> jaws,
                        const Actions& actions, std::span<const ToolGrasp> grasps, std::vector<std::array<uint32_t, 2>>& joined) {
    joined_by_links(bodies, links, joined);
    for (const HandTool& tool : tools)
        for (const ToolJaw& jaw : jaws.subspan(tool.jaws.first, tool.jaws.count)) joined.push_back({tool.body, jaw.body});
    for (const ToolGrasp& grasp : grasps) joined.push_back({tools[actions.action[grasp.action].tool].body, grasp.body});
}

}  // namespace trocar
