#include "systems/advance/contact/position_correction.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/contact/wide_constraints.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/advance/rigid/free_bodies.hpp"
namespace trocar {
namespace {

// Separation of a constraint at the end of the substep, and its normal there. It is measured at the points that corrections move, so
// that a correction changes the separation of each constraint at its nodes by as much as that constraint's own equations say, and
// sweeps converge.
double separation_after(const AdvanceIsland& island, const PreparedConstraint& constraint, Vec4d& normal) {
    Vec4d apart;
    if (constraint.rigid_a == kNone) {
        apart = constraint.weight_a[0] * field_at(island.nodes, constraint.node_a[0], &ContactNodes::after);
        if (constraint.weight_a[1] != 0)
            apart += constraint.weight_a[1] * field_at(island.nodes, constraint.node_a[1], &ContactNodes::after);
        if (constraint.weight_a[2] != 0)
            apart += constraint.weight_a[2] * field_at(island.nodes, constraint.node_a[2], &ContactNodes::after);
    } else {
        apart = island.rigid[constraint.rigid_a].pose[1](constraint.point_a);
    }
    if (constraint.rigid_b == kNone) {
        for (uint32_t k = constraint.point_nodes; k < constraint.nodes; ++k)
            apart += constraint.correction_weight[k] * island.nodes.node[constraint.node[k]].after;
        normal = constraint.plane;
    } else {
        const RigidMap& pose = island.rigid[constraint.rigid_b].pose[1];
        apart -= pose(constraint.point_b);
        normal = pose.turn(constraint.plane);
    }
    return dot(normal, apart) + constraint.correction_offset - constraint.offset;
}

bool is_free(const AdvanceIsland& island, uint32_t node) {
    const ConstContactNode n = island.nodes.node[node];
    return n.particle == kNone && n.owner < island.rigid.size() && island.rigid[n.owner].free != kNone;  // the massless node has no owner
}

bool has_held_side(const AdvanceIsland& island, const PreparedConstraint& constraint) {
    // jaws press tissue from two sides and keep what they overlap
    for (const uint32_t rigid : {constraint.rigid_a, constraint.rigid_b})
        if (rigid != kNone && island.rigid[rigid].jaw != kNone) return false;
    return std::ranges::any_of(constraint.angular.free, [&](uint32_t free) { return free != kNone && island.free[free].held; });
}

// Moves a node by a correction, visible to constraints solved later. A node pressed from opposite sides does
// not move at once: its constraints' displacements are summed over a sweep, then meet_midway moves it.
void move_node(uint32_t node, Vec4d move, uint8_t sweep, ContactNodeSet& nodes) {
    if (const ContactNodeChange change = nodes.change[node]; change.conflicting) {
        change.displacement += move;
        ++change.corrections;
    } else {
        nodes.node[node].after += move;
        nodes.moved_in[node] = sweep;
    }
}

// Runs visit(node) for all nodes of a group pressed from opposite sides (none is wide); may repeat.
template <typename Visit>
void for_conflicting(const ContactSolver& solver, const ContactNodeSet& nodes, const ConstraintGroup& group, const Visit& visit) {
    for (const uint32_t i : group.active) {
        const PreparedConstraint& constraint = solver.prepared[i];
        for (uint32_t k = 0; k < constraint.nodes; ++k)
            if (nodes.change[constraint.node[k]].conflicting) visit(constraint.node[k]);
    }
}
void forget_displacements(const ContactSolver& solver, const ConstraintGroup& group, ContactNodeSet& nodes) {
    for_conflicting(solver, nodes, group, [&](uint32_t node) {
        const ContactNodeChange change = nodes.change[node];
        change.displacement = Vec4d{};
        change.constraint_count = change.corrections = 0;
    });
}
bool has_moved_node(const ContactNodeSet& nodes, const PreparedConstraint& constraint, uint8_t since) {
    return std::any_of(constraint.node.begin(), constraint.node.begin() + constraint.nodes,
                       [&](uint32_t node) { return nodes.moved_in[node] >= since; });
}
// Free bodies are corrected in the first sweep only. A node between a free body and something on the other
// side stays where that sweep put it: in later ones only the other side would move it.
constexpr uint32_t kStays = kNone;
void keep_midway(const ContactSolver& solver, const ConstraintGroup& group, ContactNodeSet& nodes) {
    for (const uint32_t i : group.active) {
        const PreparedConstraint& constraint = solver.prepared[i];
        for (uint32_t k = 0; constraint.turns() && k < constraint.nodes; ++k)
            if (nodes.change.conflicting[constraint.node[k]]) nodes.change.constraint_count[constraint.node[k]] = kStays;
    }
}
// Moves each node pressed from opposite sides by the summed displacements of this sweep, divided by the
// largest number of constraints that moved the node in any sweep so far (at least 2). Converges for any
// number (mass splitting, Tonge et al. 2012). With equal numbers on both sides the node ends midway; later
// sweeps move what yields around it.
void meet_midway(const ContactSolver& solver, const ConstraintGroup& group, uint8_t sweep, ContactNodeSet& nodes) {
    for_conflicting(solver, nodes, group, [&](uint32_t node) {
        const ContactNodeChange change = nodes.change[node];
        if (change.corrections == 0) return;
        change.constraint_count = std::max({change.constraint_count, change.corrections, 2u});
        change.displacement *= change.constraint_count == kStays ? 0.0 : 1.0 / change.constraint_count;
        nodes.node[node].after += change.displacement;
        change.change += change.displacement;
        change.displacement = Vec4d{};
        change.corrections = 0;
        nodes.moved_in[node] = sweep;
    });
}

// Finds the nodes that what does not yield (jaws, hands, static bodies) presses from opposite sides and across, beyond 30 degrees from
// one line: tissue between the teeth of closed jaws, or pierced by edges. No displacement frees them, and midway of such planes is another
// place in every pass, so that corrections would strain the tissue pass after pass.
void find_tangled_nodes(ContactSolver& solver, AdvanceIsland& island) {
    ContactNodeSet& nodes = island.nodes;
    nodes.tangled.assign(nodes.node.size(), 0);
    const auto is_led = [&](uint32_t rigid) {
        return rigid != kNone && (island.rigid[rigid].free == kNone || island.free[island.rigid[rigid].free].held);
    };
    for_each_group(solver, [&](ConstraintGroup& group) {
        group.pressing.clear();
        Vec4d normal;
        for (const uint32_t i : group.active) {
            const PreparedConstraint& c = solver.prepared[i];
            if ((is_led(c.rigid_a) || is_led(c.rigid_b)) && -separation_after(island, c, normal) > kRestingOverlap)
                group.pressing.push_back({normal, i});
        }
    });
    size_t pressing = 0;
    for (uint32_t g = 0; g < solver.colour[4]; ++g) pressing += solver.group[g].pressing.size();
    if (pressing < 2) return;
    nodes.pressed.assign(nodes.node.size(), Vec4d{});
    const auto for_each_direction = [&](const auto& visit) {
        for_each_group(solver, [&](const ConstraintGroup& group) {
            for (const auto& [normal, i] : group.pressing) {
                const PreparedConstraint& c = solver.prepared[i];
                for (uint32_t k = 0; k < c.nodes; ++k)
                    if (c.correction_weight[k] != 0) visit(c.node[k], k < c.point_nodes ? normal : -normal);
            }
        });
    };
    for_each_direction([&](uint32_t node, Vec4d direction) { nodes.pressed[node] += direction; });
    constexpr uint8_t kOpposed = 1, kAcross = 2;
    for_each_direction([&](uint32_t node, Vec4d direction) {
        const double along = dot(nodes.pressed[node], direction);
        if (!(along > 0 && along * along >= kLean * kLean * norm2(nodes.pressed[node]))) nodes.tangled[node] |= kOpposed;
        if (std::abs(dot(nodes.change.displacement[node], direction)) < kOneLine) nodes.tangled[node] |= kAcross;
    });
    for (size_t n = 0; n < nodes.node.size(); ++n)
        nodes.tangled[n] = nodes.tangled[n] == (kOpposed | kAcross) && nodes.node.particle[n] != kNone;
}
bool is_tangled(const ContactNodeSet& nodes, const PreparedConstraint& constraint) {
    return std::any_of(constraint.node.begin(), constraint.node.begin() + constraint.nodes,
                       [&](uint32_t node) { return nodes.tangled[node] != 0; });
}

// Corrects a constraint by a displacement (m): moves both sides by their inverse masses or by their shares;
// with a free body always by mass.
void add_correction(const AdvanceCall& call, const ContactConstraints& constraints, const PreparedConstraint& constraint,
                    Vec4d displacement, uint8_t sweep, AdvanceIsland& island) {
    const bool by_mass = call.params.contact.share == ResponseShare::kMass || constraint.turns();
    double scale[2];  // of the side of the point, of the plane
    if (by_mass) {
        double sum = constraint.turns() ? 1 / constraint.effective_mass : 0;
        for (uint32_t k = 0; k < constraint.nodes; ++k) {
            const double change = constraint.correction_weight[k] * constraint.correction_weight[k] -
                                  (constraint.turns() ? constraint.weight[k] * constraint.weight[k] : 0);
            sum += change * island.nodes.node[constraint.node[k]].inv_mass;
        }
        scale[0] = scale[1] = sum > 0 ? 1 / sum : 0;
    } else {
        double sum[2] = {0, 0};
        for (uint32_t k = 0; k < constraint.nodes; ++k) {
            if (island.nodes.node[constraint.node[k]].inv_mass > 0)
                sum[k >= constraint.point_nodes] += constraint.correction_weight[k] * constraint.correction_weight[k];
        }
        const bool both_rigid = constraint.rigid_a != kNone && constraint.rigid_b != kNone;  // a hand against a rigid body
        const double point = both_rigid ? double(sum[0] > 0) : share_of_point(call, constraints, constraint.constraint);
        scale[0] = sum[0] > 0 ? point / sum[0] : 0;
        scale[1] = sum[1] > 0 ? (1 - point) / sum[1] : 0;
    }
    for (uint32_t k = 0; k < constraint.nodes; ++k) {
        const double inv_mass = island.nodes.node[constraint.node[k]].inv_mass;
        if (!(inv_mass > 0) || is_free(island, constraint.node[k])) continue;
        const double unit = by_mass ? inv_mass : 1.0;
        move_node(constraint.node[k], (constraint.correction_weight[k] * unit * scale[k >= constraint.point_nodes]) * displacement, sweep,
                  island.nodes);
    }
    if (constraint.turns()) correct_free_sides(constraint, scale[0] * displacement, island);
}

// Correction of a node of the island so far, m; zero for other particles.
Vec4d correction_of(const ContactNodeSet& nodes, uint32_t particle) {
    const uint32_t n = nodes.node_of_particle[particle];
    return n != kNone && nodes.change[n].corrected ? nodes.change[n].change : Vec4d{};
}

// A body half a substep back, at the time of its velocities, where measure_energy evaluates it: only there do
// the works of kicks and moves add up without a first-order error in dt. Before this substep's corrections.
struct HalfStepBack {
    const Particles& particles;
    const AdvanceBody& body;
    double dt;  // s
    Vec4d offset(uint32_t v, Vec4d correction) const {
        const uint32_t p = body.particles.first + v;
        return float_vec4(_mm_load_ps(&body.next[v].x)) - correction -
               (0.5 * dt) * make_vec4(particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]);
    }
    Vec4d goal(uint32_t v) const {
        const SpringStep& step = body.step;
        const auto vector_of = [](const float* values) { return make_vec4(values[0], values[1], values[2]); };
        const Vec4d rest = make_vec4(step.anchor_x[v], step.anchor_y[v], step.anchor_z[v]);
        const Vec4d at_start =
            make_vec4(dot(vector_of(step.turn), rest), dot(vector_of(step.turn + 3), rest), dot(vector_of(step.turn + 6), rest)) +
            vector_of(step.centre) + vector_of(step.centre_rest);
        return at_start + 0.5 * dt * (vector_of(step.drag_velocity) + cross(vector_of(step.drag_turn), at_start));
    }
};

// Twice the energy / stiffness (m^2) that a sudden change of the stretch adds to a spring's Maxwell elements.
double branches_work(const SpringStep& step, size_t at, double before, double after) {
    double work = 0;
    for (uint32_t b = 0; b < step.branches; ++b) {
        const double share = 0.5 / double{step.stored[b]};
        work += (after - before) * (2 * double{step.overstretch[b * static_cast<size_t>(step.branch_stride) + at]} +
                                    share * (after + before - 2 * double{step.stretch[at]}));
    }
    return work;
}

// Elastic and gravity energy that a correction adds to one node; a spring with both ends moved counts by half
// per end.
double node_correction_work(const AdvanceCall& call, const ContactNodeSet& nodes, const HalfStepBack& at, uint32_t v, Vec4d correction,
                            double inv_mass) {
    const AdvanceBody& body = at.body;
    const SpringStep& step = body.step;
    const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
    const Vec4d from = at.offset(v, correction);
    double springs = 0;
    for (uint32_t c = step.slice_column[slice]; c < step.slice_column[slice + 1]; ++c) {
        const uint32_t q = step.neighbour[c * kSliceWidth + lane];
        if (q == v) continue;
        const double rest = step.rest_length[c * kSliceWidth + lane];
        const Vec4d far_correction = correction_of(nodes, body.particles.first + q), d = at.offset(q, far_correction) - from;
        const double before = std::sqrt(norm2(d)) - rest, after = std::sqrt(norm2(d + far_correction - correction)) - rest;
        const double factor = step.spring_factor ? step.spring_factor[c * kSliceWidth + lane] : 1.0;
        const double share = factor * (norm2(far_correction) > 0 ? 0.5 : 1.0);
        if (!step.other_law) springs += share * (after * after - before * before);
        if (step.branches > 0) springs += share * branches_work(step, (c - step.first_column) * kSliceWidth + lane, before, after);
    }
    const Vec4d to_anchor = from - at.goal(v);
    const double anchor = step.anchor_stiffness[v] * (norm2(to_anchor + correction) - norm2(to_anchor));
    // pressure as at the start of the substep; tetrahedra are accounted for separately
    const bool pressed = step.force_x && !has_tets(call.inputs.other.solids, call.inputs.bodies, body.body);
    const double others = pressed ? dot(make_vec4(step.force_x[v], step.force_y[v], step.force_z[v]), correction) : 0.0;
    return 0.5 * (step.stiffness * springs + anchor) - others - dot(to_vec4(call.params.gravity), correction) / inv_mass;
}

// Volume energy that the corrections add to the tetrahedra around one node; a tetrahedron of several
// corrected nodes counts in equal parts.
double tet_correction_work(const AdvanceCall& call, const ContactNodeSet& nodes, const Particles& particles, const HalfStepBack& at,
                           uint32_t v) {
    const AdvanceInputs& in = call.inputs;
    const uint32_t body = at.body.body;
    if (!has_tets(in.other.solids, in.bodies, body)) return 0;
    const TetStep tets = bind_tets(*in.other.solids, in.bodies, particles, body, in.other.torn_springs);
    const SolidModuli moduli = solid_moduli(in.bodies, body);
    const unsigned* corner[4] = {tets.corner0, tets.corner1, tets.corner2, tets.corner3};
    const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
    double work = 0;
    for (uint32_t c = tets.slot_column[slice]; c < tets.slot_column[slice + 1]; ++c) {
        const uint32_t slot = tets.slot[c * kSliceWidth + lane];
        if (slot == 4 * tets.tetrahedra) continue;
        const uint32_t t = slot % tets.tetrahedra;
        if (tets.rest[t] == 0) continue;  // torn
        std::array<Vec3d, 4> from, to;
        int corrected = 0;
        for (int k = 0; k < 4; ++k) {
            const Vec4d correction = correction_of(nodes, at.body.particles.first + corner[k][t]);
            from[k] = to_vec3(at.offset(corner[k][t], correction));
            to[k] = from[k] + to_vec3(correction);
            corrected += norm2(correction) > 0;
        }
        const double factor = tets.factor ? double{tets.factor[t]} : 1.0;
        work += factor * (tet_energy(moduli, tets, t, to) - tet_energy(moduli, tets, t, from)) / std::max(corrected, 1);
    }
    return work;
}

// Accounts for a call's last corrections from the springs: the next forces do not exist yet.
void account_last_corrections(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result) {
    const uint32_t count = uint32_t(island.nodes.node.size());
    island.nodes.node_sums.assign(chunk_count(count, kNodesPerChunk), {});
    parallel_for(count, kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        double& work = island.nodes.node_sums[begin / kNodesPerChunk].work[0];
        for (uint32_t n = begin; n < end; ++n) {
            const ContactNode node = island.nodes.node[n];
            if (!island.nodes.change[n].corrected || node.particle == kNone) continue;
            const AdvanceBody& body = island.body[node.owner];
            const HalfStepBack at{particles, body, call.dt};
            const uint32_t v = node.particle - body.particles.first;
            work += node_correction_work(call, island.nodes, at, v, island.nodes.change[n].change, node.particle_inv_mass) +
                    tet_correction_work(call, island.nodes, particles, at, v);
        }
    });
    for (const NodeSums& sums : island.nodes.node_sums) result.work_push += sums.work[0];
}

