#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "engine/surfaces.hpp"
#include "engine/tet_forces.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

// Gap of a row at the end of the substep, and its normal there. Measured where pushes act: so they change the gaps of each other's rows
// alike, and sweeps do not run away.
double gap_after(const AdvanceScratch& s, const ContactActive& row, Vec4d& normal) {
    const ContactPlan& plan = s.plan[row.plan];
    Vec4d apart;
    if (plan.rigid_a == kNone) {
        apart = plan.weight_a[0] * field_at(s, plan.node_a[0], &ContactNodes::after);
        if (plan.weight_a[1] != 0) apart += plan.weight_a[1] * field_at(s, plan.node_a[1], &ContactNodes::after);
        if (plan.weight_a[2] != 0) apart += plan.weight_a[2] * field_at(s, plan.node_a[2], &ContactNodes::after);
    } else {
        apart = s.rigid[plan.rigid_a].place[1](plan.point_a);
    }
    if (plan.rigid_b == kNone) {
        for (uint32_t k = row.point_nodes; k < row.nodes; ++k) apart += row.push_weight[k] * s.node[row.node[k]].after;
        normal = plan.normal;
    } else {
        const RigidMap& place = s.rigid[plan.rigid_b].place[1];
        apart -= place(plan.point_b);
        normal = place.turn(plan.normal);
    }
    return dot(normal, apart) + row.push_gap - plan.offset;
}

bool is_free(const AdvanceScratch& s, uint32_t node) {
    const ConstContactNode n = s.node[node];
    return n.particle == kNone && n.owner < s.rigid.size() && s.rigid[n.owner].free != kNone;  // the node of no mass has no owner
}

// Later rows see the move. But a node pressed from both sides stays where it is for all rows that a group has in a sweep; then it goes
// the mean of their ways, see meet_midway.
void move_node(AdvanceScratch& s, uint32_t node, Vec4d move, uint8_t sweep) {
    if (const ContactNodeChange change = s.change[node]; change.opposed) {
        change.way += move;
        ++change.pushes;
    } else {
        s.node[node].after += move;
        s.moved_in[node] = sweep;
    }
}

// Runs visit(node) for all nodes of a group pressed from both sides, for some more than once. None of them is in a block.
template <typename Visit>
void for_opposed(AdvanceScratch& s, const RowGroup& group, const Visit& visit) {
    for (const ContactActive& row : group.active)
        for (uint32_t k = 0; k < row.nodes; ++k)
            if (s.change[row.node[k]].opposed) visit(row.node[k]);
}
void forget_ways(AdvanceScratch& s, const RowGroup& group) {
    for_opposed(s, group, [&](uint32_t node) {
        const ContactNodeChange change = s.change[node];
        change.way = Vec4d{};
        change.rows = change.pushes = 0;
    });
}
bool has_moved(const AdvanceScratch& s, const ContactActive& row, uint8_t since) {
    return std::any_of(row.node.begin(), row.node.begin() + row.nodes, [&](uint32_t node) { return s.moved_in[node] >= since; });
}
// Free bodies are pushed once: nodes that one of them and something else press stay after the first sweep, or else what presses them
// from the other side would have the last word.
constexpr uint32_t kStays = kNone;
void keep_midway(AdvanceScratch& s, const RowGroup& group) {
    for (const ContactActive& row : group.active)
        for (uint32_t k = 0; row.turning != kNone && k < row.nodes; ++k)
            if (s.change.opposed[row.node[k]]) s.change.rows[row.node[k]] = kStays;
}
// Moves the nodes pressed from both sides: the sum of what rows want in a sweep over the most rows that have pushed in one. That
// converges however many they are (mass splitting, Tonge et al. 2012), and where as many press from either side a node comes to lie
// midway; later sweeps move what gives way around it.
void meet_midway(AdvanceScratch& s, const RowGroup& group, uint8_t sweep) {
    for_opposed(s, group, [&](uint32_t node) {
        const ContactNodeChange change = s.change[node];
        if (change.pushes == 0) return;
        change.rows = std::max({change.rows, change.pushes, 2u});
        change.way *= change.rows == kStays ? 0.0 : 1.0 / change.rows;
        s.node[node].after += change.way;
        change.change += change.way;
        change.way = Vec4d{};
        change.pushes = 0;
        s.moved_in[node] = sweep;
    });
}

