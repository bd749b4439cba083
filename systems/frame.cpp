#include "systems/frame.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "engine/check.hpp"
#include "engine/device.hpp"
#include "engine/keyframe_path.hpp"
#include "engine/parallel.hpp"
#include "engine/sleepers.hpp"
#include "engine/thread_pool.hpp"
#include "systems/advance.hpp"
#include "systems/advance_fine.hpp"
#include "systems/body_boxes.hpp"
#include "systems/candidate_cells.hpp"
#include "systems/candidate_pairs.hpp"
#include "systems/come_and_go.hpp"
#include "systems/contact_memory.hpp"
#include "systems/contact_rows.hpp"
#include "systems/contours.hpp"
#include "systems/deformable_energy.hpp"
#include "systems/device_input.hpp"
#include "systems/edge_pass.hpp"
#include "systems/edge_rows.hpp"
#include "systems/edges_ahead.hpp"
#include "systems/face_depth.hpp"
#include "systems/fast_bodies.hpp"
#include "systems/haptic_surface.hpp"
#include "systems/haptic_tool.hpp"
#include "systems/island_memory.hpp"
#include "systems/islands.hpp"
#include "systems/level_of_detail.hpp"
#include "systems/link_bodies.hpp"
#include "systems/local_contact_model.hpp"
#include "systems/node_switching.hpp"
#include "systems/overlap.hpp"
#include "systems/parted_triangles.hpp"
#include "systems/penetration.hpp"
#include "systems/picture_snapshot.hpp"
#include "systems/pierced_bodies.hpp"
#include "systems/rasterise.hpp"
#include "systems/reachable_pairs.hpp"
#include "systems/refit_trees.hpp"
#include "systems/regions.hpp"
#include "systems/rigid_motion.hpp"
#include "systems/sleep.hpp"
#include "systems/surface_normals.hpp"
#include "systems/tear_bodies.hpp"
namespace trocar {

// Pairs that were left in a pass of a length (s) in which nothing of the last sweep moved.
struct PairsAtRest {
    double period = 0;
    CandidatePairs pairs;
};

// Reused buffers of the systems; their content means nothing between passes but speed.
struct FrameScratch {
    CandidatePairsScratch pairs;
    std::vector<std::array<uint32_t, 2>> apart;  // bodies that do not meet
    std::vector<Box> swept_box;                  // what the last sweep was made over
    std::vector<std::array<uint32_t, 2>> swept_apart;
    CandidatePairs swept;                        // and what it found
    std::array<PairsAtRest, 2> at_rest;          // passes alternate between two lengths at most
    ReachablePairsScratch reachable;
    RefitTreesScratch refit;
    RasteriseScratch rasterise;
    CandidateCellsScratch cells;
    PartedTrianglesScratch parted;
    OverlapScratch overlap;
    ContoursScratch contours;
    EdgePassScratch edges;
    FaceDepthScratch faces;
    PairMemory ways_before;
    RegionsScratch regions;
    ContactRowsScratch rows;
    EdgeRowsScratch edge_rows;
    EdgesAheadScratch edges_ahead;
    ContactMemoryScratch memory;
    IslandsScratch islands;
    LinkScratch links;
    std::vector<std::array<uint32_t, 2>> joined;  // bodies, by links
    SleepScratch sleep;
    std::vector<uint64_t> sleeps;               // per body: which sleep it is in, 0 = awake
    uint64_t last_sleep = 0;
    std::array<std::vector<uint64_t>, 5> seen;  // per stage and body: see Sleepers
    uint64_t next_pass = 0;                     // a clock that was put elsewhere means another state
    std::vector<uint32_t> leaving;               // bodies whose life is over in this pass
    std::vector<uint8_t> moving;                // per body: by its script
    SurfaceNormalsScratch normals;
    EnergyScratch energy;
    Poses coming;                               // poses with the coming speed of hands and free bodies
    std::vector<FastBody> fast;                 // of this pass
    std::vector<double> stop;                   // s into the pass, per body where a fast one first touches; or empty
    std::vector<AdvanceScratch> advance;        // per thread, for the islands that share
    std::vector<AdvanceScratch> own_advance;    // of the islands that do not
    std::vector<uint32_t> awake;                // islands to be advanced
    std::vector<uint32_t> island_size;          // as awake: particles
    std::vector<uint32_t> island_order;
    std::vector<uint32_t> own_memory;           // as awake: row of own_advance or kNone
    std::vector<AdvanceResult> advance_result;  // as awake
    std::vector<uint64_t> response_ns;          // as awake
    std::vector<DeviceState> intended;          // tools * (period + 1): where the hands mean to be at every millisecond
    std::vector<DeviceState> device;            // the same for where the tools are
    LocalContactScratch local_contact;
    std::array<HapticScratch, kMaxTools> haptic;
    std::array<DeviceState, kMaxTools> live_device;  // live: of the pass before
    bool live_device_known = false;
};

struct FrameState {
    World world;
    FrameScratch scratch;
    FrameOptions options;
    FrameTimes times;
    ContactHook contact_hook;
    std::vector<std::string_view> island_name;  // with a trace, per body: of the island whose first body it is
    uint32_t face_queries = 2000;  // of a pair, for its deepest point in a face: 2 ms
    uint64_t direct_tests = 1 << 18;  // of a pair, up to which its triangles are compared without cells
    double energy_start = 0;  // J, when the books were opened
    bool energy_open = false;
};

namespace {

double period_seconds(const World& w) { return w.clock.period * 1e-3; }
double pass_seconds(const World& w) { return static_cast<double>(w.clock.tick) * 1e-3; }

std::span<const ToolJaw> jaws_of(const Haptics& haptics, const HandTool& tool) { return std::span(haptics.jaw).subspan(tool.jaws.first, tool.jaws.count); }

enum SleeperStage { kSeenByBoxes, kSeenByPairs, kSeenByNormals, kSeenByEnergy, kSeenByPicture };
Sleepers sleepers(FrameState& f, SleeperStage stage) {
    if (f.options.look_at_sleepers) return {};
    std::vector<uint64_t>& seen = f.scratch.seen[stage];
    seen.resize(f.scratch.sleeps.size(), 0);
    return {f.scratch.sleeps, seen};
}
// Gives every body that sleeps a number for this sleep.
void number_sleeps(FrameState& f) {
    const World& w = f.world;
    f.scratch.sleeps.resize(w.bodies.mesh.size(), 0);
    for (uint32_t body = 0; body < f.scratch.sleeps.size(); ++body) {
        uint64_t& sleep = f.scratch.sleeps[body];
        sleep = !lies_asleep(w.sleep, body) ? 0 : sleep != 0 ? sleep : ++f.scratch.last_sleep;
    }
}

// ---- begin ----

// Live: where a device will be a pass from now. Without this what is simulated lags behind the hand by a pass: 1.3 mm and
// 0.8 N at 40 mm/s and 30 Hz. A hand that stops is overshot by no more than kMostAhead.
Vec3d ahead(const DeviceState& device, double seconds) {
    constexpr double kMostAhead = 2e-3;  // m
    const Vec3d way = seconds * device.velocity;
    const double length = way.norm();
    return device.position + (length > kMostAhead ? kMostAhead / length : 1.0) * way;
}

// Live: what the haptic thread saw last, gone on with, reached evenly over the pass from where that led in the pass before.
void follow_live_devices(FrameState& f) {
    World& w = f.world;
    const size_t tools = w.haptics.tool.size(), per_tool = w.clock.period + 1;
    const double pass = 1.0 / w.clock.contact_rate;
    f.scratch.device.resize(tools * per_tool);
    for (size_t t = 0; t < tools; ++t) {
        const DeviceState to = w.haptics.state[t].device;
        const DeviceState from = f.scratch.live_device_known ? f.scratch.live_device[t] : to;
        const Vec3d start = ahead(from, pass), way = ahead(to, pass) - start;
        for (size_t ms = 0; ms < per_tool; ++ms) {
            DeviceState& device = f.scratch.device[t * per_tool + ms];
            const double share = static_cast<double>(ms) / static_cast<double>(per_tool - 1);
            device = to;
            device.position = start + share * way;
            device.grip = from.grip + share * (to.grip - from.grip);
            const Vec3d turn = rotation_vector(from.orientation, to.orientation);
            device.orientation = normalized(multiply(from_rotation_vector(share * turn), from.orientation));
        }
        f.scratch.live_device[t] = to;
    }
    f.scratch.live_device_known = true;
}

// Where every device will be at each millisecond of the pass; the first is now.
void device_input(FrameState& f) {
    World& w = f.world;
    for (ToolState& state : w.haptics.state) state.contact_impulse = state.contact_moment = Vec3d::Zero(), state.grip_moment = 0;
    if (f.options.external_ticks) {
        follow_live_devices(f);
        return;
    }
    std::array<Device, kMaxTools> device;
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) device[t] = device_of(w.haptics, w.paths, w.haptics.tool[t]);
    read_devices(std::span(device).first(w.haptics.tool.size()), w.clock.tick, w.clock.period, f.scratch.intended);
    const size_t per_tool = w.clock.period + 1;
    f.scratch.device.resize(f.scratch.intended.size());
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        predict_tool(w.haptics.tool[t], HapticParams{}.dt, w.haptics.state[t], std::span(f.scratch.intended).subspan(t * per_tool, per_tool),
                     std::span(f.scratch.device).subspan(t * per_tool, per_tool));
        // before the first tick nothing was accepted yet
        if (!w.haptics.state[t].device_valid) w.haptics.state[t].device = f.scratch.device[t * (w.clock.period + 1)];
    }
}
void nodes(FrameState& f) {
    World& w = f.world;
    switch_nodes(pass_seconds(w), w.nodes, w.lives, w.haptics, w.poses, w.node_state, w.sleep);
}
void rigid_motion(FrameState& f) { follow_paths(f.world.paths, pass_seconds(f.world), f.world.node_state.off, f.world.poses); }
void link(FrameState& f) {
    World& w = f.world;
    link_bodies(pass_seconds(w), w.haptics.state, {surfaces_of(w), w.solids, w.trees}, f.scratch.links, w.links, w.sleep, w.energy, w.report);
}
void tear(FrameState& f) {
    World& w = f.world;
    const TearPass pass{pass_seconds(w), w.settings.gravity, w.springs, w.solids, w.bodies, w.poses, w.anchors};
    cut_bodies(pass, w.particles, w.meshes, w.trees, w.tears, w.torn, w.torn_springs, w.sleep, w.energy, w.report);
    copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs);
}
// Those whose life is over leave, those who are due come; a slot that becomes free in this pass is given away in the next.
void come_and_go(FrameState& f) {
    World& w = f.world;
    std::vector<uint32_t>& leaving = f.scratch.leaving;
    const OtherForces other{&w.solids};
    const auto energies = [&] {
        Energy sum;
        for (const uint32_t body : leaving)
            add_body_energy(w.springs, w.bodies, w.poses, w.particles, w.anchors, w.settings.gravity, body, f.scratch.energy.part[0], sum, other);
        return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
    };
    find_leaving(w.pools, w.lives, w.clock.tick, leaving);
    let_come(w.pools, w.clock.tick, w.lives, w.sleep);
    const double before = energies();
    send_away(w.meshes, w.solids, w.bodies, w.pools, leaving, w.lives, w.poses, w.particles, w.sleep);
    if (f.options.account_energy) w.energy.work_numeric += energies() - before;
    for (const uint32_t body : leaving)
        if (body < f.scratch.sleeps.size()) f.scratch.sleeps[body] = 0;
}
// Hands on the way to where their devices will be, and free bodies, that come faster than rows look ahead. (A hand that
// tissue holds back from its device is not fast: rows hold it.)
void find_fast_bodies(FrameState& f) {
    const World& w = f.world;
    const double period = period_seconds(w);
    f.scratch.fast.clear();
    const auto add = [&](uint32_t body, const RigidSweep& sweep) {
        if (is_off(w.node_state, body)) return;
        const double arm = w.meshes.info[w.bodies.mesh[body]].radius + sweep.pivot.norm();
        const double way = (f.scratch.coming.velocity[body].norm() + w.poses.angular_velocity[body].norm() * arm) * period;
        if (way > w.boxes.margin[body] && std::isfinite(way)) f.scratch.fast.push_back({body, sweep});
    };
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        const HandTool& tool = w.haptics.tool[t];
        const DeviceState& end = f.scratch.device[t * (w.clock.period + 1) + w.clock.period];
        const Vec3d from = w.poses.origin[tool.body], to = end.position - rotate(end.orientation, tool.tip);
        const Quat& turn = w.poses.orientation[tool.body];
        add(tool.body, {Vec3d::Zero(), from, (to - from) / period, turn, rotation_vector(turn, end.orientation) / period});
    }
    for (const RigidMass& free : w.bodies.rigid_mass) {
        const uint32_t body = static_cast<uint32_t>(free.body);
        const Vec3d& spin = w.poses.angular_velocity[body];
        const Vec3d arm = rotate(w.poses.orientation[body], free.centre);
        const Vec3d velocity = w.poses.velocity[body] + spin.cross(arm) + 0.5 * period * w.settings.gravity;
        add(body, {free.centre, w.poses.origin[body] + arm, velocity, w.poses.orientation[body], spin});
    }
}
void body_boxes(FrameState& f) {
    World& w = f.world;
    // a hand may come as fast as its device moves now
    f.scratch.coming = w.poses;
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        Vec3d& velocity = f.scratch.coming.velocity[w.haptics.tool[t].body];
        velocity = Vec3d(velocity.norm() + f.scratch.device[t * (w.clock.period + 1)].velocity.norm(), 0, 0);
    }
    // and a free body as fast as it may fall until the end of the pass
    for (const RigidMass& free : w.bodies.rigid_mass) {
        Vec3d& velocity = f.scratch.coming.velocity[free.body];
        velocity = Vec3d(velocity.norm() + period_seconds(w) * w.settings.gravity.norm(), 0, 0);
    }
    number_sleeps(f);
    compute_body_boxes(period_seconds(w), {w.meshes, w.bodies, f.scratch.coming, w.particles}, w.boxes, sleepers(f, kSeenByBoxes));
    for (uint32_t body = 0; body < w.lives.away.size(); ++body)
        if (is_away(w.lives, body)) w.boxes.box[body] = {};
    for (uint32_t body = 0; body < w.node_state.off.size(); ++body)
        if (is_off(w.node_state, body)) w.boxes.box[body] = {};
    find_fast_bodies(f);
    cover_fast_ways(f.scratch.fast, period_seconds(w), surfaces_of(w), w.boxes);
}
void candidate_pairs(FrameState& f) {
    World& w = f.world;
    find_pierced_bodies(w.haptics.tool, w.boxes, w.nodes.apart, w.haptics.state, f.scratch.apart);
    FrameScratch& s = f.scratch;
    const auto same = [](const Box& a, const Box& b) { return a.min == b.min && a.max == b.max; };
    const bool still = std::equal(w.boxes.box.begin(), w.boxes.box.end(), s.swept_box.begin(), s.swept_box.end(), same);
    const bool swept = !still || s.apart != s.swept_apart;  // else all sleep
    if (swept) {
        find_candidate_pairs(w.bodies, w.boxes, s.apart, s.pairs, s.swept);
        s.swept_box = w.boxes.box;
        s.swept_apart = s.apart;
    }
    const Sleepers seen = sleepers(f, kSeenByPairs);
    const bool rest = !swept && lie_still(surfaces_of(w), s.reachable, seen);
    if (!rest)
        for (PairsAtRest& found : s.at_rest) found.period = 0;  // what memory they have they keep
    const double period = period_seconds(w);
    for (const PairsAtRest& found : s.at_rest) {
        if (found.period != period) continue;
        w.pairs = found.pairs;
        s.reachable.jolt.assign(w.bodies.mesh.size(), {});
        return;
    }
    w.pairs = s.swept;
    drop_unreachable_pairs(period, w.settings.gravity, surfaces_of(w), w.boxes, s.reachable, w.pairs, seen);
    if (rest) {
        std::swap(s.at_rest[0], s.at_rest[1]);
        s.at_rest[1].period = period;
        s.at_rest[1].pairs = w.pairs;
    }
}
std::span<const std::array<uint32_t, 2>> linked_bodies(FrameState& f) {
    joined_by_links(f.world.bodies, f.world.links, f.scratch.joined);
    for (const HandTool& tool : f.world.haptics.tool)
        for (uint32_t j = tool.jaws.first; j < tool.jaws.end(); ++j) f.scratch.joined.push_back({tool.body, f.world.haptics.jaw[j].body});
    return f.scratch.joined;
}
// Bodies that nobody moves and nothing comes near are left alone until the next pass.
void sleep(FrameState& f) {
    World& w = f.world;
    f.scratch.moving.assign(w.bodies.mesh.size(), 0);
    const double now = pass_seconds(w);
    for (size_t p = 0; p < w.paths.body.size(); ++p) {
        if (w.paths.body[p] == kNone || w.paths.keys[p].count == 0) continue;
        f.scratch.moving[w.paths.body[p]] = now <= w.paths.key[w.paths.keys[p].end() - 1].time + 2 * period_seconds(w);
    }
    fall_asleep_and_wake(w.settings, w.clock.period, w.bodies, f.scratch.moving, f.scratch.sleep, w.sleep, w.particles, w.pairs, w.energy, w.report, linked_bodies(f));
    number_sleeps(f);
}
void refit(FrameState& f) {
    World& w = f.world;
    refit_trees(w.bodies, w.particles, w.pairs, f.scratch.refit, w.trees);
    find_stops(w.settings.contact.tolerance, f.scratch.fast, period_seconds(w), surfaces_of(w), w.pairs, w.trees, f.scratch.stop);
}
void rasterise_(FrameState& f) {
    World& w = f.world;
    rasterise(w.settings.contact, surfaces_of(w), w.boxes, w.pairs, f.scratch.rasterise, w.report, w.screened, w.occupancy, f.direct_tests);
}
void candidate_cells(FrameState& f) {
    const World& w = f.world;
    const DirectInput direct{surfaces_of(w), w.boxes, period_seconds(w), w.settings.gravity.norm(), f.direct_tests, f.scratch.reachable.jolt};
    find_candidate_triangles(w.pairs, w.screened, w.occupancy, f.scratch.cells, f.world.candidates, &direct);
    drop_parted_triangles(surfaces_of(w), w.pairs, f.scratch.parted, f.world.candidates);
}
void contours(FrameState& f) {
    World& w = f.world;
    find_contours(surfaces_of(w), w.pairs, w.candidates, f.scratch.contours, w.contours);
}
void overlap(FrameState& f) {
    World& w = f.world;
    find_overlap(surfaces_of(w), w.boxes, w.pairs, w.screened, w.candidates, w.trees, f.scratch.overlap, w.report, w.near, w.contacts);
}
void edge_pass(FrameState& f) {
    World& w = f.world;
    find_edge_contacts(w.settings.contact, surfaces_of(w), w.pairs, w.candidates, w.near, w.trees, f.scratch.edges, w.report, w.contacts);
    keep_edges(w.settings.contact, surfaces_of(w), w.boxes, w.pairs, w.trees, w.contact_memory, f.scratch.memory, w.contacts);
}
void penetration(FrameState& f) {
    measure_penetrations(f.world.pairs, f.world.contacts, f.world.penetrations);
    ++f.world.report.contact_passes;
    if (!f.world.penetrations.pair.empty()) ++f.world.report.contact_events;
}
void face_pass(FrameState& f) {
    World& w = f.world;
    find_face_contacts(w.settings.contact, f.face_queries, surfaces_of(w), w.pairs, w.candidates, w.screened, w.near, w.trees, f.scratch.faces, w.contacts);
}
void deep_overlap(FrameState& f) {
    World& w = f.world;
    mark_saturated(surfaces_of(w), w.pairs, w.contacts, w.trees, w.penetrations);
    remember_ways_out(surfaces_of(w), w.pairs, w.contacts, f.scratch.ways_before, w.pair_memory, w.penetrations);
}
void regions(FrameState& f) {
    World& w = f.world;
    find_regions(surfaces_of(w), w.pairs, w.screened, w.near, w.contacts, w.contours, f.scratch.regions, w.regions);
}
void contact_rows(FrameState& f) {
    World& w = f.world;
    make_contact_rows(w.settings.contact, surfaces_of(w), w.pairs, w.contacts, w.penetrations, f.scratch.rows, w.report, w.rows);
    mark_pressed(surfaces_of(w), w.contact_memory, w.rows, f.scratch.memory);
    drop_idle_rows(period_seconds(w), w.settings.gravity, surfaces_of(w), f.scratch.reachable.jolt, f.scratch.memory.pressed, f.scratch.rows, w.rows);
    add_edge_rows(surfaces_of(w), w.boxes, w.pairs, w.candidates, f.scratch.edge_rows, w.rows);
    if (w.settings.contact.edges_ahead) {
        const double period = period_seconds(w), fall = 0.5 * w.settings.gravity.norm() * period * period;
        add_edges_ahead(period, fall, surfaces_of(w), w.boxes, w.pairs, w.candidates, w.near, w.contacts, f.scratch.edges_ahead, w.rows);
    }
    recall_contacts(w.contact_memory, f.scratch.memory, w.rows);
}
void islands(FrameState& f) { find_islands(f.world.bodies, f.world.rows, f.scratch.islands, f.world.islands, linked_bodies(f)); }
void level_of_detail(FrameState& f) {
    World& w = f.world;
    choose_detail(w.detail, w.islands, w.boxes, w.poses, w.haptics.tool, w.bodies.stepping);
}
void local_contact(FrameState& f) {
    World& w = f.world;
    w.local_contact.resize(w.haptics.tool.size());
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        publish_local_contact(haptic_params(w.clock.contact_rate), surfaces_of(w), w.boxes.box, w.haptics.tool[t], w.haptics.state[t], pass_seconds(w),
                              w.clock.pass + 1, f.scratch.local_contact, w.local_contact[t], jaws_of(w.haptics, w.haptics.tool[t]));
        w.local_contact[t].period = period_seconds(w);
        w.local_contact[t].in_hand = w.node_state.laid_down.empty() || !w.node_state.laid_down[t];
        publish_surfaces(w.haptics.surface, w.poses, w.local_contact[t]);
        if (!w.nodes.drive.empty() && w.bodies.inv_mass[w.haptics.tool[t].body] > 0)
            publish_yield(w.nodes, w.node_state, 1 / w.bodies.inv_mass[w.haptics.tool[t].body], w.haptics.tool[t], w.haptics.state[t], w.local_contact[t]);
        publish_give(surfaces_of(w), w.haptics.tool[t], w.haptics.state[t], f.scratch.local_contact, w.local_contact[t]);
    }
    if (f.contact_hook.published) f.contact_hook.published(f.contact_hook.user, w);
}

