#include "systems/frame_state.hpp"

namespace trocar {

Sleepers sleepers(FrameState& f, SleeperStage stage) {
    if (f.options.look_at_sleepers) return {};
    std::vector<uint64_t>& seen = f.scratch.seen[stage];
    seen.resize(f.scratch.sleeps.size(), 0);
    return {f.scratch.sleeps, seen};
}

void number_sleeps(FrameState& f) {
    const World& w = f.world;
    f.scratch.sleeps.resize(w.bodies.mesh.size(), 0);
    for (uint32_t body = 0; body < f.scratch.sleeps.size(); ++body) {
        uint64_t& sleep = f.scratch.sleeps[body];
        sleep = !lies_asleep(w.sleep, body) ? 0 : sleep != 0 ? sleep : ++f.scratch.last_sleep;
    }
}

std::span<const std::array<uint32_t, 2>> linked_bodies(FrameState& f) {
    joined_by_links(f.world.bodies, f.world.links, f.scratch.joined);
    for (const HandTool& tool : f.world.haptics.tool)
        for (uint32_t j = tool.jaws.first; j < tool.jaws.end(); ++j) f.scratch.joined.push_back({tool.body, f.world.haptics.jaw[j].body});
    return f.scratch.joined;
}

OtherForces other_forces(FrameState& f) {
    World& w = f.world;
    OtherForces other{&w.solids};
    if (!w.links.group.empty()) other.links = &w.links, other.holding = &f.scratch.holding;
    if (!w.nodes.drive.empty()) other.nodes = &w.nodes, other.node_state = &w.node_state;
    if (!w.tears.body.empty()) other.tears = &w.tears, other.torn = &w.torn, other.torn_springs = &w.torn_springs;
    return other;
}

EnergyInputs energy_inputs(FrameState& f, const OtherForces& other) {
    const World& w = f.world;
    return {w.springs, w.bodies, w.poses, w.particles, w.anchors, w.settings.gravity, other};
}

}  // namespace trocar