// Moves both sides by their inverse masses, or each side by its share of the way; with a free body always by mass.
void add_push(AdvanceIsland& island, const ContactActive& row, Vec4d way, uint8_t sweep) {
    AdvanceScratch& s = island.scratch;
    const bool by_mass = island.params.contact.share == ResponseShare::kMass || row.turning != kNone;
    double scale[2];  // of the side of the point, of the plane
    if (by_mass) {
        double sum = row.turning != kNone ? 1 / row.inv_sum : 0;
        for (uint32_t k = 0; k < row.nodes; ++k) {
            const double change = row.push_weight[k] * row.push_weight[k] - (row.turning != kNone ? row.weight[k] * row.weight[k] : 0);
            sum += change * s.node[row.node[k]].inv_mass;
        }
        scale[0] = scale[1] = sum > 0 ? 1 / sum : 0;
    } else {
        double sum[2] = {0, 0};
        for (uint32_t k = 0; k < row.nodes; ++k) {
            if (s.node[row.node[k]].inv_mass > 0) sum[k >= row.point_nodes] += row.push_weight[k] * row.push_weight[k];
        }
        const ContactPlan& plan = s.plan[row.plan];
        const bool both_rigid = plan.rigid_a != kNone && plan.rigid_b != kNone;  // a hand and something firm
        const double point = both_rigid ? double(sum[0] > 0) : share_of_point(island, plan.row);
        scale[0] = sum[0] > 0 ? point / sum[0] : 0;
        scale[1] = sum[1] > 0 ? (1 - point) / sum[1] : 0;
    }
    for (uint32_t k = 0; k < row.nodes; ++k) {
        const double inv_mass = s.node[row.node[k]].inv_mass;
        if (!(inv_mass > 0) || is_free(s, row.node[k])) continue;
        const double unit = by_mass ? inv_mass : 1.0;
        move_node(s, row.node[k], (row.push_weight[k] * unit * scale[k >= row.point_nodes]) * way, sweep);
    }
    if (row.turning != kNone) push_free_sides(s, s.turning[row.turning], scale[0] * way);
}

// How far a node of the island is being pushed, m; zero for other particles.
Vec4d push_of(const AdvanceScratch& s, uint32_t particle) {
    const uint32_t n = s.node_of_particle[particle];
    return n != kNone && s.change[n].pushed ? s.change[n].change : Vec4d{};
}

// A body half a substep back, where its velocities are and where measure_energy looks at it: only there do the works of
// kicks and moves add up without a remainder of first order in dt. Before the pushes of this substep.
struct HalfWay {
    const AdvanceIsland& island;
    const AdvanceBody& body;
    Vec4d offset(uint32_t v, Vec4d push) const {
        const uint32_t p = body.particles.first + v;
        const Particles& s = island.particles;
        return float_vec4(_mm_load_ps(&body.next[v].x)) - push -
               (0.5 * island.dt) * make_vec4(s.velocity_x[p], s.velocity_y[p], s.velocity_z[p]);
    }
    Vec4d goal(uint32_t v) const {
        const SpringStep& step = body.step;
        const auto row = [](const float* values) { return make_vec4(values[0], values[1], values[2]); };
        const Vec4d rest = make_vec4(step.anchor_x[v], step.anchor_y[v], step.anchor_z[v]);
        const Vec4d at_start = make_vec4(dot(row(step.turn), rest), dot(row(step.turn + 3), rest), dot(row(step.turn + 6), rest)) +
                               row(step.centre) + row(step.centre_rest);
        return at_start + 0.5 * island.dt * (row(step.drag_velocity) + cross(row(step.drag_turn), at_start));
    }
};

