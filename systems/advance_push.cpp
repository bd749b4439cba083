#include "systems/advance_push.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "engine/surfaces.hpp"
#include "engine/tet_forces.hpp"
#include "systems/advance_blocks.hpp"
#include "systems/advance_constants.hpp"
#include "systems/advance_free.hpp"
namespace trocar {
namespace {

// Separation of a constraint at the end of the substep, and its normal there. It is measured at the points that corrections move, so
// that a correction changes the separation of each constraint at its nodes by as much as that constraint's own equations say, and
// sweeps converge.
double gap_after(const AdvanceIsland& island, const PreparedConstraint& row, Vec4d& normal) {
    Vec4d apart;
    if (row.rigid_a == kNone) {
        apart = row.weight_a[0] * field_at(island.nodes, row.node_a[0], &ContactNodes::after);
        if (row.weight_a[1] != 0) apart += row.weight_a[1] * field_at(island.nodes, row.node_a[1], &ContactNodes::after);
        if (row.weight_a[2] != 0) apart += row.weight_a[2] * field_at(island.nodes, row.node_a[2], &ContactNodes::after);
    } else {
        apart = island.rigid[row.rigid_a].place[1](row.point_a);
    }
    if (row.rigid_b == kNone) {
        for (uint32_t k = row.point_nodes; k < row.nodes; ++k) apart += row.push_weight[k] * island.nodes.node[row.node[k]].after;
        normal = row.plane;
    } else {
        const RigidMap& place = island.rigid[row.rigid_b].place[1];
        apart -= place(row.point_b);
        normal = place.turn(row.plane);
    }
    return dot(normal, apart) + row.push_gap - row.offset;
}

bool is_free(const AdvanceIsland& island, uint32_t node) {
    const ConstContactNode n = island.nodes.node[node];
    return n.particle == kNone && n.owner < island.rigid.size() && island.rigid[n.owner].free != kNone;  // the node of no mass has no owner
}

// Moves a node for a correction; constraints solved later see it moved. A node pressed from both sides does not move at once: its
// constraints' displacements are summed up over a sweep, and meet_midway moves it by their mean.
void move_node(uint32_t node, Vec4d move, uint8_t sweep, ContactNodeSet& nodes) {
    if (const ContactNodeChange change = nodes.change[node]; change.opposed) {
        change.way += move;
        ++change.pushes;
    } else {
        nodes.node[node].after += move;
        nodes.moved_in[node] = sweep;
    }
}

// Runs visit(node) for all nodes of a group pressed from both sides, for some more than once. None of them is in a block.
template <typename Visit>
void for_opposed(const ContactSolver& solver, const ContactNodeSet& nodes, const RowGroup& group, const Visit& visit) {
    for (const uint32_t i : group.active) {
        const PreparedConstraint& row = solver.prepared[i];
        for (uint32_t k = 0; k < row.nodes; ++k)
            if (nodes.change[row.node[k]].opposed) visit(row.node[k]);
    }
}
void forget_ways(const ContactSolver& solver, const RowGroup& group, ContactNodeSet& nodes) {
    for_opposed(solver, nodes, group, [&](uint32_t node) {
        const ContactNodeChange change = nodes.change[node];
        change.way = Vec4d{};
        change.rows = change.pushes = 0;
    });
}
bool has_moved_node(const ContactNodeSet& nodes, const PreparedConstraint& row, uint8_t since) {
    return std::any_of(row.node.begin(), row.node.begin() + row.nodes, [&](uint32_t node) { return nodes.moved_in[node] >= since; });
}
// Free bodies are corrected in the first sweep only. A node that a free body presses from one side and something else from the other
// stays where that sweep put it: in later ones only the other side would move it.
constexpr uint32_t kStays = kNone;
void keep_midway(const ContactSolver& solver, const RowGroup& group, ContactNodeSet& nodes) {
    for (const uint32_t i : group.active) {
        const PreparedConstraint& row = solver.prepared[i];
        for (uint32_t k = 0; row.turns() && k < row.nodes; ++k)
            if (nodes.change.opposed[row.node[k]]) nodes.change.rows[row.node[k]] = kStays;
    }
}
// Moves the nodes pressed from both sides by the sum of the displacements that constraints asked for in a sweep, over the largest
// number of constraints that asked in one sweep. That converges however many they are (mass splitting, Tonge et al. 2012). Where as
// many press from either side a node comes to lie midway; in later sweeps what gives way around it moves.
void meet_midway(const ContactSolver& solver, const RowGroup& group, uint8_t sweep, ContactNodeSet& nodes) {
    for_opposed(solver, nodes, group, [&](uint32_t node) {
        const ContactNodeChange change = nodes.change[node];
        if (change.pushes == 0) return;
        change.rows = std::max({change.rows, change.pushes, 2u});
        change.way *= change.rows == kStays ? 0.0 : 1.0 / change.rows;
        nodes.node[node].after += change.way;
        change.change += change.way;
        change.way = Vec4d{};
        change.pushes = 0;
        nodes.moved_in[node] = sweep;
    });
}

// Corrects a constraint by `way` (m, along its normal): both sides by their inverse masses, or each by its share; with a free body
// always by mass.
void add_push(const AdvanceCall& call, const ContactRows& rows, const PreparedConstraint& row, Vec4d way, uint8_t sweep,
              AdvanceIsland& island) {
    const bool by_mass = call.params.contact.share == ResponseShare::kMass || row.turns();
    double scale[2];  // of the side of the point, of the plane
    if (by_mass) {
        double sum = row.turns() ? 1 / row.inv_sum : 0;
        for (uint32_t k = 0; k < row.nodes; ++k) {
            const double change = row.push_weight[k] * row.push_weight[k] - (row.turns() ? row.weight[k] * row.weight[k] : 0);
            sum += change * island.nodes.node[row.node[k]].inv_mass;
        }
        scale[0] = scale[1] = sum > 0 ? 1 / sum : 0;
    } else {
        double sum[2] = {0, 0};
        for (uint32_t k = 0; k < row.nodes; ++k) {
            if (island.nodes.node[row.node[k]].inv_mass > 0) sum[k >= row.point_nodes] += row.push_weight[k] * row.push_weight[k];
        }
        const bool both_rigid = row.rigid_a != kNone && row.rigid_b != kNone;  // a hand and something firm
        const double point = both_rigid ? double(sum[0] > 0) : share_of_point(call, rows, row.row);
        scale[0] = sum[0] > 0 ? point / sum[0] : 0;
        scale[1] = sum[1] > 0 ? (1 - point) / sum[1] : 0;
    }
    for (uint32_t k = 0; k < row.nodes; ++k) {
        const double inv_mass = island.nodes.node[row.node[k]].inv_mass;
        if (!(inv_mass > 0) || is_free(island, row.node[k])) continue;
        const double unit = by_mass ? inv_mass : 1.0;
        move_node(row.node[k], (row.push_weight[k] * unit * scale[k >= row.point_nodes]) * way, sweep, island.nodes);
    }
    if (row.turns()) push_free_sides(row, scale[0] * way, island);
}

// How far a node of the island is being pushed, m; zero for other particles.
Vec4d push_of(const ContactNodeSet& nodes, uint32_t particle) {
    const uint32_t n = nodes.node_of_particle[particle];
    return n != kNone && nodes.change[n].pushed ? nodes.change[n].change : Vec4d{};
}

// A body half a substep back, where its velocities are and where measure_energy looks at it: only there do the works of
// kicks and moves add up without a remainder of first order in dt. Before the pushes of this substep.
struct HalfWay {
    const Particles& particles;
    const AdvanceBody& body;
    double dt;  // s
    Vec4d offset(uint32_t v, Vec4d push) const {
        const uint32_t p = body.particles.first + v;
        return float_vec4(_mm_load_ps(&body.next[v].x)) - push -
               (0.5 * dt) * make_vec4(particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]);
    }
    Vec4d goal(uint32_t v) const {
        const SpringStep& step = body.step;
        const auto row = [](const float* values) { return make_vec4(values[0], values[1], values[2]); };
        const Vec4d rest = make_vec4(step.anchor_x[v], step.anchor_y[v], step.anchor_z[v]);
        const Vec4d at_start = make_vec4(dot(row(step.turn), rest), dot(row(step.turn + 3), rest), dot(row(step.turn + 6), rest)) +
                               row(step.centre) + row(step.centre_rest);
        return at_start + 0.5 * dt * (row(step.drag_velocity) + cross(row(step.drag_turn), at_start));
    }
};

// Elastic and gravity energy that a push adds to one node; what it adds to a spring whose both ends move counts by
// half, the other half is the other end's.
double node_push_work(const AdvanceCall& call, const ContactNodeSet& nodes, const HalfWay& at, uint32_t v, Vec4d push, double inv_mass) {
    const AdvanceBody& body = at.body;
    const SpringStep& step = body.step;
    const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
    const Vec4d from = at.offset(v, push);
    double springs = 0;
    for (uint32_t c = step.slice_column[slice]; c < step.slice_column[slice + 1]; ++c) {
        const uint32_t q = step.neighbour[c * kSliceWidth + lane];
        if (q == v) continue;
        const double rest = step.rest_length[c * kSliceWidth + lane];
        const Vec4d far_push = push_of(nodes, body.particles.first + q), d = at.offset(q, far_push) - from;
        const double before = std::sqrt(norm2(d)) - rest, after = std::sqrt(norm2(d + far_push - push)) - rest;
        const double factor = step.spring_factor ? step.spring_factor[c * kSliceWidth + lane] : 1.0;
        springs += factor * (norm2(far_push) > 0 ? 0.5 : 1.0) * (after * after - before * before);
    }
    const Vec4d to_anchor = from - at.goal(v);
    const double anchor = step.anchor_stiffness[v] * (norm2(to_anchor + push) - norm2(to_anchor));
    // pressure as it was at the start of the substep; tetrahedra are booked for themselves
    const bool pressed = step.force_x && !has_tets(call.inputs.other.solids, call.inputs.bodies, body.body);
    const double others = pressed ? dot(make_vec4(step.force_x[v], step.force_y[v], step.force_z[v]), push) : 0.0;
    return 0.5 * (step.stiffness * springs + anchor) - others - dot(to_vec4(call.params.gravity), push) / inv_mass;
}

// Volume energy that the pushes add to the tetrahedra around one node; a tetrahedron of several pushed nodes counts for
// each by an equal part.
double tet_push_work(const AdvanceCall& call, const ContactNodeSet& nodes, const Particles& particles, const HalfWay& at, uint32_t v) {
    const AdvanceInputs& in = call.inputs;
    const uint32_t body = at.body.body;
    if (!has_tets(in.other.solids, in.bodies, body)) return 0;
    const TetStep tets = bind_tets(*in.other.solids, in.bodies, particles, body, in.other.torn_springs);
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
            const Vec4d push = push_of(nodes, at.body.particles.first + corner[k][t]);
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
void book_last_pushes(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result) {
    const uint32_t count = uint32_t(island.nodes.node.size());
    island.nodes.node_sums.assign(chunk_count(count, kNodesPerChunk), {});
    parallel_for(count, kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        double& work = island.nodes.node_sums[begin / kNodesPerChunk].work[0];
        for (uint32_t n = begin; n < end; ++n) {
            const ContactNode node = island.nodes.node[n];
            if (!island.nodes.change[n].pushed || node.particle == kNone) continue;
            const AdvanceBody& body = island.body[node.owner];
            const HalfWay at{particles, body, call.dt};
            const uint32_t v = node.particle - body.particles.first;
            work += node_push_work(call, island.nodes, at, v, island.nodes.change[n].change, node.particle_inv_mass) +
                    tet_push_work(call, island.nodes, particles, at, v);
        }
    });
    for (const NodeSums& sums : island.nodes.node_sums) result.work_push += sums.work[0];
}

// Limits the moves to `most`, however many rows push a node, and makes them. What is booked is what the floats hold.
void make_moves(double most, AdvanceIsland& island) {
    const auto make_move = [&](uint32_t n) {
        if (is_free(island, n)) return;
        const ContactNodeChange change = island.nodes.change[n];
        const ContactNode node = island.nodes.node[n];
        float* offset = nullptr;
        Vec4d origin = node.place, before = {};
        if (node.particle != kNone) {
            const AdvanceBody& body = island.body[node.owner];
            offset = &body.next[node.particle - body.particles.first].x;
            origin = body.origin;
            before = float_vec4(_mm_load_ps(offset));
        }
        if (!change.opposed) change.change = node.after - (origin + before);
        const double size2 = norm2(change.change);
        if (!(size2 > 0)) return;
        if (size2 > most * most) change.change *= most / std::sqrt(size2);
        if (offset != nullptr) {
            move_particle(island.body[node.owner], node, change.change);
            change.change = float_vec4(_mm_load_ps(offset)) - before;
            change.pushed = !island.body[node.owner].measured();  // whose works are measured
        } else {
            node.place = node.after = node.place + change.change;
            island.rigid[node.owner].place[1].shift = node.place;
        }
    };
    parallel_for(uint32_t(island.nodes.node.size()), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t n = begin; n < end; ++n) make_move(n);
    });
}