// Limits the moves to `most` and applies them. Accounts for them as rounded to float.
void make_moves(double most, AdvanceIsland& island) {
    const auto make_move = [&](uint32_t n) {
        if (is_free(island, n)) return;
        const ContactNodeChange change = island.nodes.change[n];
        const ContactNode node = island.nodes.node[n];
        float* offset = nullptr;
        Vec4d origin = node.position, before = {};
        if (node.particle != kNone) {
            const AdvanceBody& body = island.body[node.owner];
            offset = &body.next[node.particle - body.particles.first].x;
            origin = body.origin;
            before = float_vec4(_mm_load_ps(offset));
        }
        if (!change.conflicting) change.change = node.after - (origin + before);
        const double size2 = norm2(change.change);
        if (!(size2 > 0)) return;
        if (size2 > most * most) change.change *= most / std::sqrt(size2);
        if (offset != nullptr) {
            move_particle(island.body[node.owner], node, change.change);
            change.change = float_vec4(_mm_load_ps(offset)) - before;
            change.corrected = island.body[node.owner].implicit_slot == kNone;  // others: account_implicit_corrections
        } else {
            node.position = node.after = node.position + change.change;
            island.rigid[node.owner].pose[1].shift = node.position;
        }
    };
    parallel_for(uint32_t(island.nodes.node.size()), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t n = begin; n < end; ++n) make_move(n);
    });
}