// Elastic and gravity energy that a push adds to one node; what it adds to a spring whose both ends move counts by
// half, the other half is the other end's.
double node_push_work(const HalfWay& at, uint32_t v, Vec4d push, double inv_mass) {
    const AdvanceBody& body = at.body;
    const SpringStep& step = body.step;
    const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
    const Vec4d from = at.offset(v, push);
    double springs = 0;
    for (uint32_t c = step.slice_column[slice]; c < step.slice_column[slice + 1]; ++c) {
        const uint32_t q = step.neighbour[c * kSliceWidth + lane];
        if (q == v) continue;
        const double rest = step.rest_length[c * kSliceWidth + lane];
        const Vec4d far_push = push_of(at.island.scratch, body.particles.first + q), d = at.offset(q, far_push) - from;
        const double before = std::sqrt(norm2(d)) - rest, after = std::sqrt(norm2(d + far_push - push)) - rest;
        const double factor = step.spring_factor ? step.spring_factor[c * kSliceWidth + lane] : 1.0;
        springs += factor * (norm2(far_push) > 0 ? 0.5 : 1.0) * (after * after - before * before);
    }
    const Vec4d to_anchor = from - at.goal(v);
    const double anchor = step.anchor_stiffness[v] * (norm2(to_anchor + push) - norm2(to_anchor));
    // pressure as it was at the start of the substep; tetrahedra are booked for themselves
    const bool pressed = step.force_x && !has_tets(at.island.inputs.other.solids, at.island.inputs.bodies, body.body);
    const double others = pressed ? dot(make_vec4(step.force_x[v], step.force_y[v], step.force_z[v]), push) : 0.0;
    return 0.5 * (step.stiffness * springs + anchor) - others - dot(to_vec4(at.island.params.gravity), push) / inv_mass;
}

// Volume energy that the pushes add to the tetrahedra around one node; a tetrahedron of several pushed nodes counts for
// each by an equal part.
double tet_push_work(const HalfWay& at, uint32_t v) {
    const AdvanceInputs& in = at.island.inputs;
    const uint32_t body = at.body.body;
    if (!has_tets(in.other.solids, in.bodies, body)) return 0;
    const TetStep tets = bind_tets(*in.other.solids, in.bodies, at.island.particles, body, in.other.torn_springs);
    const SolidModuli moduli = solid_moduli(in.bodies.tissue[body]);
    const unsigned* corner[4] = {tets.corner0, tets.corner1, tets.corner2, tets.corner3};
    const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
    double work = 0;
    for (uint32_t c = tets.slot_column[slice]; c < tets.slot_column[slice + 1]; ++c) {
        const uint32_t slot = tets.slot[c * kSliceWidth + lane];
        if (slot == 4 * tets.tetrahedra) continue;
        const uint32_t t = slot % tets.tetrahedra;
        if (tets.rest[t] == 0) continue;  // lost
        Vec3d from[4], to[4];
        int pushed = 0;
        for (int k = 0; k < 4; ++k) {
            const Vec4d push = push_of(at.island.scratch, at.body.particles.first + corner[k][t]);
            from[k] = to_vec3(at.offset(corner[k][t], push));
            to[k] = from[k] + to_vec3(push);
            pushed += norm2(push) > 0;
        }
        const auto energy = [&](const Vec3d* p) {
            return tet_energy(moduli.bulk, moduli.crush, tets.rest[t], six_volumes(p[0], p[1], p[2], p[3]));
        };
        const double factor = tets.factor ? double{tets.factor[t]} : 1.0;
        work += factor * (energy(to) - energy(from)) / std::max(pushed, 1);
    }
    return work;
}

// Books the pushes of the last substep of a call from the springs themselves: the next forces are not there yet.
void book_last_pushes(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    const uint32_t nodes = uint32_t(s.node.size());
    s.node_sums.assign(chunk_count(nodes, kNodesPerChunk), {});
    parallel_for(nodes, kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        double& work = s.node_sums[begin / kNodesPerChunk].work[0];
        for (uint32_t n = begin; n < end; ++n) {
            const ContactNode node = s.node[n];
            if (!s.change[n].pushed || node.particle == kNone) continue;
            const AdvanceBody& body = s.body[node.owner];
            const HalfWay at{island, body};
            const uint32_t v = node.particle - body.particles.first;
            work += node_push_work(at, v, s.change[n].change, node.particle_inv_mass) + tet_push_work(at, v);
        }
    });
    for (const NodeSums& sums : s.node_sums) island.result.work_push += sums.work[0];
}