// ---- advance ----

OtherForces other_forces(World& w) {
    OtherForces other{&w.solids};
    if (!w.links.group.empty()) other.links = &w.links;
    if (!w.nodes.drive.empty()) other.nodes = &w.nodes, other.node_state = &w.node_state;
    if (!w.tears.body.empty()) other.tears = &w.tears, other.torn = &w.torn, other.torn_springs = &w.torn_springs;
    return other;
}

void begin_response(void* user) { *static_cast<uint64_t*>(user) -= now_ns(); }
void end_response(void* user) { *static_cast<uint64_t*>(user) += now_ns(); }

bool island_has_tool(const World& w, std::span<const uint32_t> bodies) {
    for (const uint32_t body : bodies)
        if (w.bodies.motion[body] == Motion::kHand) return true;
    return false;
}

// One island's tools, for the hook of every millisecond.
struct IslandTicks {
    FrameState& frame;
    std::span<const uint32_t> bodies;
};

// One millisecond of force rendering for the tools whose bodies are in the island.
void haptic_ticks(void* user, uint32_t ms) {
    const IslandTicks& ticks = *static_cast<IslandTicks*>(user);
    FrameState& f = ticks.frame;
    World& w = f.world;
    const size_t per_tool = w.clock.period + 1;
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        const uint32_t body = w.haptics.tool[t].body;
        if (std::find(ticks.bodies.begin(), ticks.bodies.end(), body) == ticks.bodies.end()) continue;
        const uint64_t start = now_ns();
        const HandTool& tool = w.haptics.tool[t];
        ToolState& state = w.haptics.state[t];
        const HapticParams params = haptic_params(w.clock.contact_rate);
        const DeviceState sample = hand_sample(tool, f.scratch.intended[t * per_tool + ms], params.dt, state.output, state.hand);
        tick_tool(params, w.local_contact[t], static_cast<double>(w.clock.tick + ms) * 1e-3, tool, effects_of(w.haptics, tool), sample,
                  f.scratch.haptic[t], state);
        // the force that was found moves the hand until the next tick
        if (tool.hand.mass > 0)
            predict_tool(tool, params.dt, state, std::span(f.scratch.intended).subspan(t * per_tool + ms + 1, 1),
                         std::span(f.scratch.device).subspan(t * per_tool + ms + 1, 1));
        f.times.tick_ns[t * w.clock.period + ms] = now_ns() - start;
    }
}

