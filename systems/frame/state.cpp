#include "systems/frame/state.hpp"

#include "systems/prepare/lens_fog.hpp"

namespace trocar {

SleepingBodies sleeping_bodies(FrameState& f, SleepStage stage) {
    if (f.options.update_sleeping_bodies) return {};
    SleeperCache& cache = f.scratch.sleeping_bodies;
    cache.seen[stage].resize(cache.number.size(), 0);
    return {cache.number, cache.seen[stage]};
}

void number_sleeps(FrameState& f) {
    const World& w = f.world;
    SleeperCache& cache = f.scratch.sleeping_bodies;
    cache.number.resize(w.bodies.mesh.size(), 0);
    cache.generation.resize(w.spawning.generation.size(), 0);
    for (uint32_t body = 0; body < cache.generation.size(); ++body)
        if (std::exchange(cache.generation[body], w.spawning.generation[body]) != w.spawning.generation[body]) cache.number[body] = 0;
    for (uint32_t body = 0; body < cache.number.size(); ++body) {
        uint64_t& number = cache.number[body];
        number = !lies_asleep(w.sleep, body) ? 0 : number != 0 ? number : ++cache.last;
    }
}

OtherForces other_forces(World& w) {
    OtherForces other{&w.solids};
    if (!w.links.group.empty()) other.links = &w.links, other.holding = &w.holding_groups;
    if (!w.nodes.drive.empty()) other.nodes = &w.nodes, other.node_state = &w.node_state;
    if (!w.tears.body.empty()) other.tears = &w.tears, other.torn = &w.torn, other.torn_springs = &w.torn_springs;
    if (!w.relaxation.body.empty()) other.relaxation = &w.relaxation;
    if (!w.actions.action.empty()) other.actions = &w.actions, other.action_state = &w.action_state;
    if (!w.threads.thread.empty()) other.threads = &w.threads, other.thread_state = &w.thread_state;
    return other;
}

EnergyInputs energy_inputs(World& w) { return {w.springs, w.bodies, w.poses, w.particles, w.anchors, w.settings.gravity, other_forces(w)}; }

PictureInputs picture_inputs(const World& w, const SurfaceNormals& normals, PictureLiquidScratch& liquid) {
    return {.number = w.clock.picture,
            .time = pass_seconds(w),
            .surfaces = surfaces_of(w),
            .normals = normals,
            .contacts = w.contacts,
            .penetrations = w.penetrations,
            .haptics = w.haptics,
            .tears = &w.tears,
            .spawning = &w.spawning,
            .node_state = &w.node_state,
            .links = &w.links,
            .actions = &w.actions,
            .action_state = &w.action_state,
            .solids = &w.solids,
            .fluids = &w.fluids,
            .fluid_state = &w.fluid_state,
            .liquid = &liquid,
            .fog = w.lenses.lens.empty() ? 0.0 : fog_of(w.lenses.lens[0]),
            .threads = &w.threads,
            .thread_state = &w.thread_state};
}

}  // namespace trocar