// Limits the moves to `most`, however many rows push a node, and makes them. What is booked is what the floats hold.
void make_moves(AdvanceIsland& island, double most) {
    AdvanceScratch& s = island.scratch;
    const auto make_move = [&](uint32_t n) {
        if (is_free(s, n)) return;
        const ContactNodeChange change = s.change[n];
        const ContactNode node = s.node[n];
        float* offset = nullptr;
        Vec4d origin = node.place, before = {};
        if (node.particle != kNone) {
            const AdvanceBody& body = s.body[node.owner];
            offset = &body.next[node.particle - body.particles.first].x;
            origin = body.origin;
            before = float_vec4(_mm_load_ps(offset));
        }
        if (!change.opposed) change.change = node.after - (origin + before);
        const double size2 = norm2(change.change);
        if (!(size2 > 0)) return;
        if (size2 > most * most) change.change *= most / std::sqrt(size2);
        if (offset != nullptr) {
            move_particle(s.body[node.owner], node, change.change);
            change.change = float_vec4(_mm_load_ps(offset)) - before;
            change.pushed = !s.body[node.owner].measured();  // whose works are measured
        } else {
            node.place = node.after = node.place + change.change;
            s.rigid[node.owner].place[1].shift = node.place;
        }
    };
    parallel_for(uint32_t(s.node.size()), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t n = begin; n < end; ++n) make_move(n);
    });
}

// Whether a node of a group may have moved in a sweep or a later one. May read what groups of other phases have done.
bool has_moved(const AdvanceScratch& s, const RowGroup& group, uint8_t since) {
    return std::any_of(s.group.begin(), s.group.begin() + s.phase[4], [&](const RowGroup& other) {
        return other.strips.first < group.strips.end() && group.strips.first < other.strips.end() && other.pushed_in >= since;
    });
}

// Free bodies are pushed once, and so are rows that after their push are still deeper than a push may be long. In the first sweep nodes
// pressed from both sides stay until all groups are through. Returns whether any push was made.
bool push_group(AdvanceIsland& island, const PushSweep& sweep, RowGroup& group) {
    AdvanceScratch& s = island.scratch;
    if (!has_moved(s, group, sweep.since)) return false;
    Vec4d normal;
    bool pushed = false;
    for (const ContactActive& row : group.active) {
        if (!has_moved(s, row, sweep.since)) continue;
        if (!(row.inv_sum > 0) || (sweep.stamp > 1 && row.turning != kNone)) continue;
        const double overlap = -gap_after(s, row, normal);
        if (!(overlap > sweep.least) || (sweep.stamp > 1 && overlap > sweep.most)) continue;
        add_push(island, row, std::min(overlap, sweep.most) * normal, sweep.stamp);
        pushed = true;
    }
    pushed = push_blocks(island, sweep, group) || pushed;
    if (pushed) group.pushed_in = sweep.stamp;
    if (sweep.stamp > 1) meet_midway(s, group, sweep.stamp);
    return pushed;
}

bool any_pushed(const AdvanceScratch& s, uint8_t stamp) {
    return std::any_of(s.group.begin(), s.group.begin() + s.phase[4], [&](const RowGroup& group) { return group.pushed_in == stamp; });
}

// One push may undo another: where bodies give way by their masses more sweeps follow. (Where they go a set share of the way one
// sweep is the answer, and under a pressing tool more made tissue chatter.)
bool may_undo(const AdvanceIsland& island) {
    const AdvanceScratch& s = island.scratch;
    const auto is_led = [&](const AdvanceRigid& rigid) { return rigid.node != kNone && (rigid.free == kNone || s.free[rigid.free].held); };
    return island.params.contact.share == ResponseShare::kMass && std::none_of(s.rigid.begin(), s.rigid.end(), is_led);
}