// One island through the whole pass; with a tool, the haptic tick runs between its milliseconds.
void advance_one_island(FrameState& f, uint32_t row, AdvanceScratch& scratch) {
    World& w = f.world;
    const uint32_t island = f.scratch.awake[row];
    const auto bodies = std::span(w.islands.body).subspan(w.islands.bodies[island].first, w.islands.bodies[island].count);
    const auto rows = std::span(w.islands.row).subspan(w.islands.rows[island].first, w.islands.rows[island].count);
    AdvanceParams params;
    params.tick = w.clock.tick;
    params.ticks = w.clock.period;
    params.gravity = w.settings.gravity;
    params.contact = w.settings.contact;
    params.account_energy = f.options.account_energy;
    params.observer = {begin_response, end_response, &f.scratch.response_ns[row]};
    IslandTicks ticks{f, bodies};
    const bool ticks_inside = !f.options.external_ticks && !w.haptics.tool.empty() && island_has_tool(w, bodies);
    const uint32_t calls = ticks_inside ? params.ticks : 1;  // the tick needs whole numbers of substeps in its millisecond
    params.substeps = calls * count_substeps(w.bodies, bodies, params.ticks * 1e-3 / calls, w.settings.substep, w.links.stable_dt);
    if (ticks_inside) params.tick_hook = {haptic_ticks, &ticks};
    const AdvanceInputs inputs{w.meshes, w.springs, w.bodies, w.anchors, w.paths, w.haptics.tool, f.scratch.device, params.ticks + 1, other_forces(w), f.scratch.stop, w.haptics.jaw};
    params.substeps *= finer_steps(inputs, w.particles, bodies, w.rows, rows, params.ticks * 1e-3 / params.substeps, params.ticks * 1e-3);
    advance_island(params, inputs, bodies, rows, scratch, w.particles, w.poses, w.rows, w.haptics.state, f.scratch.advance_result[row]);
}

