#include "systems/frame_stages.hpp"
#include "systems/haptic_frame_ticks.hpp"
#include "systems/haptic_input.hpp"
namespace trocar::stages {

void holding_groups(FrameState& f) {
    find_holding_groups(f.world.links, static_cast<uint32_t>(f.world.bodies.mesh.size()), f.world.holding_groups);
}
void advance(FrameState& f) {
    World& w = f.world;
    f.times.tick_ns.assign(w.haptics.tool.size() * w.clock.period, 0);
    FrameTicks ticks{w.clock, w.local_contact, f.scratch.haptic, w.haptics, w.devices, f.times.tick_ns};
    AdvanceIslandsParams params;
    params.island.tick = w.clock.tick;
    params.island.ticks = w.clock.period;
    params.island.gravity = w.settings.gravity;
    params.island.contact = w.settings.contact;
    params.island.account_energy = f.options.account_energy;
    params.substep = w.settings.substep;
    if (!f.options.external_ticks && !w.haptics.tool.empty()) params.ticks = {run_frame_ticks, &ticks};
    params.trace = {f.options.trace, f.island_name, static_cast<uint32_t>(w.clock.pass)};
    const AdvanceInputs inputs{w.meshes,         w.springs,          w.bodies,        w.anchors,      w.paths,      w.haptics.tool,
                               w.devices.placed, w.clock.period + 1, other_forces(w), w.impact_times, w.haptics.jaw};
    advance_islands(params, inputs, {w.islands, w.sleep, w.node_state}, f.scratch.advance, {w.particles, w.poses, w.rows, w.haptics.state},
                    w.energy, w.report, f.times.response_ns);
}
void contact_memory(FrameState& f) { remember_contacts(f.world.rows, f.world.contact_memory); }
void link_forces(FrameState& f) {
    World& w = f.world;
    note_link_forces(period_seconds(w), w.haptics.tool, w.haptics.jaw, w.links, w.haptics.state);
}
void hand_forces(FrameState& f) { end_hand_pass(period_seconds(f.world), !f.options.external_ticks, f.world.haptics); }

}  // namespace trocar::stages