// Whether a node of a group may have moved in a sweep or a later one. May read what groups of other phases have done.
bool has_moved(const ContactSolver& solver, const RowGroup& group, uint8_t since) {
    return std::any_of(solver.group.begin(), solver.group.begin() + solver.phase[4], [&](const RowGroup& other) {
        return other.strips.first < group.strips.end() && group.strips.first < other.strips.end() && other.pushed_in >= since;
    });
}

// One sweep over a group. After the first one constraints with a free body are passed over, and so are those deeper than the longest
// correction; nodes pressed from both sides move at the end of the group's sweep, in the first sweep once all groups are through.
// Returns whether any constraint was corrected.
bool push_group(const AdvanceCall& call, const ContactRows& rows, const PushSweep& sweep, ContactSolver& solver, AdvanceIsland& island,
                RowGroup& group) {
    if (!has_moved(solver, group, sweep.since)) return false;
    Vec4d normal;
    bool pushed = false;
    for (const uint32_t i : group.active) {
        const PreparedConstraint& row = solver.prepared[i];
        if (!has_moved_node(island.nodes, row, sweep.since)) continue;
        if (!(row.inv_sum > 0) || (sweep.stamp > 1 && row.turns())) continue;
        const double overlap = -gap_after(island, row, normal);
        if (!(overlap > sweep.least) || (sweep.stamp > 1 && overlap > sweep.most)) continue;
        add_push(call, rows, row, std::min(overlap, sweep.most) * normal, sweep.stamp, island);
        pushed = true;
    }
    pushed = push_blocks(call, rows, sweep, group, solver, island.nodes) || pushed;
    if (pushed) group.pushed_in = sweep.stamp;
    if (sweep.stamp > 1) meet_midway(solver, group, sweep.stamp, island.nodes);
    return pushed;
}