// An island's span in the trace; small ones are left out.
void trace_island(FrameState& f, uint32_t island, uint64_t start) {
    constexpr uint64_t kLeastSpan = 20'000;  // ns
    const uint64_t duration = now_ns() - start;
    if (duration < kLeastSpan) return;
    const World& w = f.world;
    f.options.trace->add({f.island_name[w.islands.body[w.islands.bodies[island].first]], start, duration, thread_index(),
                          static_cast<uint32_t>(w.clock.pass)});
}

// Small islands share a job so that a job is worth its start (about 40 us).
uint32_t island_grain(const World& w) {
    const size_t count = std::max<size_t>(1, w.islands.bodies.size());
    const double us_per_island = static_cast<double>(w.particles.offset.size()) * w.clock.period * 3e-3 / static_cast<double>(count);
    return static_cast<uint32_t>(std::clamp(40.0 / std::max(us_per_island, 0.01), 1.0, 1024.0));
}

void find_awake_islands(const World& w, std::vector<uint32_t>& awake) {
    awake.clear();
    for (uint32_t i = 0; i < w.islands.bodies.size(); ++i) {
        const uint32_t body = w.islands.body[w.islands.bodies[i].first];
        // if it sleeps then all of them; if it is off then it is alone
        if (!is_asleep(w.sleep, body) && !is_off(w.node_state, body)) awake.push_back(i);
    }
}