// Whether a node of a group may have moved since a sweep. May read results of other graph colours.
bool has_moved(const ContactSolver& solver, const ConstraintGroup& group, uint8_t since) {
    return std::any_of(solver.group.begin(), solver.group.begin() + solver.colour[4], [&](const ConstraintGroup& other) {
        return other.slabs.first < group.slabs.end() && group.slabs.first < other.slabs.end() && other.corrected_in >= since;
    });
}

// A free body's constraint that is deeper than corrections may move it in a substep leaves the rest for later ones. If each moved
// it by all that is allowed, many would turn it to and fro instead of lifting it.
void allow_overlaps(double most, const AdvanceIsland& island, const ConstraintGroup& group, ContactSolver& solver) {
    Vec4d normal;
    for (const uint32_t i : group.active) {
        PreparedConstraint& constraint = solver.prepared[i];
        constraint.allowed_overlap = 0;
        const auto is_held = [&](uint32_t free) { return free != kNone && island.free[free].held; };
        if (!constraint.turns() || std::ranges::any_of(constraint.angular.free, is_held)) continue;
        constraint.allowed_overlap = std::max(0.0, -separation_after(island, constraint, normal) - most);
    }
}

// One sweep over a group. Nodes pressed from opposite sides move after the group's sweep; in the first sweep,
// after all groups. Returns whether any constraint was corrected.
bool correct_group(const AdvanceCall& call, const ContactConstraints& constraints, const CorrectionSweep& sweep, ContactSolver& solver,
                   AdvanceIsland& island, ConstraintGroup& group) {
    if (!has_moved(solver, group, sweep.since)) return false;
    Vec4d normal;
    bool corrected = false;
    for (const uint32_t i : group.active) {
        const PreparedConstraint& constraint = solver.prepared[i];
        if (!has_moved_node(island.nodes, constraint, sweep.since)) continue;
        if (!(constraint.effective_mass > 0) || (sweep.stamp > 1 && constraint.turns()) || is_tangled(island.nodes, constraint)) continue;
        double overlap = -separation_after(island, constraint, normal);
        if (constraint.turns()) overlap -= constraint.allowed_overlap;
        if (!(overlap > sweep.least) || (sweep.stamp > 1 && overlap > sweep.most)) continue;
        const double share = has_held_side(island, constraint) ? sweep.held : 1;
        add_correction(call, constraints, constraint, std::min(share * overlap, sweep.most) * normal, sweep.stamp, island);
        corrected = true;
    }
    corrected = correct_wide_constraints(call, constraints, sweep, group, solver, island.nodes) || corrected;
    if (corrected) group.corrected_in = sweep.stamp;
    if (sweep.stamp > 1) meet_midway(solver, group, sweep.stamp, island.nodes);
    return corrected;
}