// Sweeps over all groups: one; the others of each group while it is in the cache; up to fifteen times as many of all groups in turn for
// what is left deeper than the tolerance. Returns whether any row was pushed.
bool push_groups(AdvanceIsland& island, double most) {
    AdvanceScratch& s = island.scratch;
    constexpr uint32_t kLastStamp = 254;
    const double tolerance = std::max(kRestingOverlap, island.params.contact.tolerance);
    const uint8_t sweeps = static_cast<uint8_t>(std::min(island.params.contact.iterations, kLastStamp));
    const uint8_t last = static_cast<uint8_t>(std::min(16u * sweeps, kLastStamp));
    s.moved_in.assign(s.node.size(), 0);
    for_each_group(s, [&](RowGroup& group) {
        group.pushed_in = 0;
        forget_ways(s, group);
    });
    for_each_group(s, [&](RowGroup& group) { push_group(island, {kRestingOverlap, most, 1, 0}, group); });
    if (!any_pushed(s, 1)) return false;
    for_each_group(s, [&](const RowGroup& group) { meet_midway(s, group, 1); });
    if (sweeps == 1 || !may_undo(island)) return true;
    for_each_group(s, [&](const RowGroup& group) { keep_midway(s, group); });
    for_each_group(s, [&](RowGroup& group) {
        uint8_t stamp = 1;
        while (++stamp <= sweeps && push_group(island, {kRestingOverlap, most, stamp, static_cast<uint8_t>(stamp - 1)}, group)) {
        }
    });
    uint8_t since = 2;
    for (uint8_t stamp = sweeps + 1; stamp <= last; since = stamp++) {
        for_each_group(s, [&](RowGroup& group) { push_group(island, {tolerance, most, stamp, since}, group); });
        if (!any_pushed(s, stamp)) break;
    }
    return true;
}

}  // namespace

double share_of_point(const AdvanceIsland& island, uint32_t row) {
    const Bodies& bodies = island.inputs.bodies;
    const uint32_t point = island.rows.body[row], plane = island.rows.other[row];
    if (!is_deformable(bodies, point)) return 0;
    if (!is_deformable(bodies, plane)) return 1;
    if (island.params.contact.share == ResponseShare::kHalf) return 0.5;
    const double a = bodies.spring_stiffness[point], b = bodies.spring_stiffness[plane];
    return b / (a + b);
}

void push_out(AdvanceIsland& island, uint32_t substep) {
    AdvanceScratch& s = island.scratch;
    const AdvanceParams& params = island.params;
    const uint64_t begin = params.tick * params.substeps + uint64_t{params.ticks} * substep, end = begin + params.ticks;
    const auto started = [&](uint64_t time) { return (time + params.substeps - 1) / params.substeps; };
    const uint64_t ms = started(end) - started(begin);  // that begin in this substep
    if (ms > 0) {
        const double most = params.contact.push_speed * 1e-3 * static_cast<double>(ms);
        const bool any = push_groups(island, most);
        if (any) make_moves(island, most);
        if (any && any_turns(s)) finish_free_pushes(island, most);
    }
    if (substep + 1 < params.substeps) return;
    if (params.account_energy) book_last_pushes(island);
    for_each_group(s, [&](RowGroup& group) {
        Vec4d normal;
        group.deepest = deepest_in_blocks(s, group);
        for (const ContactActive& row : group.active) group.deepest = std::max(group.deepest, -gap_after(s, row, normal));
    });
    double deepest = 0;
    for (uint32_t g = 0; g < s.phase[4]; ++g) deepest = std::max(deepest, s.group[g].deepest);
    island.result.deepest_residual = deepest;
    for (uint32_t n = 0; n < s.node.size(); ++n) {
        island.result.opposing_planes += s.change[n].opposed && s.node[n].particle != kNone;
    }
}

}  // namespace trocar