// Which scratch each awake island is advanced in.
void choose_memory(FrameState& f) {
    const World& w = f.world;
    FrameScratch& s = f.scratch;
    s.island_size.clear();
    for (const uint32_t island : s.awake) {
        uint32_t particles = 0;
        const Range bodies = w.islands.bodies[island];
        for (uint32_t i = bodies.first; i < bodies.end(); ++i) particles += w.bodies.particles[w.islands.body[i]].count;
        s.island_size.push_back(particles);
    }
    pick_large_islands(s.island_size, thread_count(), s.island_order, s.own_memory);
    s.advance.resize(std::max<size_t>(s.advance.size(), thread_count()));
    s.own_advance.resize(std::max<size_t>(s.own_advance.size(), std::ranges::count_if(s.own_memory, [](uint32_t own) { return own != kNone; })));
}

void advance(FrameState& f) {
    World& w = f.world;
    find_awake_islands(w, f.scratch.awake);
    choose_memory(f);
    const uint32_t count = static_cast<uint32_t>(f.scratch.awake.size());
    f.scratch.advance_result.assign(count, {});
    f.scratch.response_ns.assign(count, 0);
    f.times.tick_ns.assign(w.haptics.tool.size() * w.clock.period, 0);
    parallel_for(count, island_grain(w), [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const uint64_t start = f.options.trace ? now_ns() : 0;
            const uint32_t own = f.scratch.own_memory[i];
            advance_one_island(f, i, own == kNone ? f.scratch.advance[thread_index()] : f.scratch.own_advance[own]);
            if (f.options.trace) trace_island(f, f.scratch.awake[i], start);
        }
    });
    remember_contacts(w.rows, w.contact_memory);
    share_room(f.scratch.advance);
    note_link_forces(period_seconds(w), w.links);
    note_pull_on_tools(period_seconds(w), w.links, w.haptics.tool, w.haptics.jaw, w.haptics.state);
    for (ToolState& state : w.haptics.state) state.grip_torque = state.grip_moment / period_seconds(w);
    f.times.response_ns = 0;
    w.report.deepest_residual = 0;
    for (uint32_t i = 0; i < count; ++i) {
        add_advance_result(f.scratch.advance_result[i], w.energy, w.report);
        f.times.response_ns += f.scratch.response_ns[i];
    }
    if (w.haptics.tool.empty() || f.options.external_ticks) return;
    sum_tool_counters(w.haptics);
}