bool any_corrected(const ContactSolver& solver, uint8_t stamp) {
    return std::any_of(solver.group.begin(), solver.group.begin() + solver.colour[4],
                       [&](const ConstraintGroup& group) { return group.corrected_in == stamp; });
}

// Whether one correction may undo another, so that more sweeps follow: if bodies share corrections by mass.
// (With fixed shares one sweep suffices, and under a pressing tool more made tissue chatter.)
bool may_undo(const AdvanceCall& call, const AdvanceIsland& island) {
    const auto is_led = [&](const AdvanceRigid& rigid) {
        return rigid.node != kNone && (rigid.free == kNone || island.free[rigid.free].held);
    };
    return call.params.contact.share == ResponseShare::kMass && std::none_of(island.rigid.begin(), island.rigid.end(), is_led);
}

// One sweep over all groups; then each group's remaining sweeps in a row, while it is in the cache; then
// up to 15 x `iterations` sweeps over all groups while an overlap exceeds the tolerance. Returns whether any
// constraint was corrected.
bool correct_groups(const AdvanceCall& call, const ContactConstraints& constraints, double most, double held, ContactSolver& solver,
                    AdvanceIsland& island) {
    constexpr uint32_t kLastStamp = 254;
    const double tolerance = std::max(kRestingOverlap, call.params.contact.tolerance);
    const uint8_t sweeps = static_cast<uint8_t>(std::min(call.params.contact.iterations, kLastStamp));
    const uint8_t last = static_cast<uint8_t>(std::min(16u * sweeps, kLastStamp));
    island.nodes.moved_in.assign(island.nodes.node.size(), 0);
    find_tangled_nodes(solver, island);
    for_each_group(solver, [&](ConstraintGroup& group) {
        group.corrected_in = 0;
        forget_displacements(solver, group, island.nodes);
    });
    for_each_group(solver, [&](const ConstraintGroup& group) { allow_overlaps(most, island, group, solver); });
    for_each_group(solver, [&](ConstraintGroup& group) {
        correct_group(call, constraints, {kRestingOverlap, most, held, 1, 0}, solver, island, group);
    });
    if (!any_corrected(solver, 1)) return false;
    for_each_group(solver, [&](const ConstraintGroup& group) { meet_midway(solver, group, 1, island.nodes); });
    if (sweeps == 1 || !may_undo(call, island)) return true;
    for_each_group(solver, [&](const ConstraintGroup& group) { keep_midway(solver, group, island.nodes); });
    for_each_group(solver, [&](ConstraintGroup& group) {
        uint8_t stamp = 1;
        while (++stamp <= sweeps && correct_group(call, constraints, {kRestingOverlap, most, held, stamp, static_cast<uint8_t>(stamp - 1)},
                                                  solver, island, group)) {
        }
    });
    uint8_t since = 2;
    for (uint8_t stamp = sweeps + 1; stamp <= last; since = stamp++) {
        for_each_group(solver, [&](ConstraintGroup& group) {
            correct_group(call, constraints, {tolerance, most, held, stamp, since}, solver, island, group);
        });
        if (!any_corrected(solver, stamp)) break;
    }
    return true;
}

}  // namespace