bool any_pushed(const ContactSolver& solver, uint8_t stamp) {
    return std::any_of(solver.group.begin(), solver.group.begin() + solver.phase[4],
                       [&](const RowGroup& group) { return group.pushed_in == stamp; });
}

// Whether one correction may undo another, so that more sweeps follow: where bodies share corrections by mass. (Where each goes a set
// share one sweep is the answer, and under a pressing tool more made tissue chatter.)
bool may_undo(const AdvanceCall& call, const AdvanceIsland& island) {
    const auto is_led = [&](const AdvanceRigid& rigid) {
        return rigid.node != kNone && (rigid.free == kNone || island.free[rigid.free].held);
    };
    return call.params.contact.share == ResponseShare::kMass && std::none_of(island.rigid.begin(), island.rigid.end(), is_led);
}

// Sweeps over all groups: the first over all of them; the other ones of each group while it is in the cache; then up to fifteen times
// as many over all groups in turn for what is left deeper than the tolerance. Returns whether any constraint was corrected.
bool push_groups(const AdvanceCall& call, const ContactRows& rows, double most, ContactSolver& solver, AdvanceIsland& island) {
    constexpr uint32_t kLastStamp = 254;
    const double tolerance = std::max(kRestingOverlap, call.params.contact.tolerance);
    const uint8_t sweeps = static_cast<uint8_t>(std::min(call.params.contact.iterations, kLastStamp));
    const uint8_t last = static_cast<uint8_t>(std::min(16u * sweeps, kLastStamp));
    island.nodes.moved_in.assign(island.nodes.node.size(), 0);
    for_each_group(solver, [&](RowGroup& group) {
        group.pushed_in = 0;
        forget_ways(solver, group, island.nodes);
    });
    for_each_group(solver, [&](RowGroup& group) { push_group(call, rows, {kRestingOverlap, most, 1, 0}, solver, island, group); });
    if (!any_pushed(solver, 1)) return false;
    for_each_group(solver, [&](const RowGroup& group) { meet_midway(solver, group, 1, island.nodes); });
    if (sweeps == 1 || !may_undo(call, island)) return true;
    for_each_group(solver, [&](const RowGroup& group) { keep_midway(solver, group, island.nodes); });
    for_each_group(solver, [&](RowGroup& group) {
        uint8_t stamp = 1;
        while (++stamp <= sweeps &&
               push_group(call, rows, {kRestingOverlap, most, stamp, static_cast<uint8_t>(stamp - 1)}, solver, island, group)) {
        }
    });
    uint8_t since = 2;
    for (uint8_t stamp = sweeps + 1; stamp <= last; since = stamp++) {
        for_each_group(solver, [&](RowGroup& group) { push_group(call, rows, {tolerance, most, stamp, since}, solver, island, group); });
        if (!any_pushed(solver, stamp)) break;
    }
    return true;
}

}  // namespace