// ---- end ----

void surface_normals(FrameState& f) { compute_surface_normals(surfaces_of(f.world), f.scratch.normals, f.world.normals, sleepers(f, kSeenByNormals)); }
void energy(FrameState& f) {
    World& w = f.world;
    measure_energy(w.springs, w.bodies, w.poses, w.particles, w.anchors, w.settings.gravity, 0, f.scratch.energy, w.energy, other_forces(w), sleepers(f, kSeenByEnergy));
    if (!f.energy_open) f.energy_start = w.energy.balance, f.energy_open = true;
    w.energy.balance -= f.energy_start;
}
void picture(FrameState& f) {
    World& w = f.world;
    write_picture_snapshot(w.clock.picture, pass_seconds(w), surfaces_of(w), w.normals, w.contacts, w.penetrations, w.haptics, w.picture, &w.tears, sleepers(f, kSeenByPicture));
    for (uint32_t body = 0; body < w.lives.away.size(); ++body)
        if (is_away(w.lives, body)) w.picture.body[body].mesh = kNone;
    for (uint32_t body = 0; body < w.node_state.off.size(); ++body)
        if (is_off(w.node_state, body)) w.picture.body[body].mesh = kNone;
}

bool any_path(const World& w) {
    return std::any_of(w.paths.body.begin(), w.paths.body.end(), [](uint32_t body) { return body != kNone; });
}
bool any_switch(const World& w) { return !w.nodes.toggle.empty() || !w.nodes.exchange.empty(); }
bool any_pool(const World& w) { return !w.pools.slots.empty(); }
bool any_tool(const World& w) { return !w.haptics.tool.empty(); }
bool any_pair(const World& w) {
    return w.bodies.motion.size() > 1 && std::any_of(w.bodies.motion.begin(), w.bodies.motion.end(), joins_islands);
}
bool wants_regions(const World& w) { return w.settings.contact.regions && any_pair(w); }
bool wants_contours(const World& w) { return (w.settings.contact.contours && any_pair(w)) || wants_regions(w); }
bool wants_faces(const World& w) { return w.settings.contact.faces && any_pair(w); }
bool wants_ways_out(const World& w) { return w.settings.contact.deep != DeepResponse::kNone && any_pair(w); }
bool any_mover(const World& w) {
    return any_tool(w) || std::any_of(w.bodies.motion.begin(), w.bodies.motion.end(), joins_islands);
}
bool any_deformable(const World& w) { return !w.particles.offset.empty(); }
bool any_energy(const World& w) { return any_deformable(w) || !w.bodies.rigid_mass.empty(); }
bool any_body(const World& w) { return !w.bodies.mesh.empty(); }

bool any_link(const World& w) { return !w.links.group.empty(); }
bool any_tear(const World& w) { return !w.tears.body.empty(); }
bool any_detail(const World& w) { return !w.detail.body.empty(); }
bool wants_boxes(const World& w) { return any_pair(w) || any_detail(w); }
bool may_sleep(const World& w) { return any_deformable(w) && w.settings.sleep_speed > 0; }

using R = Resource;
constexpr ResourceMask kShapes = mask(R::kMeshes, R::kBodies, R::kPoses, R::kParticles);