double share_of_point(const AdvanceCall& call, const ContactConstraints& constraints, uint32_t constraint) {
    const Bodies& bodies = call.inputs.bodies;
    const uint32_t point = constraints.body[constraint], plane = constraints.other[constraint];
    if (!is_deformable(bodies, point)) return 0;
    if (!is_deformable(bodies, plane)) return 1;
    if (call.params.contact.share == ResponseShare::kHalf) return 0.5;
    const double a = bodies.spring_stiffness[point], b = bodies.spring_stiffness[plane];
    return b / (a + b);
}

void correct_positions(const AdvanceCall& call, ContactSolver& solver, AdvanceIsland& island, const AdvanceState& state,
                       AdvanceResult& result) {
    const uint32_t substep = call.substep;
    const AdvanceParams& params = call.params;
    const uint64_t begin = params.tick * params.substeps + uint64_t{params.ticks} * substep, end = begin + params.ticks;
    const auto started = [&](uint64_t time) { return (time + params.substeps - 1) / params.substeps; };
    const uint64_t ms = started(end) - started(begin);  // starting in this substep
    if (ms > 0) {
        const double most = params.contact.push_speed * 1e-3 * static_cast<double>(ms);
        const double held = static_cast<double>(ms) / params.ticks;
        const bool any = correct_groups(call, state.constraints, most, held, solver, island);
        if (any) make_moves(most, island);
        if (any && any_angular(solver)) finish_free_corrections(call, most, island, result);
    }
    if (substep + 1 < params.substeps) return;
    if (params.account_energy) account_last_corrections(call, state.particles, island, result);
    for_each_group(solver, [&](ConstraintGroup& group) {
        Vec4d normal;
        group.deepest = deepest_in_wide(island.nodes, group, solver);
        for (const uint32_t i : group.active)
            group.deepest = std::max(group.deepest, -separation_after(island, solver.prepared[i], normal));
    });
    double deepest = 0;
    for (uint32_t g = 0; g < solver.colour[4]; ++g) deepest = std::max(deepest, solver.group[g].deepest);
    result.deepest_residual = deepest;
    for (uint32_t n = 0; n < island.nodes.node.size(); ++n) {
        result.opposing_planes += (island.nodes.change.conflicting[n] || island.nodes.tangled[n]) && island.nodes.node.particle[n] != kNone;
    }
}

}  // namespace trocar
