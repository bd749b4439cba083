#include <algorithm>
#include <cmath>

#include "systems/body_boxes.hpp"
#include "systems/frame_stages.hpp"
#include "systems/haptic_surface.hpp"
#include "systems/penetration.hpp"
#include "systems/pierced_bodies.hpp"
namespace trocar::stages {
namespace {

double fall_in_period(const World& w) { return 0.5 * w.settings.gravity.norm() * period_seconds(w) * period_seconds(w); }
ContactInputs contact_inputs(const World& w) {
    return {w.settings.contact, period_seconds(w), fall_in_period(w), surfaces_of(w), w.boxes, w.pairs, w.trees};
}

std::span<const ToolJaw> jaws_of(const Haptics& haptics, const HandTool& tool) {
    return std::span(haptics.jaw).subspan(tool.jaws.first, tool.jaws.count);
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
    std::ranges::sort(f.scratch.fast, {}, &FastBody::body);
}
}  // namespace

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
void refit(FrameState& f) {
    World& w = f.world;
    refit_trees(w.bodies, w.particles, w.pairs, f.scratch.refit, w.trees);
    find_stops(contact_inputs(w), f.scratch.fast, f.scratch.touch, f.scratch.stop);
}
void rasterise_bodies(FrameState& f) {
    World& w = f.world;
    rasterise(contact_inputs(w), f.direct_tests, f.scratch.rasterise, w.report, w.screened, w.occupancy);
}
void candidate_cells(FrameState& f) {
    World& w = f.world;
    const DirectPairs direct{f.direct_tests, f.scratch.reachable.jolt};
    find_candidate_triangles(contact_inputs(w), direct, w.screened, w.occupancy, f.scratch.cells, w.candidates);
    drop_parted_triangles(contact_inputs(w), f.scratch.parted, w.candidates);
}
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
    order_memory(w.contact_memory, f.scratch.memory);
    keep_edges(contact_inputs(w), w.contact_memory, f.scratch.memory, w.contacts);
}
void penetration(FrameState& f) {
    measure_penetrations(f.world.pairs, f.world.contacts, f.world.penetrations);
    ++f.world.report.contact_passes;
    if (!f.world.penetrations.pair.empty()) ++f.world.report.contact_events;
}
void face_pass(FrameState& f) {
    World& w = f.world;
    find_face_contacts(contact_inputs(w), f.face_queries, w.screened, w.candidates, w.near, f.scratch.faces, w.contacts);
}
void deep_overlap(FrameState& f) {
    World& w = f.world;
    mark_saturated(contact_inputs(w), w.contacts, w.penetrations);
    remember_ways_out(contact_inputs(w), w.contacts, f.scratch.ways_before, w.pair_memory, w.penetrations);
}
void regions(FrameState& f) {
    World& w = f.world;
    find_regions(contact_inputs(w), w.screened, w.near, w.contacts, w.contours, f.scratch.regions, w.regions);
}
void contact_rows(FrameState& f) {
    World& w = f.world;
    make_contact_rows(contact_inputs(w), w.contacts, w.penetrations, f.scratch.rows, w.report, w.rows);
    add_edge_rows(contact_inputs(w), w.candidates, f.scratch.edge_rows, w.rows);
    mark_pressed(surfaces_of(w), w.contact_memory, w.rows, f.scratch.memory);
    const ComingPeriod coming{period_seconds(w),        w.settings.gravity, surfaces_of(w), f.scratch.reachable.jolt,
                              f.scratch.memory.pressed, linked_bodies(f),   w.nodes.drive};
    drop_idle_rows(coming, f.scratch.idle_rows, w.rows);
    drop_implied_rows(surfaces_of(w), f.scratch.implied_rows, w.rows);
    recall_contacts(w.contact_memory, f.scratch.memory, w.rows);
}
void islands(FrameState& f) { find_islands(f.world.bodies, f.world.rows, f.scratch.islands, f.world.islands, linked_bodies(f)); }
void local_contact(FrameState& f) {
    World& w = f.world;
    w.local_contact.resize(w.haptics.tool.size());
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        publish_local_contact(haptic_params(w.clock.contact_rate), surfaces_of(w), w.boxes.box, w.haptics.tool[t], w.haptics.state[t],
                              pass_seconds(w), w.clock.pass + 1, f.scratch.local_contact, w.local_contact[t],
                              jaws_of(w.haptics, w.haptics.tool[t]));
        w.local_contact[t].period = period_seconds(w);
        w.local_contact[t].in_hand = w.node_state.laid_down.empty() || !w.node_state.laid_down[t];
        publish_surfaces(w.haptics.surface, w.poses, w.local_contact[t]);
        if (!w.nodes.drive.empty() && w.bodies.inv_mass[w.haptics.tool[t].body] > 0)
            publish_yield(w.nodes, w.node_state, 1 / w.bodies.inv_mass[w.haptics.tool[t].body], w.haptics.tool[t], w.haptics.state[t],
                          w.local_contact[t]);
        publish_give(surfaces_of(w), w.haptics.tool[t], w.haptics.state[t], f.scratch.local_contact, w.local_contact[t]);
    }
    if (f.contact_hook.published) f.contact_hook.published(f.contact_hook.user, w);
}

}  // namespace trocar::stages