constexpr FrameStage kBegin[] = {
    // name              run              reads                                                              writes
    {{"device input",    device_input,    mask(R::kClock, R::kPaths, R::kTools),                             mask(R::kToolState)}, any_tool},
    {{"nodes",           nodes,           mask(R::kClock, R::kNodes, R::kTools, R::kLives), mask(R::kPoses, R::kToolState, R::kNodeState, R::kSleep)}, any_switch},
    {{"rigid motion",    rigid_motion,    mask(R::kClock, R::kPaths, R::kNodeState),                                        mask(R::kPoses)}, any_path},
    {{"come and go",     come_and_go,     kShapes | mask(R::kSettings, R::kSprings, R::kSolids, R::kAnchors, R::kPools, R::kClock), mask(R::kPoses, R::kParticles, R::kSleep, R::kLives, R::kEnergy)}, any_pool},
    {{"links",           link,            kShapes | mask(R::kSolids, R::kClock, R::kTrees, R::kToolState),     mask(R::kLinks, R::kSleep, R::kEnergy, R::kReport)}, any_link},
    {{"tears",           tear,            mask(R::kSettings, R::kClock, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kAnchors), mask(R::kParticles, R::kMeshes, R::kTrees, R::kTears, R::kTorn, R::kTornSprings, R::kSleep, R::kEnergy, R::kReport)}, any_tear},
    {{"body boxes",      body_boxes,      kShapes | mask(R::kSettings, R::kClock, R::kTools, R::kToolState, R::kLives, R::kNodeState, R::kSleep), mask(R::kBoxes)}, wants_boxes},
    {{"candidate pairs", candidate_pairs, kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kNodes, R::kTools), mask(R::kPairs, R::kToolState)}, any_pair},
    {{"sleep",           sleep,           mask(R::kSettings, R::kBodies, R::kPaths, R::kClock, R::kPairs, R::kLinks, R::kTools), mask(R::kSleep, R::kParticles, R::kPairs, R::kEnergy, R::kReport)}, may_sleep},
    {{"refit trees",     refit,           kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs),            mask(R::kTrees)}, any_pair},
    {{"rasterise",       rasterise_,      kShapes | mask(R::kSettings, R::kBoxes, R::kPairs),                mask(R::kScreened, R::kOccupancy, R::kReport)}, any_pair},
    {{"candidate cells", candidate_cells, kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kScreened, R::kOccupancy), mask(R::kCandidates)}, any_pair},
    {{"contours",        contours,        kShapes | mask(R::kPairs, R::kCandidates),                         mask(R::kContours)}, wants_contours},
    {{"overlap",         overlap,         kShapes | mask(R::kBoxes, R::kPairs, R::kScreened, R::kCandidates, R::kTrees), mask(R::kNear, R::kContacts, R::kReport)}, any_pair},
    {{"edge pass",       edge_pass,       kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kNear, R::kTrees, R::kBoxes, R::kContactMemory), mask(R::kContacts, R::kReport)}, any_pair},
    {{"face pass",       face_pass,       kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kScreened, R::kNear, R::kTrees), mask(R::kContacts)}, wants_faces},
    {{"penetration",     penetration,     mask(R::kPairs, R::kContacts),                                     mask(R::kPenetrations, R::kReport)}, any_pair},
    {{"deep overlap",    deep_overlap,    kShapes | mask(R::kPairs, R::kContacts, R::kTrees),                 mask(R::kPairMemory, R::kPenetrations)}, wants_ways_out},
    {{"regions",         regions,         kShapes | mask(R::kPairs, R::kScreened, R::kNear, R::kContacts, R::kContours), mask(R::kRegions)}, wants_regions},
    {{"contact rows",    contact_rows,    kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kCandidates, R::kNear, R::kContacts, R::kPenetrations, R::kContactMemory), mask(R::kRows, R::kReport)}, any_pair},
    {{"islands",         islands,         mask(R::kBodies, R::kRows, R::kLinks, R::kTools),                  mask(R::kIslands)}, any_mover},
    {{"level of detail", level_of_detail, mask(R::kDetail, R::kIslands, R::kBoxes, R::kPoses, R::kTools),     mask(R::kBodies)}, any_detail},
    {{"local contact",   local_contact,   kShapes | mask(R::kClock, R::kTools, R::kToolState, R::kNodes, R::kNodeState, R::kBoxes),     mask(R::kToolState, R::kLocalContact)}, any_tool},
};

constexpr FrameStage kAdvance[] = {
    {{"advance", advance, mask(R::kSleep, R::kSettings, R::kMeshes, R::kSprings, R::kSolids, R::kBodies, R::kAnchors, R::kPaths, R::kTools, R::kClock, R::kIslands, R::kLocalContact, R::kTears, R::kNodes),
      mask(R::kPoses, R::kParticles, R::kRows, R::kContactMemory, R::kToolState, R::kLinks, R::kTorn, R::kTornSprings, R::kNodeState, R::kEnergy, R::kReport)}, any_mover},
};

constexpr FrameStage kEndStages[] = {
    {{"surface normals", surface_normals, kShapes,                                                           mask(R::kNormals)}, any_deformable},
    {{"energy",          energy,          mask(R::kSettings, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kParticles, R::kAnchors, R::kLinks, R::kTears, R::kTornSprings, R::kNodes, R::kNodeState), mask(R::kEnergy)}, any_energy},
    {{"picture",         picture,         kShapes | mask(R::kClock, R::kNormals, R::kContacts, R::kPenetrations, R::kTools, R::kToolState, R::kTears, R::kLives, R::kNodeState), mask(R::kPicture)}, any_body},
};

constexpr std::string_view kFirstDetection = "body boxes", kAfterDetection = "local contact";

}  // namespace

std::span<const FrameStage> begin_stages() { return kBegin; }
std::span<const FrameStage> advance_stages() { return kAdvance; }

// The stages this scene wants, and the graphs over them: one for a pass, one for a picture.
struct Frame::Graphs {
    // What an observer needs to know of its list.
    struct List {
        Graphs* graphs = nullptr;
        uint32_t first = 0;
    };
    FrameState* state = nullptr;
    std::vector<Stage> stages;  // all, in serial order
    std::vector<std::string> names;
    std::vector<uint32_t> detection;
    uint32_t end_first = 0;
    std::vector<uint64_t> begin_ns;
    List pass_list, end_list;
    std::unique_ptr<JobGraph> pass, end;

    static void begin_stage(void* user, uint32_t row) {
        const List& list = *static_cast<List*>(user);
        list.graphs->begin_ns[list.first + row] = now_ns();
    }
    static void end_stage(void* user, uint32_t row) {
        const List& list = *static_cast<List*>(user);
        Graphs& g = *list.graphs;
        const uint32_t stage = list.first + row;
        const uint64_t duration = now_ns() - g.begin_ns[stage];
        g.state->times.stage_ns[stage] = duration;
        if (g.state->options.trace)
            g.state->options.trace->add({g.stages[stage].name, g.begin_ns[stage], duration, thread_index(),
                                         static_cast<uint32_t>(g.state->world.clock.pass)});
    }
    void add(std::span<const FrameStage> list) {
        for (const FrameStage& row : list) {
            if (!row.wanted(state->world)) continue;
            if (!state->options.pictures && (row.stage.writes & mask(R::kNormals, R::kPicture))) continue;
            stages.push_back(row.stage);
            names.emplace_back(row.stage.name);
        }
    }
    void run(bool end_of_picture) {
        const std::span<const Stage> all(stages);
        List& list = end_of_picture ? end_list : pass_list;
        const StageObserver observer{begin_stage, end_stage, &list};
        if (state->options.serial) {
            run_serial(end_of_picture ? all.subspan(end_first) : all.first(end_first), *state, observer);
        } else {
            (end_of_picture ? end : pass)->run();
        }
    }
};

