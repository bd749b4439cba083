#include "engine/reach.hpp"
#include "systems/body_boxes.hpp"
#include "systems/fast_bodies.hpp"
#include "systems/frame_stages.hpp"
#include "systems/haptic_surface.hpp"
#include "systems/penetration.hpp"
#include "systems/pierced_bodies.hpp"
namespace trocar::stages {
namespace {

ContactInputs contact_inputs(const World& w) {
    const double period = period_seconds(w);
    return {w.settings.contact, period, fall_in_period(w.settings.gravity, period), surfaces_of(w), w.boxes, w.pairs, w.trees};
}

}  // namespace

void body_boxes(FrameState& f) {
    World& w = f.world;
    number_sleeps(f);
    compute_body_boxes({period_seconds(w), surfaces_of(w), w.settings.gravity, w.haptics.tool, &w.devices, &w.lives, &w.node_state},
                       w.boxes, sleepers(f, kSeenByBoxes));
}
void fast_bodies(FrameState& f) {
    World& w = f.world;
    find_fast_bodies({period_seconds(w), w.settings.gravity, surfaces_of(w), w.haptics.tool, w.devices, w.node_state}, w.fast_bodies,
                     w.boxes);
}
void joined_bodies(FrameState& f) {
    World& w = f.world;
    find_joined_bodies(w.bodies, w.links, w.haptics.tool, w.haptics.jaw, w.joined_bodies);
}
void excluded_pairs(FrameState& f) {
    World& w = f.world;
    find_pierced_bodies(w.haptics.tool, w.boxes, w.nodes.apart, w.haptics.state, w.excluded_pairs);
}
void box_pairs(FrameState& f) {
    World& w = f.world;
    update_candidate_pairs(w.bodies, w.boxes, w.excluded_pairs, f.scratch.pairs, w.box_pairs);
}
void candidate_pairs(FrameState& f) {
    World& w = f.world;
    find_reachable_pairs(period_seconds(w), w.settings.gravity, surfaces_of(w), w.boxes, w.box_pairs, f.scratch.reachable, w.pairs,
                         w.displacement_bounds, sleepers(f, kSeenByPairs));
}
void sleep(FrameState& f) {
    World& w = f.world;
    fall_asleep_and_wake({w.settings, pass_seconds(w), w.clock.period, w.bodies, w.paths, w.nodes.drive, w.joined_bodies, w.lives},
                         f.scratch.sleep, w.sleep, w.particles, w.poses, w.pairs, w.energy, w.report);
    number_sleeps(f);
}
void refit(FrameState& f) {
    World& w = f.world;
    refit_trees(w.bodies, w.particles, w.pairs, f.scratch.refit, w.trees);
}
void impact_times(FrameState& f) {
    World& w = f.world;
    find_stops(contact_inputs(w), w.fast_bodies, f.scratch.touch, w.impact_times);
}
void rasterise_bodies(FrameState& f) {
    World& w = f.world;
    rasterise(contact_inputs(w), f.limits.direct_tests, f.scratch.rasterise, w.report, w.screened, w.occupancy);
}
void candidate_cells(FrameState& f) {
    World& w = f.world;
    const DirectPairs direct{f.limits.direct_tests, w.displacement_bounds};
    find_candidate_triangles(contact_inputs(w), direct, w.screened, w.occupancy, f.scratch.cells, w.candidates);
}
void parted_triangles(FrameState& f) { drop_parted_triangles(contact_inputs(f.world), f.scratch.parted, f.world.candidates); }
void contours(FrameState& f) {
    World& w = f.world;
    find_contours(contact_inputs(w), w.candidates, f.scratch.contours, w.contours);
}
void overlap(FrameState& f) {
    World& w = f.world;
    find_overlap(contact_inputs(w), w.screened, w.candidates, f.scratch.overlap, w.report, w.near, w.contacts);
}
void edge_pass(FrameState& f) {
    World& w = f.world;
    find_edge_contacts(contact_inputs(w), w.candidates, w.near, f.scratch.edges, w.report, w.contacts);
}
void memory_order(FrameState& f) { order_memory(f.world.contact_memory, f.scratch.memory, f.world.memory_order); }
void kept_edges(FrameState& f) {
    World& w = f.world;
    keep_edges(contact_inputs(w), w.contact_memory, w.memory_order, f.scratch.memory, w.contacts);
}
void face_pass(FrameState& f) {
    World& w = f.world;
    find_face_contacts(contact_inputs(w), f.limits.face_queries, w.screened, w.candidates, w.near, f.scratch.faces, w.contacts);
}
void penetration(FrameState& f) {
    World& w = f.world;
    measure_penetrations(w.pairs, w.contacts, w.report, w.penetrations);
}
void deep_overlap(FrameState& f) {
    World& w = f.world;
    find_ways_out(contact_inputs(w), w.contacts, f.scratch.ways_before, w.pair_memory, w.penetrations);
}
void regions(FrameState& f) {
    World& w = f.world;
    find_regions(contact_inputs(w), w.screened, w.near, w.contacts, w.contours, f.scratch.regions, w.regions);
}
void contact_rows(FrameState& f) {
    World& w = f.world;
    make_contact_rows(contact_inputs(w), w.contacts, w.penetrations, f.scratch.rows, w.report, w.rows);
}
void edge_rows(FrameState& f) {
    World& w = f.world;
    add_edge_rows(contact_inputs(w), w.candidates, f.scratch.edge_rows, w.rows);
}
void loaded_rows(FrameState& f) {
    World& w = f.world;
    mark_loaded(surfaces_of(w), w.contact_memory, w.memory_order, w.rows, w.loaded_rows);
}
void idle_rows(FrameState& f) {
    World& w = f.world;
    drop_idle_rows(
        {period_seconds(w), w.settings.gravity, surfaces_of(w), w.displacement_bounds, w.loaded_rows, w.joined_bodies, w.nodes.drive},
        f.scratch.idle_rows, w.rows);
}
void implied_rows(FrameState& f) { drop_implied_rows(surfaces_of(f.world), f.scratch.implied_rows, f.world.rows); }
void warm_start(FrameState& f) { recall_contacts(f.world.contact_memory, f.world.memory_order, f.world.rows); }
void islands(FrameState& f) {
    World& w = f.world;
    find_islands(w.bodies, w.rows, f.scratch.islands, w.islands, w.joined_bodies);
}
void local_contact(FrameState& f) {
    World& w = f.world;
    const Haptics& h = w.haptics;
    w.local_contact.resize(h.tool.size());
    for (size_t t = 0; t < h.tool.size(); ++t) {
        const bool in_hand = w.node_state.laid_down.empty() || !w.node_state.laid_down[t];
        publish_local_contact(haptic_params(w.clock.contact_rate), surfaces_of(w), w.boxes.box, h.tool[t], h.state[t],
                              {pass_seconds(w), w.clock.pass + 1, period_seconds(w), in_hand}, f.scratch.local_contact, w.local_contact[t],
                              std::span(h.jaw).subspan(h.tool[t].jaws.first, h.tool[t].jaws.count));
    }
}
void haptic_surfaces(FrameState& f) {
    World& w = f.world;
    for (LocalContactModel& model : w.local_contact) publish_surfaces(w.haptics.surface, w.poses, model);
}
void drive_yield(FrameState& f) {
    World& w = f.world;
    for (size_t t = 0; t < w.haptics.tool.size(); ++t)
        publish_yield(w.nodes, w.node_state, w.bodies, w.haptics.tool[t], w.haptics.state[t], w.local_contact[t]);
}
void tissue_give(FrameState& f) {
    World& w = f.world;
    for (size_t t = 0; t < w.haptics.tool.size(); ++t)
        publish_give(surfaces_of(w), w.haptics.tool[t], w.haptics.state[t], f.scratch.local_contact, w.local_contact[t]);
}
void contact_hook(FrameState& f) {
    if (f.contact_hook.published) f.contact_hook.published(f.contact_hook.user, f.world);
}

}  // namespace trocar::stages
