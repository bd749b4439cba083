#include <algorithm>

#include "engine/contact/displacement_bound.hpp"
#include "systems/detect/broad/body_boxes.hpp"
#include "systems/detect/broad/continuous_collision.hpp"
#include "systems/detect/broad/rounds.hpp"
#include "systems/detect/narrow/penetration.hpp"
#include "systems/detect/narrow/pierced_bodies.hpp"
#include "systems/detect/narrow/tools_inside.hpp"
#include "systems/frame/state.hpp"
#include "systems/haptics/contact/surface_feel.hpp"
#include "systems/haptics/frame_ticks.hpp"
#include "systems/haptics/input.hpp"
#include "systems/prepare/lens_fog.hpp"
#include "systems/prepare/node_switching.hpp"
#include "systems/prepare/rigid_motion.hpp"
#include "systems/prepare/spawning.hpp"
#include "systems/prepare/tear_bodies.hpp"
#include "systems/prepare/tool_actions.hpp"
#include "systems/prepare/tool_cuts.hpp"
#include "systems/prepare/tool_heat.hpp"
#include "systems/prepare/tool_sutures.hpp"
namespace trocar {
namespace {

bool any_link(const World& w);
bool any_threaded_tool(const World& w);
bool any_threaded_pair(const World& w);

// Functions of the table below, in its order: each passes columns of the world and scratch to one system.
namespace stages {
void device_input(World& w, FrameState& f) {
    if (f.options.external_ticks)
        follow_devices(w.clock, w.haptics, w.live_devices, w.devices);
    else
        sample_devices(w.clock, w.paths, w.haptics, w.devices);
}
void nodes(World& w, FrameState&) { switch_nodes(pass_seconds(w), w.nodes, w.spawning, w.haptics, w.poses, w.node_state, w.sleep); }
void rigid_motion(World& w, FrameState&) { follow_paths(w.paths, pass_seconds(w), w.node_state.off, w.poses); }
void bodies_come_and_go(World& w, FrameState& f) {
    spawning({w.clock.tick, f.options.account_energy, w.pools, w.meshes, w.solids, w.springs, w.bodies, w.anchors, w.settings.gravity},
             f.scratch.spawning, {w.spawning, w.poses, w.particles, w.sleep, w.energy});
}
ActionPass action_pass(const World& w) {
    return {pass_seconds(w), {surfaces_of(w), w.solids, w.trees}, w.haptics.tool, w.haptics.jaw, w.haptics.state,
            w.actions,       &w.spawning,                         &w.node_state,  &w.nodes,       period_seconds(w)};
}
void actions(World& w, FrameState& f) { act(action_pass(w), f.scratch.links, w.action_state, w.links, w.sleep, w.energy); }
void heat(World& w, FrameState&) {
    heat_with_tools(action_pass(w), w.action_state, {w.anchors, w.settings.gravity, w.springs, w.solids, w.tears, w.torn, w.torn_springs, w.sleep,
                                                       w.energy});
}
void sutures(World& w, FrameState& f) {
    sew(action_pass(w), w.settings.gravity, w.threads, f.scratch.sew, w.action_state, w.thread_state, w.sleep, w.energy);
}
void link(World& w, FrameState& f) {
    link_bodies(pass_seconds(w), w.haptics.state, {surfaces_of(w), w.solids, w.trees}, f.scratch.links, w.links, w.sleep, w.energy,
                w.report);
}
void tear(World& w, FrameState&) {
    const TearPass pass{pass_seconds(w), w.settings.gravity, w.springs, w.solids, w.bodies, w.poses, w.anchors};
    const TearState state{w.torn, w.torn_springs, w.energy, w.report};
    if (!w.actions.heat_body.empty()) part_what_boiled(pass, w.actions, w.action_state.heat, w.particles, w.meshes, w.tears, state);
    cut_bodies(pass, w.particles, w.meshes, w.trees, w.tears, w.sleep, state);
}
void torn_springs(World& w, FrameState&) { copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs); }

void tool_cuts(World& w, FrameState&) {
    cut_with_tools({w.bodies, w.actions, w.haptics.tool, w.settings.gravity, period_seconds(w), any_link(w) || any_threaded_tool(w), w.poses,
                    w.particles, w.meshes, w.springs, w.solids, w.anchors, w.trees, w.haptics.state, w.action_state, w.sleep, w.energy});
}

void lens_fog(World& w, FrameState&) { fog_lenses(period_seconds(w), {surfaces_of(w), w.solids, w.trees}, w.spawning, w.node_state, w.lenses.lens); }

ContactInputs contact_inputs(const World& w, const FrameState& f) {
    const double period = period_seconds(w);
    return {w.settings.contact, period, fall_in_period(w.settings.gravity, period), surfaces_of(w), w.boxes, w.pairs, w.trees, &f.hulls};
}

void body_boxes(World& w, FrameState& f) {
    number_sleeps(f);
    w.report.unswept_bodies +=
        compute_body_boxes({period_seconds(w), surfaces_of(w), w.settings.gravity, w.haptics.tool, &w.devices, &w.spawning, &w.node_state},
                           w.boxes, sleeping_bodies(f, kSeenByBoxes));
}
void fast_bodies(World& w, FrameState&) {
    find_ccd_bodies({period_seconds(w), w.settings.gravity, surfaces_of(w), w.haptics.tool, w.devices, w.node_state}, w.fast_bodies,
                    w.boxes);
}
void joined_bodies(World& w, FrameState&) {
    find_joined_bodies(w.bodies, w.links, w.haptics.tool, w.haptics.jaw, w.actions, w.action_state.grasp, w.joined_bodies);
}
void threaded_bodies(World& w, FrameState&) { join_threaded_bodies(w.bodies, w.thread_state, w.joined_bodies); }
void excluded_pairs(World& w, FrameState&) {
    find_pierced_bodies(w.haptics.tool, w.boxes, w.nodes.apart, w.haptics.state, w.excluded_pairs);
}
void box_pairs(World& w, FrameState& f) { update_candidate_pairs(w.bodies, w.boxes, w.excluded_pairs, f.scratch.pairs, w.box_pairs); }
void broad_phase_pairs(World& w, FrameState& f) {
    find_reachable_pairs(period_seconds(w), w.settings.gravity, surfaces_of(w), w.boxes, w.box_pairs, f.scratch.reachable, w.pairs,
                         w.displacement_bounds, sleeping_bodies(f, kSeenByPairs));
    w.report.deferred_pairs += defer_pairs(surfaces_of(w), w.clock.tick, w.pairs);
}
void sleep(World& w, FrameState& f) {
    fall_asleep_and_wake({w.settings, pass_seconds(w), w.clock.period, w.bodies, w.paths, w.nodes.drive, w.joined_bodies, w.spawning, w.springs,
                          w.relaxation},
                         f.scratch.sleep, w.sleep, w.particles, w.poses, w.pairs, w.energy, w.report);
    number_sleeps(f);
}
void refit(World& w, FrameState& f) { refit_trees(w.bodies, w.particles, w.pairs, f.scratch.refit, w.trees); }
void impact_times(World& w, FrameState& f) {
    find_times_of_impact(contact_inputs(w, f), w.fast_bodies, f.scratch.pair_time_of_impact, w.impact_times);
}
void rasterise_bodies(World& w, FrameState& f) {
    rasterise(contact_inputs(w, f), f.limits.direct_tests, f.scratch.rasterise, w.report, w.screened, w.occupancy);
}
void candidate_cells(World& w, FrameState& f) {
    const DirectPairs direct{f.limits.direct_tests, w.displacement_bounds};
    find_candidate_triangles(contact_inputs(w, f), direct, w.screened, w.occupancy, f.scratch.cells, w.candidates);
}
void parted_triangles(World& w, FrameState& f) { cull_by_separating_axis(contact_inputs(w, f), f.scratch.separating_axis, w.candidates); }
void contours(World& w, FrameState& f) { find_contours(contact_inputs(w, f), w.candidates, f.scratch.contours, w.contours); }
void overlap(World& w, FrameState& f) {
    find_overlap(contact_inputs(w, f), w.screened, w.candidates, f.scratch.overlap, w.report, w.near, w.contacts);
}
void edge_pass(World& w, FrameState& f) {
    find_edge_contacts(contact_inputs(w, f), w.candidates, w.near, f.scratch.edges, w.report, w.contacts);
}
void memory_order(World& w, FrameState& f) { order_memory(w.contact_memory, f.scratch.memory, w.memory_order); }
void kept_edges(World& w, FrameState& f) { keep_edges(contact_inputs(w, f), w.contact_memory, w.memory_order, f.scratch.memory, w.contacts); }
void face_pass(World& w, FrameState& f) {
    find_face_contacts(contact_inputs(w, f), f.limits.face_queries, w.screened, w.candidates, w.near, f.scratch.faces, w.contacts);
}
void convex_manifolds(World& w, FrameState& f) { find_convex_manifolds(contact_inputs(w, f), f.scratch.manifolds, w.contacts); }
void penetration(World& w, FrameState&) { measure_penetrations(w.pairs, w.contacts, w.report, w.penetrations); }
void deep_overlap(World& w, FrameState& f) {
    find_separation_directions(contact_inputs(w, f), w.contacts, f.scratch.directions_before, w.pair_memory, w.penetrations, w.sleep.still);
    find_parting_pairs(contact_inputs(w, f), w.contacts, w.clock.tick, w.spawning, f.scratch.parting_pairs, w.pair_memory, w.penetrations,
                       w.sleep.still);
}
void regions(World& w, FrameState& f) {
    find_regions(contact_inputs(w, f), w.screened, w.near, w.contacts, w.contours, f.scratch.regions, w.regions);
}
void tools_inside(World& w, FrameState& f) { find_tools_inside(contact_inputs(w, f), w.contacts, w.haptics, w.report); }
void contact_constraints(World& w, FrameState& f) {
    make_contact_constraints(contact_inputs(w, f), w.contacts, w.penetrations, f.scratch.constraints, w.report, w.contact_constraints,
                             w.haptics);
}
void edge_constraints(World& w, FrameState& f) {
    add_edge_constraints(contact_inputs(w, f), w.candidates, w.penetrations, f.scratch.edge_constraints, w.contact_constraints);
}
void loaded_constraints(World& w, FrameState&) {
    mark_loaded(surfaces_of(w), w.contact_memory, w.memory_order, w.contact_constraints, w.loaded_constraints);
}
void culled_constraints(World& w, FrameState& f) {
    cull_constraints({period_seconds(w), w.settings.gravity, surfaces_of(w), w.displacement_bounds, w.loaded_constraints, w.joined_bodies,
                      w.nodes.drive},
                     f.scratch.culled_constraints, w.contact_constraints);
}
void redundant_constraints(World& w, FrameState& f) {
    drop_redundant_constraints(surfaces_of(w), f.scratch.redundant_constraints, w.contact_constraints);
}
void warm_start(World& w, FrameState&) { recall_contacts(w.contact_memory, w.memory_order, w.contact_constraints); }
bool any_pair(const World& w) {
    return w.bodies.motion.size() > 1 && std::any_of(w.bodies.motion.begin(), w.bodies.motion.end(), joins_islands);
}
void self_contacts(World& w, FrameState& f) {
    const double period = period_seconds(w);
    find_self_contacts({period, fall_in_period(w.settings.gravity, period), surfaces_of(w), w.pairs, w.springs, w.sleep, w.crossed_surfaces, !any_pair(w)},
                       f.scratch.self_contacts, w.report, w.self_contacts, w.contact_constraints);
    note_start(surfaces_of(w), w.springs, w.sleep, w.self_contact_start);
}
void islands(World& w, FrameState& f) { find_islands(w.bodies, w.contact_constraints, f.scratch.islands, w.islands, w.joined_bodies); }
// Number of a local contact model: that of its pass, and in the upper half when in the pass its round began.
uint64_t model_sequence(const Clock& clock) { return clock.pass + 1 + ((clock.tick - pass_tick(clock.pass, clock.contact_rate)) << 32); }
void local_contact(World& w, FrameState& f) {
    const Haptics& h = w.haptics;
    w.local_contact.resize(h.tool.size());
    const Poses* poses = &w.poses;
    if (std::ranges::any_of(w.paths.body, [](uint32_t body) { return body != kNone; })) {
        f.scratch.foreseen = w.poses;
        foresee_paths(w.paths, pass_seconds(w), period_seconds(w), w.node_state.off, f.scratch.foreseen);
        poses = &f.scratch.foreseen;
    }
    for (size_t t = 0; t < h.tool.size(); ++t) {
        const bool in_hand = w.node_state.laid_down.empty() || !w.node_state.laid_down[t];
        publish_local_contact(haptic_params(w.clock.contact_rate), {w.meshes, w.bodies, *poses, w.particles}, w.boxes.box, h.tool[t],
                              h.state[t], {pass_seconds(w), model_sequence(w.clock), period_seconds(w), in_hand}, f.scratch.local_contact,
                              w.local_contact[t], std::span(h.jaw).subspan(h.tool[t].jaws.first, h.tool[t].jaws.count));
    }
}
void haptic_surfaces(World& w, FrameState&) {
    for (LocalContactModel& model : w.local_contact) publish_surfaces(w.haptics.surface, w.poses, model);
}
void drive_yield(World& w, FrameState&) {
    for (size_t t = 0; t < w.haptics.tool.size(); ++t)
        publish_yield(w.nodes, w.node_state, w.bodies, w.haptics.tool[t], w.haptics.state[t], w.local_contact[t]);
}
void tissue_give(World& w, FrameState& f) {
    for (size_t t = 0; t < w.haptics.tool.size(); ++t)
        publish_compliance(surfaces_of(w), w.haptics.tool[t], w.haptics.state[t], f.scratch.local_contact, w.local_contact[t]);
}
void contact_hook(World& w, FrameState& f) {
    if (f.contact_hook.published) f.contact_hook.published(f.contact_hook.user, w);
}

void holding_groups(World& w, FrameState&) { find_holding_groups(w.links, static_cast<uint32_t>(w.bodies.mesh.size()), w.holding_groups); }
void advance(World& w, FrameState& f) {
    f.times.tick_ns.assign(w.haptics.tool.size() * w.clock.period, 0);
    f.times.tick_force.assign(f.times.tick_ns.size(), 0);
    FrameTicks ticks{w.clock, w.local_contact, f.scratch.haptic, w.haptics, w.devices, f.times.tick_ns, f.times.tick_force};
    AdvanceIslandsParams params;
    params.island.tick = w.clock.tick;
    params.island.ticks = w.clock.period;
    params.island.gravity = w.settings.gravity;
    params.island.contact = w.settings.contact;
    params.island.account_energy = f.options.account_energy;
    params.substep = w.settings.substep;
    if (!f.options.external_ticks && !w.haptics.tool.empty()) params.ticks = {run_frame_ticks, &ticks};
    params.trace = {f.options.trace, f.island_name, static_cast<uint32_t>(w.clock.pass)};
    AdvanceInputs inputs{w.meshes,         w.springs,          w.bodies,        w.anchors,      w.paths,      w.haptics.tool,
                               w.devices.placed, w.clock.period + 1, other_forces(w), w.impact_times, w.haptics.jaw};
    PartingBodiesScratch& parting = f.scratch.parting_bodies;
    const bool parts = w.settings.contact.deep == DeepResponse::kNone && !w.pair_memory.a.empty();
    // a thread that lies on a body does not hold it
    const size_t held = w.joined_bodies.size() - (any_threaded_pair(w) ? count_touch_joins(w.bodies, w.thread_state) : 0);
    if (parts) find_parting_contacts(inputs, {w.pair_memory, std::span(w.joined_bodies).first(held), w.nodes}, w.particles, w.poses, w.contact_constraints, parting);
    if (parts) inputs.left = parting.left;
    advance_islands(params, inputs, {w.islands, w.sleep, w.node_state}, f.scratch.advance,
                    {w.particles, w.poses, w.contact_constraints, w.haptics.state}, w.energy, w.report, f.times.response_ns);
    if (!parts) return;
    const double left = part_bodies(inputs, params.island, period_seconds(w), parting, w.pair_memory, w.particles, w.poses, w.energy.work_push);
    w.report.deepest_residual = std::max(w.report.deepest_residual, left);
}
void passed_surfaces(World& w, FrameState& f) {
    find_passed_surfaces(pass_seconds(w), surfaces_of(w), w.local_contact, w.haptics, f.scratch.passed_surfaces, w.passed_surfaces,
                         w.report);
}
void contact_memory(World& w, FrameState&) { remember_contacts(w.contact_constraints, w.contact_memory); }
void self_contact_forces(World& w, FrameState&) { remember_self_contacts(w.contact_constraints, w.self_contacts); }
void held_surfaces(World& w, FrameState& f) {
    f.scratch.untangle.before = w.crossed_surfaces;
    hold_surfaces(w.self_contact_start, w.meshes, energy_inputs(w), w.sleep, f.options.account_energy, f.scratch.held_surfaces,
                  {w.particles, w.energy, w.report, w.crossed_surfaces});
    const Surfaces surfaces = surfaces_of(w);
    const EnergyInputs energy = energy_inputs(w);
    untangle({surfaces, w.pairs, w.sleep, energy, f.options.account_energy, w.self_contact_start, f.scratch.untangle.before}, f.scratch.untangle, w.particles, w.energy, w.report,
             w.crossed_surfaces);
}
void link_forces(World& w, FrameState&) {
    note_link_forces(period_seconds(w), w.haptics.tool, w.haptics.jaw, w.actions, w.links, w.action_state, w.haptics.state);
}
void hand_forces(World& w, FrameState& f) { end_hand_pass(w.clock, !f.options.external_ticks, w.haptics); }

void threads(World& w, FrameState& f) {
    step_lone_threads({period_seconds(w), w.settings.gravity, w.bodies, w.poses}, w.threads, f.scratch.lone_threads, w.thread_state,
                      w.energy);
}
void thread_forces(World& w, FrameState&) {
    note_thread_forces(period_seconds(w), w.threads, !any_link(w), w.thread_state, w.haptics.state);
}

FluidPass fluid_pass(const World& w) {
    return {pass_seconds(w), period_seconds(w), surfaces_of(w), w.fluids, w.haptics.tool,       w.actions,
            w.action_state,  w.node_state,      w.links,        w.solids, w.contact_constraints};
}
void fluid_sources(World& w, FrameState& f) { run_sources(fluid_pass(w), f.scratch.fluid_sources, w.fluid_state); }
void films(World& w, FrameState& f) { flow_films(fluid_pass(w), f.scratch.films, w.fluid_state); }
void drops(World& w, FrameState& f) { move_drops(fluid_pass(w), w.trees, f.scratch.drops, w.fluid_state); }

void surface_normals(World& w, FrameState& f) {
    compute_surface_normals(surfaces_of(w), f.scratch.normals, w.normals, sleeping_bodies(f, kSeenByNormals));
}
void self_crossings(World& w, FrameState& f) {
    count_self_crossings(w.clock.picture, surfaces_of(w), w.sleep, f.scratch.crossing_faces, w.self_crossings, w.report);
}
void energy(World& w, FrameState& f) {
    measure_energy(energy_inputs(w), w.energy_start, f.scratch.energy, w.energy, sleeping_bodies(f, kSeenByEnergy));
}
void picture(World& w, FrameState& f) {
    write_picture_snapshot(picture_inputs(w, w.normals, f.scratch.picture_liquid), w.picture, sleeping_bodies(f, kSeenByPicture));
}
}  // namespace stages

template <void (*stage)(World&, FrameState&)>
void run(FrameState& frame) {
    stage(frame.world, frame);
}

// Whether a scene has what stages work on.
bool any_path(const World& w) {
    return std::any_of(w.paths.body.begin(), w.paths.body.end(), [](uint32_t body) { return body != kNone; });
}
bool any_switch(const World& w) { return !w.nodes.toggle.empty() || !w.nodes.exchange.empty(); }
bool any_pool(const World& w) { return !w.pools.slots.empty(); }
bool any_tool(const World& w) { return !w.haptics.tool.empty(); }
using stages::any_pair;
bool any_self_contact(const World& w) {
    return std::any_of(w.bodies.self_contact.begin(), w.bodies.self_contact.end(), [](double distance) { return distance > 0; });
}
bool wants_regions(const World& w) { return w.settings.contact.regions && any_pair(w); }
bool wants_contours(const World& w) { return (w.settings.contact.contours && any_pair(w)) || wants_regions(w); }
bool wants_faces(const World& w) { return w.settings.contact.faces && any_pair(w); }
bool wants_separation_directions(const World& w) {
    return any_pair(w) && (w.settings.contact.deep != DeepResponse::kNone || !w.bodies.rigid_mass.empty() || !w.particles.offset.empty());
}
bool any_mover(const World& w) { return any_tool(w) || std::any_of(w.bodies.motion.begin(), w.bodies.motion.end(), joins_islands); }
bool any_deformable(const World& w) { return !w.particles.offset.empty(); }
bool any_energy(const World& w) { return any_deformable(w) || !w.bodies.rigid_mass.empty() || !w.threads.thread.empty(); }
bool any_body(const World& w) { return !w.bodies.mesh.empty(); }

// Or room for groups: links may come while it runs.
bool any_link(const World& w) { return w.links.group.capacity() > 0; }
bool any_action(const World& w) { return !w.actions.action.empty(); }
bool any_heat(const World& w) { return !w.actions.heat_body.empty(); }
bool any_tool_cut(const World& w) { return !w.actions.cut_body.empty() || !w.actions.cut_solid.empty(); }
bool any_lens(const World& w) { return !w.lenses.lens.empty(); }
bool any_thread(const World& w) { return !w.threads.thread.empty(); }
bool any_threaded_tool(const World& w) { return any_thread(w) && any_tool(w); }
bool any_threaded_pair(const World& w) { return any_thread(w) && any_mover(w); }
bool any_fluid(const World& w) { return !w.fluids.body.empty(); }
bool any_tear(const World& w) { return !w.tears.body.empty(); }
bool any_jaw_or_link(const World& w) { return (any_pair(w) && (any_link(w) || !w.haptics.jaw.empty())) || any_threaded_pair(w); }
bool any_excluded(const World& w) { return any_pair(w) && (any_tool(w) || !w.nodes.apart.empty()); }
bool any_tool_pair(const World& w) { return any_pair(w) && any_tool(w); }
bool any_fast(const World& w) { return any_pair(w) && (any_tool(w) || !w.bodies.rigid_mass.empty()); }
bool any_free_pair(const World& w) { return any_pair(w) && !w.bodies.rigid_mass.empty(); }
bool wants_hulls(const World& w) { return any_free_pair(w) && w.settings.contact.hulls; }
bool any_tool_and_tissue(const World& w) { return any_tool(w) && any_deformable(w); }
bool any_drive(const World& w) { return any_tool(w) && !w.nodes.drive.empty(); }
bool anyone_sleeps(const World& w) { return any_energy(w) && w.settings.sleep_speed > 0; }

using R = Resource;
using S = StageId;
using P = FramePart;
constexpr ResourceMask kShapes = mask(R::kMeshes, R::kBodies, R::kPoses, R::kParticles);

// clang-format off
constexpr FrameStage kStages[] = {
    // id                   part           name               run                       reads, writes                                                                                wanted
    {S::kDeviceInput,     P::kInput,    {"device input",    run<stages::device_input>,      mask(R::kClock, R::kPaths, R::kTools),
        mask(R::kToolState, R::kDevices, R::kLiveDevices)}, any_tool},
    {S::kNodes,           P::kInput,    {"nodes",           run<stages::nodes>,             mask(R::kClock, R::kNodes, R::kTools, R::kSpawning),
        mask(R::kPoses, R::kToolState, R::kNodeState, R::kSleep)}, any_switch},
    {S::kRigidMotion,     P::kInput,    {"rigid motion",    run<stages::rigid_motion>,      mask(R::kClock, R::kPaths, R::kNodeState),
        mask(R::kPoses)}, any_path},
    {S::kComeAndGo,       P::kInput,    {"come and go",     run<stages::bodies_come_and_go>,kShapes | mask(R::kSettings, R::kSprings, R::kSolids, R::kAnchors, R::kPools, R::kClock),
        mask(R::kPoses, R::kParticles, R::kSleep, R::kSpawning, R::kEnergy)}, any_pool},
    {S::kActions,         P::kInput,    {"actions",         run<stages::actions>,           kShapes | mask(R::kSolids, R::kClock, R::kTrees, R::kTools, R::kToolState, R::kActions, R::kSpawning, R::kNodes, R::kNodeState),
        mask(R::kActionState, R::kLinks, R::kSleep, R::kEnergy)}, any_action},
    {S::kHeat,            P::kInput,    {"heat",            run<stages::heat>,              kShapes | mask(R::kSettings, R::kClock, R::kTrees, R::kTools, R::kToolState, R::kActions, R::kAnchors, R::kSpawning, R::kNodes, R::kNodeState, R::kTears, R::kTorn),
        mask(R::kActionState, R::kSprings, R::kSolids, R::kTornSprings, R::kSleep, R::kEnergy)}, any_heat},
    {S::kSutures,         P::kInput,    {"sutures",         run<stages::sutures>,           kShapes | mask(R::kSettings, R::kSolids, R::kClock, R::kTrees, R::kTools, R::kToolState, R::kActions, R::kThreads, R::kSpawning, R::kNodes, R::kNodeState),
        mask(R::kActionState, R::kThreadState, R::kSleep, R::kEnergy)}, any_thread},
    {S::kLinks,           P::kInput,    {"links",           run<stages::link>,              kShapes | mask(R::kSolids, R::kClock, R::kTrees, R::kToolState),
        mask(R::kLinks, R::kSleep, R::kEnergy, R::kReport)}, any_link},
    {S::kTears,           P::kInput,    {"tears",           run<stages::tear>,              mask(R::kSettings, R::kClock, R::kActions, R::kActionState, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kAnchors),
        mask(R::kParticles, R::kMeshes, R::kTrees, R::kTears, R::kTorn, R::kTornSprings, R::kSleep, R::kEnergy, R::kReport)}, any_tear},
    {S::kTornSprings,     P::kInput,    {"torn springs",    run<stages::torn_springs>,      mask(R::kSprings, R::kSolids, R::kBodies, R::kTears, R::kTorn),
        mask(R::kTornSprings)}, any_tear},
    {S::kToolCuts,        P::kInput,    {"tool cuts",       run<stages::tool_cuts>,         mask(R::kSettings, R::kClock, R::kBodies, R::kTools, R::kLinks),
        mask(R::kActions, R::kPoses, R::kParticles, R::kMeshes, R::kSprings, R::kSolids, R::kAnchors, R::kTrees, R::kToolState, R::kActionState, R::kSleep, R::kEnergy)}, any_tool_cut},
    {S::kLensFog,         P::kInput,    {"lens fog",        run<stages::lens_fog>,          kShapes | mask(R::kSolids, R::kClock, R::kTrees, R::kSpawning, R::kNodeState),
        mask(R::kLenses)}, any_lens},
    {S::kBodyBoxes,       P::kDetection,{"body boxes",      run<stages::body_boxes>,        kShapes | mask(R::kSettings, R::kClock, R::kTools, R::kDevices, R::kSpawning, R::kNodeState, R::kSleep),
        mask(R::kBoxes, R::kReport)}, any_pair},
    {S::kFastBodies,      P::kDetection,{"fast bodies",     run<stages::fast_bodies>,       kShapes | mask(R::kSettings, R::kClock, R::kTools, R::kDevices, R::kNodeState),
        mask(R::kBoxes, R::kFastBodies)}, any_fast},
    {S::kJoinedBodies,    P::kDetection,{"joined bodies",   run<stages::joined_bodies>,     mask(R::kBodies, R::kLinks, R::kTools, R::kActions, R::kActionState),
        mask(R::kJoinedBodies)}, any_jaw_or_link},
    {S::kThreadedBodies,  P::kDetection,{"threaded bodies", run<stages::threaded_bodies>,   mask(R::kBodies, R::kThreadState),
        mask(R::kJoinedBodies)}, any_threaded_pair},
    {S::kExcludedPairs,   P::kDetection,{"excluded pairs",  run<stages::excluded_pairs>,    mask(R::kBoxes, R::kNodes, R::kTools),
        mask(R::kToolState, R::kExcludedPairs)}, any_excluded},
    {S::kBoxPairs,        P::kDetection,{"box pairs",       run<stages::box_pairs>,         mask(R::kBodies, R::kBoxes, R::kExcludedPairs),
        mask(R::kBoxPairs)}, any_pair},
    {S::kCandidatePairs,  P::kDetection,{"candidate pairs", run<stages::broad_phase_pairs>,   kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kBoxPairs),
        mask(R::kPairs, R::kDisplacementBounds, R::kReport)}, any_pair},
    {S::kSleep,           P::kDetection,{"sleep",           run<stages::sleep>,             mask(R::kSettings, R::kBodies, R::kPaths, R::kClock, R::kJoinedBodies, R::kNodes, R::kSpawning, R::kSprings, R::kRelaxation),
        mask(R::kSleep, R::kParticles, R::kPoses, R::kPairs, R::kEnergy, R::kReport)}, anyone_sleeps},
    {S::kRefitTrees,      P::kDetection,{"refit trees",     run<stages::refit>,             kShapes | mask(R::kPairs),
        mask(R::kTrees)}, any_pair},
    {S::kImpactTimes,     P::kDetection,{"impact times",    run<stages::impact_times>,      kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kTrees, R::kFastBodies),
        mask(R::kImpactTimes)}, any_fast},
    {S::kRasterise,       P::kDetection,{"rasterise",       run<stages::rasterise_bodies>,  kShapes | mask(R::kSettings, R::kBoxes, R::kPairs),
        mask(R::kScreened, R::kOccupancy, R::kReport)}, any_pair},
    {S::kCandidateCells,  P::kDetection,{"candidate cells", run<stages::candidate_cells>,   kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kDisplacementBounds, R::kScreened, R::kOccupancy, R::kTrees),
        mask(R::kCandidates)}, any_pair},
    {S::kSeparatingAxisCulling, P::kDetection,{"separating axis culling",run<stages::parted_triangles>,  kShapes | mask(R::kSettings, R::kBoxes, R::kPairs),
        mask(R::kCandidates)}, any_pair},
    {S::kContours,        P::kDetection,{"contours",        run<stages::contours>,          kShapes | mask(R::kPairs, R::kCandidates),
        mask(R::kContours)}, wants_contours},
    {S::kOverlap,         P::kDetection,{"overlap",         run<stages::overlap>,           kShapes | mask(R::kBoxes, R::kPairs, R::kScreened, R::kCandidates, R::kTrees),
        mask(R::kNear, R::kContacts, R::kReport)}, any_pair},
    {S::kEdgePass,        P::kDetection,{"edge pass",       run<stages::edge_pass>,         kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kNear, R::kTrees, R::kBoxes),
        mask(R::kContacts, R::kReport)}, any_pair},
    {S::kMemoryOrder,     P::kDetection,{"memory order",    run<stages::memory_order>,      mask(R::kContactMemory),
        mask(R::kMemoryOrder)}, any_pair},
    {S::kKeptEdges,       P::kDetection,{"kept edges",      run<stages::kept_edges>,        kShapes | mask(R::kSettings, R::kPairs, R::kTrees, R::kBoxes, R::kContactMemory, R::kMemoryOrder),
        mask(R::kContacts)}, any_pair},
    {S::kFacePass,        P::kDetection,{"face pass",       run<stages::face_pass>,         kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kScreened, R::kNear, R::kTrees),
        mask(R::kContacts)}, wants_faces},
    {S::kConvexManifolds, P::kDetection,{"convex manifolds", run<stages::convex_manifolds>, kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs),
        mask(R::kContacts)}, wants_hulls},
    {S::kPenetration,     P::kDetection,{"penetration",     run<stages::penetration>,       mask(R::kPairs, R::kContacts),
        mask(R::kPenetrations, R::kReport)}, any_pair},
    {S::kDeepOverlap,     P::kDetection,{"deep overlap",    run<stages::deep_overlap>,      kShapes | mask(R::kSettings, R::kClock, R::kPairs, R::kContacts, R::kTrees, R::kSpawning),
        mask(R::kPairMemory, R::kPenetrations, R::kSleep)}, wants_separation_directions},
    {S::kRegions,         P::kDetection,{"regions",         run<stages::regions>,           kShapes | mask(R::kPairs, R::kScreened, R::kNear, R::kContacts, R::kContours),
        mask(R::kRegions)}, wants_regions},
    {S::kToolsInside,     P::kDetection,{"tools inside",    run<stages::tools_inside>,      kShapes | mask(R::kSettings, R::kBoxes, R::kPairs, R::kContacts, R::kTrees, R::kTools),
        mask(R::kToolState, R::kReport)}, any_tool_pair},
    {S::kContactConstraints,     P::kDetection,{"contact constraints",    run<stages::contact_constraints>,      kShapes | mask(R::kSettings, R::kBoxes, R::kPairs, R::kContacts, R::kPenetrations, R::kTools, R::kToolState),
        mask(R::kContactConstraints, R::kReport)}, any_pair},
    {S::kEdgeConstraints,        P::kDetection,{"edge constraints",       run<stages::edge_constraints>,         kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kCandidates, R::kPenetrations),
        mask(R::kContactConstraints)}, any_free_pair},
    {S::kLoadedConstraints,      P::kDetection,{"loaded constraints",     run<stages::loaded_constraints>,       kShapes | mask(R::kContactMemory, R::kMemoryOrder, R::kContactConstraints),
        mask(R::kLoadedConstraints)}, any_pair},
    {S::kCulledConstraints,        P::kDetection,{"culled constraints",       run<stages::culled_constraints>,         kShapes | mask(R::kSettings, R::kClock, R::kDisplacementBounds, R::kLoadedConstraints, R::kJoinedBodies, R::kNodes),
        mask(R::kContactConstraints)}, any_pair},
    {S::kRedundantConstraints,     P::kDetection,{"redundant constraints",    run<stages::redundant_constraints>,      kShapes,
        mask(R::kContactConstraints)}, any_pair},
    {S::kWarmStart,       P::kDetection,{"warm start",      run<stages::warm_start>,        mask(R::kContactMemory, R::kMemoryOrder),
        mask(R::kContactConstraints)}, any_pair},
    {S::kSelfContacts,    P::kDetection,{"self-contacts",   run<stages::self_contacts>,     kShapes | mask(R::kSettings, R::kSprings, R::kClock, R::kPairs, R::kSleep, R::kCrossedSurfaces),
        mask(R::kSelfContacts, R::kSelfContactStart, R::kContactConstraints, R::kReport)}, any_self_contact},
    {S::kIslands,         P::kDetection,{"islands",         run<stages::islands>,           mask(R::kBodies, R::kContactConstraints, R::kJoinedBodies),
        mask(R::kIslands)}, any_mover},
    {S::kLocalContact,    P::kHaptics,  {"local contact",   run<stages::local_contact>,     kShapes | mask(R::kClock, R::kPaths, R::kTools, R::kToolState, R::kNodeState, R::kBoxes),
        mask(R::kLocalContact)}, any_tool},
    {S::kHapticSurfaces,  P::kHaptics,  {"haptic surfaces", run<stages::haptic_surfaces>,   mask(R::kTools, R::kPoses),
        mask(R::kLocalContact)}, any_tool},
    {S::kDriveYield,      P::kHaptics,  {"drive yield",     run<stages::drive_yield>,       mask(R::kTools, R::kToolState, R::kBodies, R::kNodes, R::kNodeState),
        mask(R::kLocalContact)}, any_drive},
    {S::kCompliancePrediction,      P::kHaptics,  {"compliance prediction",     run<stages::tissue_give>,       kShapes | mask(R::kTools),
        mask(R::kToolState, R::kLocalContact)}, any_tool},
    {S::kContactHook,     P::kHaptics,  {"contact hook",    run<stages::contact_hook>,      kShapes | mask(R::kClock, R::kTools),
        mask(R::kToolState, R::kLocalContact)}, any_tool},
    {S::kHoldingGroups,   P::kAdvance,  {"holding groups",  run<stages::holding_groups>,    mask(R::kBodies, R::kLinks),
        mask(R::kHoldingGroups)}, any_link},
    {S::kAdvance,         P::kAdvance,  {"advance",         run<stages::advance>,           mask(R::kSleep, R::kSettings, R::kMeshes, R::kSprings, R::kSolids, R::kBodies, R::kAnchors, R::kPaths, R::kTools, R::kClock, R::kIslands, R::kLocalContact, R::kTears, R::kNodes, R::kImpactTimes, R::kHoldingGroups, R::kActions, R::kJoinedBodies, R::kThreads),
        mask(R::kThreadState, R::kPairMemory, R::kPoses, R::kParticles, R::kRelaxation, R::kContactConstraints, R::kToolState, R::kActionState, R::kDevices, R::kLinks, R::kTorn, R::kTornSprings, R::kNodeState, R::kEnergy, R::kReport)}, any_mover},
    {S::kPassedSurfaces,  P::kAdvance,  {"passed surfaces", run<stages::passed_surfaces>,   kShapes | mask(R::kClock, R::kTools, R::kToolState, R::kLocalContact),
        mask(R::kPassedSurfaces, R::kReport)}, any_tool_and_tissue},
    {S::kContactMemory,   P::kAdvance,  {"contact memory",  run<stages::contact_memory>,    mask(R::kContactConstraints),
        mask(R::kContactMemory)}, any_mover},
    {S::kSelfContactForces,P::kAdvance, {"self-contact forces",run<stages::self_contact_forces>,mask(R::kContactConstraints),
        mask(R::kSelfContacts)}, any_self_contact},
    {S::kHeldSurfaces,    P::kAdvance,  {"held surfaces",   run<stages::held_surfaces>,     kShapes | mask(R::kSettings, R::kSprings, R::kSolids, R::kAnchors, R::kTears, R::kTorn, R::kTornSprings, R::kNodes, R::kNodeState, R::kSelfContactStart, R::kPairs, R::kSleep, R::kActions, R::kActionState, R::kRelaxation, R::kThreads, R::kThreadState),
        mask(R::kParticles, R::kLinks, R::kCrossedSurfaces, R::kEnergy, R::kReport)}, any_self_contact},
    {S::kLinkForces,      P::kAdvance,  {"link forces",     run<stages::link_forces>,       mask(R::kClock, R::kTools, R::kActions),
        mask(R::kLinks, R::kActionState, R::kToolState)}, any_link},
    {S::kHandForces,      P::kAdvance,  {"hand forces",     run<stages::hand_forces>,       mask(R::kClock, R::kTools),
        mask(R::kToolState)}, any_tool},
    {S::kThreads,         P::kAdvance,  {"threads",         run<stages::threads>,           mask(R::kSettings, R::kClock, R::kBodies, R::kPoses, R::kThreads),
        mask(R::kThreadState, R::kEnergy)}, any_thread},
    {S::kThreadForces,    P::kAdvance,  {"thread forces",   run<stages::thread_forces>,     mask(R::kClock, R::kTools, R::kThreads, R::kThreadState, R::kLinks),
        mask(R::kToolState)}, any_threaded_tool},
    {S::kFluidSources,    P::kAdvance,  {"fluid sources",   run<stages::fluid_sources>,     kShapes | mask(R::kClock, R::kFluids, R::kTools, R::kActions, R::kActionState, R::kNodeState, R::kLinks, R::kSolids, R::kContactConstraints),
        mask(R::kFluidState)}, any_fluid},
    {S::kFilms,           P::kAdvance,  {"films",           run<stages::films>,             kShapes | mask(R::kClock, R::kFluids, R::kNodeState, R::kContactConstraints),
        mask(R::kFluidState)}, any_fluid},
    {S::kDrops,           P::kAdvance,  {"drops",           run<stages::drops>,             kShapes | mask(R::kClock, R::kFluids, R::kNodeState),
        mask(R::kFluidState, R::kTrees)}, any_fluid},
    {S::kSurfaceNormals,  P::kPicture,  {"surface normals", run<stages::surface_normals>,   kShapes,
        mask(R::kNormals)}, any_deformable},
    {S::kSelfCrossings,   P::kPicture,  {"self-crossings",  run<stages::self_crossings>,    kShapes | mask(R::kClock, R::kSleep),
        mask(R::kSelfCrossings, R::kReport)}, any_deformable},
    {S::kEnergy,          P::kPicture,  {"energy",          run<stages::energy>,            mask(R::kSettings, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kParticles, R::kAnchors, R::kLinks, R::kTears, R::kTorn, R::kTornSprings, R::kNodes, R::kNodeState, R::kActions, R::kActionState, R::kRelaxation, R::kThreads, R::kThreadState),
        mask(R::kEnergy, R::kEnergyStart)}, any_energy},
    {S::kPicture,         P::kPicture,  {"picture",         run<stages::picture>,           kShapes | mask(R::kClock, R::kNormals, R::kContacts, R::kPenetrations, R::kTools, R::kToolState, R::kTears, R::kSpawning, R::kNodeState, R::kLinks, R::kActions, R::kActionState, R::kSolids, R::kFluids, R::kFluidState, R::kLenses, R::kThreads, R::kThreadState),
        mask(R::kPicture)}, any_body},
};
// clang-format on

constexpr bool is_in_order(std::span<const FrameStage> stages) {
    for (size_t index = 0; index < stages.size(); ++index)
        if (stages[index].id != static_cast<StageId>(index) || (index > 0 && stages[index].part < stages[index - 1].part)) return false;
    return stages.size() == static_cast<size_t>(StageId::kCount);
}
static_assert(is_in_order(kStages));

}  // namespace

std::span<const FrameStage> frame_stages() { return kStages; }

}  // namespace trocar