Frame::Frame(World world, const FrameOptions& options) : state_(new FrameState), graphs_(new Graphs) {
    state_->world = std::move(world);
    state_->options = options;
    World& w = state_->world;
    if (options.trace)
        for (const std::string& name : w.bodies.name) state_->island_name.push_back(options.trace->keep("island of " + name));
    Graphs& g = *graphs_;
    g.state = state_.get();
    g.add(kBegin);
    for (uint32_t s = 0; s < g.stages.size(); ++s) {
        const bool started = !g.detection.empty() || g.stages[s].name == kFirstDetection;
        if (started && g.stages[s].name != kAfterDetection) g.detection.push_back(s);
    }
    g.add(kAdvance);
    g.end_first = static_cast<uint32_t>(g.stages.size());
    g.add(kEndStages);
    g.begin_ns.assign(g.stages.size(), 0);
    state_->times.stage_ns.assign(g.stages.size(), 0);
    g.pass_list = {&g, 0};
    g.end_list = {&g, g.end_first};
    const std::span<const Stage> all(g.stages);
    g.pass = std::make_unique<JobGraph>(all.first(g.end_first), *state_, StageObserver{Graphs::begin_stage, Graphs::end_stage, &g.pass_list});
    g.end = std::make_unique<JobGraph>(all.subspan(g.end_first), *state_, StageObserver{Graphs::begin_stage, Graphs::end_stage, &g.end_list});
    if (any_tear(w)) copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs);
    if (any_energy(w) && options.account_energy) energy(*state_);  // opens the books
    warm_up();
}

Frame::~Frame() = default;

namespace {

// Caches may change time, never results: tests forget them all.
void clear_caches(FrameState& f) {
    f.scratch = {};
    for (const auto& tree : f.world.trees) tree->rebuild();
}

void begin_pass(FrameState& f) {
    set_float_mode();  // whoever ran since the last pass may have changed it
    Clock& clock = f.world.clock;
    clock.period = static_cast<uint32_t>(pass_tick(clock.pass + 1, clock.contact_rate) - clock.tick);
    std::fill(f.times.stage_ns.begin(), f.times.stage_ns.end(), 0);
    f.times.picture = false;
    if (f.options.clear_caches) clear_caches(f);
    if (clock.pass != f.scratch.next_pass) std::fill(f.scratch.sleeps.begin(), f.scratch.sleeps.end(), 0);
    f.scratch.next_pass = clock.pass + 1;
}

// Moves the clock to the end of the pass; true when a picture is due there.
bool end_pass(FrameState& f) {
    Clock& clock = f.world.clock;
    clock.tick += clock.period;
    ++clock.pass;
    return clock.tick >= pass_tick(clock.picture + 1, clock.display_rate);
}

}  // namespace

namespace {

// Bodies at rest look as far ahead as moving ones.
void reach_out(World& w) {
    for (uint32_t body = 0; body < w.boxes.box.size(); ++body) {
        const double edge = w.meshes.info[w.bodies.mesh[body]].mean_edge;
        w.boxes.margin[body] += edge;
        w.boxes.box[body].min.array() -= edge;
        w.boxes.box[body].max.array() += edge;
    }
}

}  // namespace

// Finds contacts once before the clock starts, so that the first passes find their memory in place.
void Frame::warm_up() {
    const Report before = state_->world.report;
    const Sleep sleep_before = state_->world.sleep;
    begin_pass(*state_);
    state_->scratch.device.resize(state_->world.haptics.tool.size() * (state_->world.clock.period + 1));
    for (const uint32_t s : graphs_->detection) {
        run_stage(s);
        if (stages()[s].name == kFirstDetection) reach_out(state_->world);
    }
    state_->world.report = before;
    state_->world.sleep = sleep_before;
}

void Frame::step() {
    begin_pass(*state_);
    graphs_->run(false);
    if (!end_pass(*state_)) return;
    graphs_->run(true);
    ++state_->world.clock.picture;
    state_->times.picture = true;
}

void Frame::step_until(uint32_t row) {
    begin_pass(*state_);
    for (uint32_t s = 0; s < row; ++s) {
        run_stage(s);
        if (s + 1 == graphs_->end_first) end_pass(*state_);
    }
}

void Frame::set_contact_hook(const ContactHook& hook) { state_->contact_hook = hook; }

void Frame::set_live_devices(std::span<const DeviceState> devices) {
    std::copy_n(devices.begin(), std::min(devices.size(), kMaxTools), state_->scratch.live_device.begin());
    state_->scratch.live_device_known = true;
}

const PictureSnapshot& Frame::snapshot_now() {
    if (any_deformable(state_->world)) surface_normals(*state_);
    picture(*state_);
    return state_->world.picture;
}

void Frame::run_stage(uint32_t row) { graphs_->stages[row].run(*state_); }
std::span<const Stage> Frame::stages() const { return graphs_->stages; }
World& Frame::world() { return state_->world; }
const World& Frame::world() const { return state_->world; }
const std::vector<std::string>& Frame::stage_names() const { return graphs_->names; }
const FrameTimes& Frame::times() const { return state_->times; }
std::span<const uint32_t> Frame::detection_stages() const { return graphs_->detection; }

void detect_contacts(World& world) {
    FrameState state;
    state.face_queries = 100'000;  // an answer, not a frame
    state.direct_tests = 0;        // that shows its cells
    std::swap(state.world, world);
    for (const HandTool& tool : state.world.haptics.tool) {  // hands stay where they are
        DeviceState held;
        held.orientation = state.world.poses.orientation[tool.body];
        held.position = state.world.poses.origin[tool.body] + rotate(held.orientation, tool.tip);
        state.scratch.device.insert(state.scratch.device.end(), state.world.clock.period + 1, held);
    }
    const auto first = std::find_if(std::begin(kBegin), std::end(kBegin), [](const FrameStage& row) { return row.stage.name == kFirstDetection; });
    for (auto row = first; row->stage.name != kAfterDetection; ++row)
        if (row->wanted(state.world)) row->stage.run(state);
    std::swap(state.world, world);
}

}  // namespace trocar