double share_of_point(const AdvanceCall& call, const ContactRows& rows, uint32_t row) {
    const Bodies& bodies = call.inputs.bodies;
    const uint32_t point = rows.body[row], plane = rows.other[row];
    if (!is_deformable(bodies, point)) return 0;
    if (!is_deformable(bodies, plane)) return 1;
    if (call.params.contact.share == ResponseShare::kHalf) return 0.5;
    const double a = bodies.spring_stiffness[point], b = bodies.spring_stiffness[plane];
    return b / (a + b);
}

void push_out(const AdvanceCall& call, ContactSolver& solver, AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result) {
    const uint32_t substep = call.substep;
    const AdvanceParams& params = call.params;
    const uint64_t begin = params.tick * params.substeps + uint64_t{params.ticks} * substep, end = begin + params.ticks;
    const auto started = [&](uint64_t time) { return (time + params.substeps - 1) / params.substeps; };
    const uint64_t ms = started(end) - started(begin);  // that begin in this substep
    if (ms > 0) {
        const double most = params.contact.push_speed * 1e-3 * static_cast<double>(ms);
        const bool any = push_groups(call, state.rows, most, solver, island);
        if (any) make_moves(most, island);
        if (any && any_turns(solver)) finish_free_pushes(call, most, island, result);
    }
    if (substep + 1 < params.substeps) return;
    if (params.account_energy) book_last_pushes(call, state.particles, island, result);
    for_each_group(solver, [&](RowGroup& group) {
        Vec4d normal;
        group.deepest = deepest_in_blocks(island.nodes, group, solver);
        for (const uint32_t i : group.active) group.deepest = std::max(group.deepest, -gap_after(island, solver.prepared[i], normal));
    });
    double deepest = 0;
    for (uint32_t g = 0; g < solver.phase[4]; ++g) deepest = std::max(deepest, solver.group[g].deepest);
    result.deepest_residual = deepest;
    for (uint32_t n = 0; n < island.nodes.node.size(); ++n) {
        result.opposing_planes += island.nodes.change[n].opposed && island.nodes.node[n].particle != kNone;
    }
}

}  // namespace trocar
