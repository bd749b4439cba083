#include "systems/advance_contact.hpp"

#include <algorithm>
#include <cmath>

#include "engine/check.hpp"
#include "engine/surfaces.hpp"
#include "systems/advance_blocks.hpp"
#include "systems/advance_constants.hpp"
#include "systems/advance_free.hpp"
#include "systems/advance_groups.hpp"
#include "systems/advance_hold.hpp"
#include "systems/advance_rigid.hpp"
#include "systems/advance_settle.hpp"
namespace trocar {
namespace {

constexpr uint32_t kRowsPerChunk = 2048;

uint32_t node_slot(const AdvanceIsland& island, uint32_t owner, uint32_t vertex) {
    return island.nodes.node_of_particle[island.body[owner].particles.first + vertex];
}

// Node of a vertex of a deformable body, or the new skin point of one that rides.
uint32_t vertex_slot(uint32_t owner, uint32_t vertex, AdvanceIsland& island) {
    if (!island.body[owner].skin_node) return node_slot(island, owner, vertex);
    ContactSkinPoint point;
    for (int k = 0; k < 4; ++k) point.node[k] = node_slot(island, owner, island.body[owner].skin_node[vertex][k]);
    point.weight = island.body[owner].skin_weight[vertex];
    island.nodes.skin_point.push_back(point);
    return kSkinPoint | static_cast<uint32_t>(island.nodes.skin_point.size() - 1);
}

Vec4d rest_position(const Meshes& meshes, uint32_t prototype, uint32_t vertex) {
    return to_vec4(meshes.position[meshes.info[prototype].vertices.first + vertex]);
}

// Numbers the rigid sides and the nodes of all constraints: nodes in the order of bodies and particles, so that loops over all nodes
// run through memory once, and constraints find theirs close together.
void number_nodes(const AdvanceCall& call, const ContactSorting& sorting, std::span<const uint32_t> island_rows, AdvanceIsland& island,
                  const AdvanceState& state) {
    const ContactRows& rows = state.rows;
    constexpr uint32_t kAsked = kNone - 1;
    for (const uint32_t row : sorting.dealt)
        for (const uint32_t body : {rows.body[row], rows.other[row]})
            if (!is_deformable(call.inputs.bodies, body)) rigid_slot(call, body, island, state);
    // several threads may ask for one node
    const auto put = [](auto& place, auto value) {
        const std::atomic_ref at(place);
        if (at.load(std::memory_order_relaxed) != value) at.store(value, std::memory_order_relaxed);
    };
    const auto ask = [&](uint32_t body, std::initializer_list<uint32_t> vertices) {
        if (!is_deformable(call.inputs.bodies, body)) return;
        TROCAR_ASSERT(island.slot_of_body[body] != kNone);
        AdvanceBody& b = island.body[island.slot_of_body[body]];
        put(b.touched, true);
        for (const uint32_t v : vertices) {
            if (v == kNone) continue;
            if (!b.skin_node)
                put(island.nodes.node_of_particle[b.particles.first + v], kAsked);
            else
                for (const uint32_t node : b.skin_node[v]) put(island.nodes.node_of_particle[b.particles.first + node], kAsked);
        }
    };
    parallel_for(static_cast<uint32_t>(island_rows.size()), kRowsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const uint32_t row = island_rows[i];
            const Triangle& t = rows.triangle[row];
            ask(rows.body[row], {rows.vertex[row][0], rows.vertex[row][1], rows.third[row]});
            ask(rows.other[row], {t[0], t[1], t[2]});
        }
    });
    const size_t first = island.nodes.node.size();
    for (uint32_t owner = 0; owner < island.body.size(); ++owner) {
        const AdvanceBody& b = island.body[owner];
        if (!b.touched) continue;
        for (uint32_t particle = b.particles.first; particle < b.particles.end(); ++particle) {
            if (island.nodes.node_of_particle[particle] != kAsked) continue;
            island.nodes.node_of_particle[particle] = static_cast<uint32_t>(island.nodes.node.particle.size());
            island.nodes.node.particle.push_back(particle);
            island.nodes.node.owner.push_back(owner);
        }
    }
    const size_t nodes = island.nodes.node.particle.size();
    island.nodes.node.resize(nodes);
    island.nodes.change.resize(nodes);
    parallel_for(static_cast<uint32_t>(island.nodes.node.size() - first), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (size_t n = first + begin; n < first + end; ++n) {
            const ContactNode node = island.nodes.node[n];
            const AdvanceBody& b = island.body[node.owner];
            node.particle_inv_mass = b.now[node.particle - b.particles.first].w;
            node.inv_mass = b.impulse_left * node.particle_inv_mass;
        }
    });
}

// The two points of a constraint at the start of a substep.
struct RowState {
    Vec4d point, plane, normal;  // m
    double gap;                  // m
};

RowState find_gap(const AdvanceIsland& island, const PreparedConstraint& c) {
    RowState r;
    if (c.rigid_a == kNone) {
        r.point = field_at(island.nodes, c.node_a[0], &ContactNodes::place);
        if (c.weight_a[1] != 0 || c.weight_a[2] != 0) {
            r.point = c.weight_a[0] * r.point + c.weight_a[1] * field_at(island.nodes, c.node_a[1], &ContactNodes::place);
        }
        if (c.weight_a[2] != 0) r.point += c.weight_a[2] * field_at(island.nodes, c.node_a[2], &ContactNodes::place);
    } else {
        r.point = island.rigid[c.rigid_a].place[0](c.point_a);
    }
    if (c.rigid_b == kNone) {
        const auto place = [&](int k) { return field_at(island.nodes, c.node_b[k], &ContactNodes::place); };
        r.plane = c.weight_b[0] * place(0) + c.weight_b[1] * place(1) + c.weight_b[2] * place(2);
        r.normal = c.plane;
    } else {
        const RigidMap& place = island.rigid[c.rigid_b].place[0];
        r.plane = place(c.point_b);
        r.normal = place.turn(c.plane);
    }
    r.gap = dot(r.normal, r.point - r.plane) - c.offset;
    return r;
}

// Velocity of a point of a rigid body, m/s.
Vec4d rigid_velocity(const AdvanceIsland& island, uint32_t slot, Vec4d point) {
    const AdvanceRigid& rigid = island.rigid[slot];
    const Vec4d velocity = rigid.velocity(point);
    return rigid.node == kNone ? velocity : velocity + island.nodes.node[rigid.node].velocity;
}

// Velocity of the point relative to the plane point, m/s.
Vec4d relative_velocity(const AdvanceIsland& island, const PreparedConstraint& c) {
    Vec4d v;
    if (c.rigid_a == kNone) {
        v = c.weight_a[0] * field_at(island.nodes, c.node_a[0], &ContactNodes::velocity);
        if (c.weight_a[1] != 0) v += c.weight_a[1] * field_at(island.nodes, c.node_a[1], &ContactNodes::velocity);
        if (c.weight_a[2] != 0) v += c.weight_a[2] * field_at(island.nodes, c.node_a[2], &ContactNodes::velocity);
    } else {
        v = rigid_velocity(island, c.rigid_a, c.point_a);
    }
    if (c.rigid_b != kNone) return v - rigid_velocity(island, c.rigid_b, c.point_b);
    for (int k = 0; k < 3; ++k) v -= c.weight_b[k] * field_at(island.nodes, c.node_b[k], &ContactNodes::velocity);
    return v;
}

// No point of a rigid body of the island is faster than this, m/s, its node aside.
double fastest_rigid(const AdvanceCall& call, const AdvanceIsland& island) {
    double fastest = 0;
    for (const AdvanceRigid& rigid : island.rigid) {
        double spin2 = 0;
        for (const Vec4d& column : rigid.velocity.column) spin2 += norm2(column);
        const double radius = call.inputs.meshes.info[call.inputs.bodies.mesh[rigid.body]].radius;
        fastest = std::max(fastest, std::sqrt(norm2(rigid.velocity.shift)) + std::sqrt(spin2) * radius);
    }
    return fastest;
}

// Foot of the point on the plane of the row's triangle, along the normal: barycentric weights. With them the two equal
// and opposite impulses lie on one line and angular momentum is kept exactly. Frame of the other body if it is rigid.
struct Foot {
    std::array<double, 3> weight;
    Vec4d point;       // m
    bool left_behind;  // more than one edge length beyond the triangle
};

Foot find_foot(Vec4d a, Vec4d b, Vec4d c, Vec4d point, Vec4d plane, Vec4d normal, const std::array<double, 3>& fixed) {
    const Vec4d u = b - a, v = c - a;
    const double edge2[3] = {norm2(c - b), norm2(v), norm2(u)};  // opposite corner k
    const double longest2 = std::max({edge2[0], edge2[1], edge2[2]});
    const Vec4d twice_area = cross(u, v);
    const double area2 = norm2(twice_area), along = dot(normal, twice_area);
    if (!(along > 0 && along * along > kLeastCosine * kLeastCosine * area2 && area2 > 1e-12 * longest2 * longest2)) {
        const Vec4d apart = point - plane, slide = apart - normal * dot(normal, apart);
        return {fixed, plane, norm2(slide) > longest2};
    }
    Foot foot;
    foot.point = point - normal * (dot(point - a, twice_area) / along);
    const Vec4d q = foot.point - a;
    const double per_area2 = 1 / area2;
    foot.weight[1] = dot(q, cross(v, twice_area)) * per_area2;
    foot.weight[2] = dot(q, cross(twice_area, u)) * per_area2;
    foot.weight[0] = 1 - foot.weight[1] - foot.weight[2];
    foot.left_behind = false;
    for (int k = 0; k < 3; ++k) {
        // distance beyond side k = -weight * height of the side
        const double w = foot.weight[k];
        foot.left_behind = foot.left_behind || (w < 0 && w * w * area2 > longest2 * edge2[k]);
    }
    return foot;
}

Foot find_foot(const AdvanceCall& call, const AdvanceIsland& island, const ContactRows& rows, const PreparedConstraint& c,
               const RowState& r) {
    if (c.rigid_b == kNone) {
        const auto place = [&](int k) { return field_at(island.nodes, c.node_b[k], &ContactNodes::place); };
        return find_foot(place(0), place(1), place(2), r.point, r.plane, r.normal, c.weight_b);
    }
    const AdvanceRigid& rigid = island.rigid[c.rigid_b];
    const Meshes& meshes = call.inputs.meshes;
    const uint32_t mesh = call.inputs.bodies.mesh[rigid.body];
    const Triangle& t = rows.triangle[c.row];
    const Vec4d point = rigid.place[0].turn_back(r.point - rigid.place[0].shift);
    return find_foot(rest_position(meshes, mesh, t[0]), rest_position(meshes, mesh, t[1]), rest_position(meshes, mesh, t[2]), point,
                     c.point_b, c.plane, c.weight_b);
}

void add_node(PreparedConstraint& c, uint32_t node, double weight) {
    if (weight == 0) return;
    // an edge point whose two ends are one vertex is one node
    for (uint32_t k = 0; k < c.nodes; ++k) {
        if (c.node[k] == node) {
            c.weight[k] += weight;
            return;
        }
    }
    c.node[c.nodes] = node;
    c.weight[c.nodes++] = weight;
}
void add_point(const ContactNodeSet& nodes, uint32_t point, double weight, PreparedConstraint& c) {
    visit_nodes(nodes, point, [&](uint32_t node, double share) { add_node(c, node, share * weight); });
}

// Counts a constraint for its nodes, and marks those that are pressed from both sides.
void note_rows(const PreparedConstraint& c, ContactNodeSet& nodes) {
    for (uint32_t k = 0; k < c.nodes; ++k) {
        const ContactNodeChange change = nodes.change[c.node[k]];
        // beyond a side of the triangle the opposite corner's weight has the other sign: the constraint pulls that corner, not presses it
        const bool of_point = k < c.point_nodes, pressed = (c.weight[k] > 0) == of_point;
        const Vec4d way = of_point ? c.normal : -c.normal;
        if (change.rows++ == 0) {
            change.way = way;
        } else if (pressed && !change.opposed && dot(change.way, way) < kOpposed) {
            change.opposed = true;
        }
    }
}

bool has_free_side(const AdvanceIsland& island, const PreparedConstraint& c) {
    const auto is_free = [&](uint32_t rigid) { return rigid != kNone && island.rigid[rigid].free != kNone; };
    return is_free(c.rigid_a) || is_free(c.rigid_b);
}

bool is_bounced_away(const PreparedConstraint& c, double approach) { return c.restitution > 0 && approach > kLeastBounce; }

// Half of what the kick of this substep added to the velocity along the normal, m/s: velocities are half a step ahead of places.
double half_kick(const PreparedConstraint& c, ContactNodeSet& nodes) {
    Vec4d kick = {};
    for (uint32_t k = 0; k < c.nodes; ++k) {
        const auto change = nodes.change[c.node[k]];
        kick += c.weight[k] * (change.kicked - change.before);
    }
    return 0.5 * dot(c.normal, kick);
}

// The least velocity along the normal that a constraint asks for after the substep, m/s; all nodes are known. Bodies that bounce: minus
// the restitution times that before, of those too that move apart (Moreau 1988, "Unilateral contact and dry friction in finite
// freedom dynamics"): with one restitution for all no impact makes energy then, however many constraints it has. Both at the time of
// the positions: with the kick as it is a ball would rise by (1 + e) g dt / (e v) too high.
double least_velocity(const AdvanceCall& call, const PreparedConstraint& c, double gap, double approach, ContactNodeSet& nodes) {
    const double closed = -std::max(gap, 0.0) / call.dt;
    const bool hits = c.restitution > 0 && approach < -kLeastBounce && gap + approach * call.dt < 0;
    if (!hits && !is_bounced_away(c, approach)) return closed;
    const double ahead = half_kick(c, nodes), back = ahead - c.restitution * (approach - ahead);
    return hits ? std::max(back, 0.0) : std::min(closed, back);
}

// Where position corrections act and separations are measured: at the foot, or, if that is beside its triangle, at the point of the
// triangle that its clamped weights name, so that no corner is pulled where others are pushed. Measured anywhere else, two constraints of
// a vertex could undo more than each other's corrections.
void set_push_weights(const ContactNodeSet& nodes, const RowState& r, const Foot& foot, PreparedConstraint& c) {
    std::copy_n(c.weight.begin(), c.nodes, c.push_weight.begin());
    c.push_gap = 0;
    if (c.rigid_b != kNone) return;
    std::array<double, 3> weight = foot.weight;
    const bool beside = *std::min_element(weight.begin(), weight.end()) < 0;
    if (beside) {
        for (double& w : weight) w = std::max(w, 0.0);
        const double sum = weight[0] + weight[1] + weight[2];
        for (double& w : weight) w /= sum;
    }
    Vec4d at = {};
    for (int k = 0; k < 3; ++k) at += weight[k] * field_at(nodes, c.node_b[k], &ContactNodes::place);
    c.push_gap = dot(r.normal, at - r.plane);
    if (!beside) return;
    const auto first = c.node.begin() + c.point_nodes, last = c.node.begin() + c.nodes;
    std::fill(c.push_weight.begin() + c.point_nodes, c.push_weight.begin() + c.nodes, 0.0);
    for (int k = 0; k < 3; ++k)
        visit_nodes(nodes, c.node_b[k], [&](uint32_t node, double share) {
            const auto found = std::find(first, last, node);
            if (found != last) c.push_weight[found - c.node.begin()] -= share * weight[k];
        });
}

// The side of a rigid body in a constraint: its node, if it has one, and what its motion adds besides. sign: + of the point.
void add_rigid_side(const AdvanceIsland& island, uint32_t rigid_row, Vec4d at, double sign, PreparedConstraint& c) {
    const AdvanceRigid& rigid = island.rigid[rigid_row];
    if (rigid.free == kNone)
        c.rigid_velocity += sign * rigid.velocity(at);
    else if (rigid.jaw != kNone)
        c.rigid_velocity += sign * rigid.grip_velocity(at);
    if (rigid.node != kNone) add_node(c, rigid.node, sign);
}

// Sets what a constraint needs for the substep. approach: m/s along the normal, before any impulse of the substep.
void set_substep(const AdvanceCall& call, const RowState& r, const Foot& foot, double approach, AdvanceIsland& island,
                 PreparedConstraint& c) {
    c.friction = c.friction_coefficient;
    c.normal = r.normal;
    c.rigid_velocity = c.friction_impulse = Vec4d{};
    c.normal_impulse = 0;
    c.nodes = 0;
    c.angular.free = {kNone, kNone};
    if (c.rigid_a == kNone) {
        for (int i = 0; i < 3; ++i) add_point(island.nodes, c.node_a[i], c.weight_a[i], c);
    } else {
        add_rigid_side(island, c.rigid_a, c.point_a, 1, c);
    }
    c.point_nodes = c.nodes;
    if (c.rigid_b == kNone) {
        for (int k = 0; k < 3; ++k) add_point(island.nodes, c.node_b[k], -foot.weight[k], c);
    } else {
        add_rigid_side(island, c.rigid_b, foot.point, -1, c);
    }
    double sum = 0;
    for (uint32_t k = 0; k < c.nodes; ++k) sum += c.weight[k] * c.weight[k] * island.nodes.node[c.node[k]].inv_mass;
    c.inv_sum = sum > 0 ? 1 / sum : 0;
    set_push_weights(island.nodes, r, foot, c);
    c.least_velocity = least_velocity(call, c, r.gap, approach, island.nodes);
    if (island.free.empty() || !has_free_side(island, c)) return;
    // a free body rests anywhere in a thin band: gaps of a micrometre among its constraints would let it rock at 1 mm/s
    if (r.gap < kRestingGap && !is_bounced_away(c, approach)) c.least_velocity = std::max(c.least_velocity, 0.0);
    // both impulses act at one point, so that angular momentum is kept: the foot, which a deformable plane rides on
    add_turning_sides(island, c.rigid_b == kNone ? foot.point : r.point, c);
}

// Sets a constraint to act in this substep; false if its point has left its triangle behind. What the implicit step gave counts as given.
bool activate(const AdvanceCall& call, const ContactRows& rows, const RowState& r, double approach, AdvanceIsland& island,
              PreparedConstraint& c) {
    const Foot foot = find_foot(call, island, rows, c, r);
    c.ended = foot.left_behind;
    if (c.ended) return false;
    set_substep(call, r, foot, approach, island, c);
    c.normal_impulse = dot(c.held, c.normal);
    if (c.normal_impulse > 0) {
        c.friction_impulse = c.held - c.normal_impulse * c.normal;
        c.friction = std::max(c.friction, std::sqrt(norm2(c.friction_impulse)) / c.normal_impulse);
    }
    note_rows(c, island.nodes);
    return true;
}

// Activates a constraint that is crossed, or would be at the end of the substep. reach: m, see apply_impulses.
bool acts(const AdvanceCall& call, const ContactRows& rows, double reach, AdvanceIsland& island, PreparedConstraint& c) {
    if (c.ended) return false;
    const RowState r = find_gap(island, c);
    if (!(r.gap < reach)) return false;
    const Vec4d velocity = relative_velocity(island, c);
    const double gap_after = r.gap + std::min(dot(r.normal, velocity), 0.0) * call.dt;
    // a point that is not finite belongs to a body about to be restored: it must not reach its neighbours
    if (!std::isfinite(gap_after + norm2(velocity))) return false;
    // a free body's constraint may be crossed because of an impulse at another of its constraints
    if (!(gap_after < 0) && (island.free.empty() || !has_free_side(island, c))) return false;
    return activate(call, rows, r, dot(r.normal, velocity), island, c);
}

void find_active_rows(const AdvanceCall& call, const ContactRows& rows, double reach, ContactSolver& solver, AdvanceIsland& island,
                      RowGroup& group) {
    group.active.clear();
    group.turning_rows = 0;
    for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
        PreparedConstraint& c = solver.prepared[i];
        if (!acts(call, rows, reach, island, c)) {
            c.warm = Vec4d{};
            continue;
        }
        group.active.push_back(i);
        group.turning_rows += c.turns();
    }
}

// Gives one constraint the impulse that its nodes' velocities ask for now: see PreparedConstraint. kNodes is how many it has, 0 for
// any number.
template <uint32_t kNodes>
void solve_nodes(ContactNodeSet& nodes, PreparedConstraint& c) {
    const uint32_t count = kNodes > 0 ? kNodes : c.nodes;
    const auto part = [&](uint32_t k) { return c.weight[k] * nodes.node[c.node[k]].velocity; };
    Vec4d velocity = c.rigid_velocity;
    if constexpr (kNodes == 4) {
        velocity += (part(0) + part(1)) + (part(2) + part(3));
    } else {
        for (uint32_t k = 0; k < count; ++k) velocity += part(k);
    }
    const double approach = dot(c.normal, velocity), normal_impulse = corrected_normal_impulse(c, approach);
    Vec4d impulse = (normal_impulse - c.normal_impulse) * c.normal;
    c.normal_impulse = normal_impulse;
    if (c.friction > 0) {
        const Vec4d sliding = velocity - approach * c.normal;
        const Vec4d friction = limit_friction(c.friction_impulse - sliding * c.inv_sum, c.friction * normal_impulse);
        impulse += friction - c.friction_impulse;
        c.friction_impulse = friction;
    }
    for (uint32_t k = 0; k < count; ++k) {
        const ContactNode node = nodes.node[c.node[k]];
        node.velocity += (c.weight[k] * node.inv_mass) * impulse;
    }
}

// Warm start: every constraint starts from its impulse of the substep before. What rests is found at once, and one sweep a substep is
// enough for what changes slowly.
void start_rows(ContactSolver& solver, AdvanceIsland& island, RowGroup& group) {
    start_blocks(group, solver, island.nodes);
    for (const uint32_t i : group.active) {
        PreparedConstraint& c = solver.prepared[i];
        if (c.normal_impulse > 0) continue;  // the implicit step gave it already
        c.normal_impulse = std::max(0.0, dot(c.warm, c.normal));
        if (c.normal_impulse == 0) continue;
        c.friction_impulse = c.warm - dot(c.warm, c.normal) * c.normal;
        give_impulse(c, c.normal_impulse * c.normal + c.friction_impulse, island);
    }
}

bool any_bounces(const ContactSolver& solver) {
    const auto bounces = [&](uint32_t i) { return solver.prepared[i].least_velocity > 0; };
    return std::ranges::any_of(std::span(solver.group).first(solver.phase[4]),
                               [&](const RowGroup& g) { return std::ranges::any_of(g.active, bounces); });
}

Vec4d particle_velocity(const Particles& p, uint32_t i) { return make_vec4(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]); }

// Runs visit(begin, end, sums) for chunks of nodes.
template <typename Visit>
void for_node_chunks(ContactNodeSet& nodes, const Visit& visit) {
    const uint32_t count = uint32_t(nodes.node.size());
    nodes.node_sums.assign(chunk_count(count, kNodesPerChunk), {});
    parallel_for(count, kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        NodeSums sums;
        visit(begin, end, sums);
        nodes.node_sums[begin / kNodesPerChunk] = sums;
    });
}

// Writes what the rows did to the particles: velocity, and the drift that belongs to it. Books the work: a leapfrog kick
// does work at the mean of the velocities before and after it, all its impulses together; what damping took is at
// that mean too, where the kernel's books had the velocity before the rows.
void scatter_velocities(const AdvanceCall& call, AdvanceIsland& island, Particles& particles, AdvanceResult& result) {
    Particles& p = particles;
    const auto scatter = [&](uint32_t n, NodeSums& sums) {
        const ContactNode node = island.nodes.node[n];
        const ContactNodeChange change = island.nodes.change[n];
        const __m256d same = _mm256_cmp_pd((__m256d)node.velocity, (__m256d)change.kicked, _CMP_EQ_UQ);
        if (_mm256_movemask_pd(same) == 15 || node.particle == kNone || node.inv_mass == 0) return;
        const __m128 velocity = _mm256_cvtpd_ps((__m256d)node.velocity);
        p.velocity_x[node.particle] = velocity[0];
        p.velocity_y[node.particle] = velocity[1];
        p.velocity_z[node.particle] = velocity[2];
        node.velocity = float_vec4(velocity);
        const Vec4d kick = node.velocity - change.kicked;
        move_particle(island.body[node.owner], node, call.dt * kick);
        if (island.body[node.owner].measured()) return;
        const double left = island.body[node.owner].impulse_left;
        const Vec4d half = (0.5 / node.inv_mass) * kick;
        sums.work += half * (change.before + node.velocity);
        sums.damped += left * half * (change.damped - change.before) - (1 - left) * half * (change.before + node.velocity);
    };
    for_node_chunks(island.nodes, [&](uint32_t begin, uint32_t end, NodeSums& sums) {
        for (uint32_t n = begin; n < end; ++n) scatter(n, sums);
    });
    Vec4d work = {}, damped = {};
    for (const NodeSums& sums : island.nodes.node_sums) work += sums.work, damped += sums.damped;
    if (call.params.account_energy) {
        result.work_contact += work[0] + work[1] + work[2];
        result.work_damping += damped[0] + damped[1] + damped[2];
    }
    if (call.params.account_energy && !island.free.empty()) result.work_contact += contact_work_on_free(island);
}

// The part of the constraints' work that hands and scripted bodies did.
void book_hands(const ContactSolver& solver, const AdvanceIsland& island, AdvanceResult& result) {
    double hand = 0;
    const auto is_held = [&](uint32_t rigid) {
        return rigid != kNone && island.rigid[rigid].free != kNone && island.free[island.rigid[rigid].free].held;
    };
    const auto is_driven = [&](uint32_t rigid) { return rigid != kNone && (island.rigid[rigid].free == kNone || is_held(rigid)); };
    const auto book = [&](const PreparedConstraint& c) {
        if (is_driven(c.rigid_a) == is_driven(c.rigid_b)) return;
        Vec4d surface = c.rigid_velocity;
        for (uint32_t k = 0; k < c.nodes; ++k) {
            const uint32_t n = c.node[k];
            if (island.nodes.node[n].particle != kNone ||
                (island.rigid[island.nodes.node[n].owner].free != kNone && !is_held(island.nodes.node[n].owner)))
                continue;
            surface += c.weight[k] * 0.5 * (island.nodes.change[n].before + island.nodes.node[n].velocity);
        }
        for (int side = 0; side < 2; ++side) {
            if (!is_held(side == 0 ? c.rigid_a : c.rigid_b)) continue;
            const AdvanceFree& f = island.free[c.angular.free[side]];
            surface += (side == 0 ? 0.5 : -0.5) * cross(f.spin_before + f.spin, c.angular.arm[side]);
        }
        hand -= dot(surface, c.normal_impulse * c.normal + c.friction_impulse);
    };
    for (uint32_t g = 0; g < solver.phase[4]; ++g)
        for (const uint32_t i : solver.group[g].active) book(solver.prepared[i]);
    result.work_hand += hand;
    result.work_contact -= hand;
}

// What a constraint's impulse does to a tool, if one of its rigid sides is a tool or a jaw of one.
void add_tool_impulse(const AdvanceCall& call, const AdvanceIsland& island, const PreparedConstraint& c, int side, Vec4d impulse,
                      std::span<ToolState> tools) {
    const uint32_t rigid = side == 0 ? c.rigid_a : c.rigid_b;
    if (rigid == kNone) return;
    const AdvanceRigid& hit = island.rigid[island.rigid[rigid].holder == kNone ? rigid : island.rigid[rigid].holder];
    if (hit.tool == kNone) return;
    ToolState& tool = tools[hit.tool];
    tool.contact_impulse += to_vec3(impulse);
    if (!c.turns()) return;
    const Vec4d arm = c.angular.arm[side];
    tool.contact_moment += to_vec3(cross(arm, impulse));
    add_grip_moment(call, island, rigid, island.nodes.node[hit.node].place + arm, impulse, tools);
}

void add_impulses(const AdvanceCall& call, const AdvanceIsland& island, const RowGroup& group, ContactSolver& solver,
                  std::span<ToolState> tools) {
    add_block_impulses(group, solver);
    for (const uint32_t i : group.active) {
        PreparedConstraint& c = solver.prepared[i];
        const Vec4d impulse = c.normal_impulse * c.normal + c.friction_impulse;
        c.impulse += impulse;
        if (!solver.bounces) c.warm = impulse;
        add_tool_impulse(call, island, c, 0, impulse, tools);
        add_tool_impulse(call, island, c, 1, -impulse, tools);
    }
}

// What all nodes of one owner need to know of it, read once.
struct KickOfBody {
    Vec4d origin, drag_velocity, drag_turn;
    double lost, kick_dt, kick_less;  // share of the velocity relative to the drag that damping takes, negative; s; s
    bool shape;

    explicit KickOfBody(const AdvanceBody& b)
        : origin(b.origin),
          drag_velocity(b.drag_velocity),
          drag_turn(b.drag_turn),
          lost(double(b.step.keep) - 1.0),
          kick_dt(b.step.kick_dt),
          kick_less(b.step.kick_less),
          shape(b.shape) {}
};

// What damping took from a node in the kick of this substep, and what everything else did. Returns the work that the
// forces did against the push of the substep before, J: energy does not depend on the way, and half the sum of the
// forces at the start of that substep and after the push is the force in the middle of the push, seen half a substep
// back (exact where forces are linear in place).
double note_kick(const KickOfBody& body, const ContactNode& node, const ContactNodeChange& change) {
    Vec4d drag = body.drag_velocity;
    if (body.shape) drag += cross(body.drag_turn, node.place - body.origin);
    const Vec4d lost = body.lost * (change.before - drag), before = change.acceleration;
    change.damped = change.before + lost;
    change.acceleration = (node.velocity - change.damped) / body.kick_dt;
    change.damped += body.kick_less * change.acceleration;
    return change.pushed ? dot(0.5 * (before + change.acceleration), change.change) / node.particle_inv_mass : 0;
}

// Nodes [begin, end), all of one owner, after kick and drift.
void gather_run(const AdvanceCall& call, const Particles& particles, size_t begin, size_t end, AdvanceIsland& island, NodeSums& sums) {
    const bool of_body = island.nodes.node.particle[begin] != kNone, books = call.params.account_energy, later = call.substep > 0;
    const AdvanceBody* const body = of_body ? &island.body[island.nodes.node.owner[begin]] : nullptr;
    const KickOfBody kick = of_body ? KickOfBody(*body) : KickOfBody(AdvanceBody{});
    const uint32_t first = of_body ? body->particles.first : 0;
    const Float4 *const now = of_body ? body->now : nullptr, *const next = of_body ? body->next : nullptr;
    for (size_t n = begin; n < end; ++n) {
        const ContactNode node = island.nodes.node[n];
        const ContactNodeChange change = island.nodes.change[n];
        if (of_body) {
            const uint32_t vertex = node.particle - first;
            if (later) change.before = node.velocity;
            node.place = kick.origin + float_vec4(_mm_load_ps(&now[vertex].x));
            node.after = kick.origin + float_vec4(_mm_load_ps(&next[vertex].x));
            node.velocity = particle_velocity(particles, node.particle);
            if (books) sums.work[0] += note_kick(kick, node, change);
        }
        change.kicked = node.velocity;
        change.change = Vec4d{};
        sums.fastest = greatest(node.velocity * node.velocity, sums.fastest);
        sums.total += node.velocity;
    }
    // apart: after a byte is written the compiler reads all pointers again
    std::fill(island.nodes.change.rows.begin() + begin, island.nodes.change.rows.begin() + end, 0);
    for (auto* flag : {&island.nodes.change.pushed, &island.nodes.change.opposed})
        std::fill(flag->begin() + begin, flag->begin() + end, uint8_t{0});
}

// Nodes after kick and drift; books the pushes of the substep before. Returns a bound of their velocities, m/s; infinite
// if one of them is not finite.
double gather_nodes(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result) {
    for_node_chunks(island.nodes, [&](uint32_t begin, uint32_t end, NodeSums& sums) {
        while (begin < end) {
            uint32_t last = begin + 1;
            const bool particle = island.nodes.node.particle[begin] != kNone;
            while (last < end && island.nodes.node.owner[last] == island.nodes.node.owner[begin] &&
                   (island.nodes.node.particle[last] != kNone) == particle)
                ++last;
            gather_run(call, particles, begin, last, island, sums);
            begin = last;
        }
    });
    Vec4d most = {}, total = {};
    double work = 0;
    for (const NodeSums& sums : island.nodes.node_sums) most = greatest(sums.fastest, most), total += sums.total, work += sums.work[0];
    if (std::isfinite(work)) result.work_push -= work;  // else a body about to be restored
    const bool finite = std::isfinite(total[0] + total[1] + total[2]);
    return finite ? std::sqrt(most[0] + most[1] + most[2]) : std::numeric_limits<double>::infinity();
}

}  // namespace

double solve_row(AdvanceIsland& island, PreparedConstraint& c) {
    if (c.turns()) return solve_turning_row(island, c);
    c.nodes == 4 ? solve_nodes<4>(island.nodes, c) : solve_nodes<0>(island.nodes, c);
    return 0;
}

void prepare_constraint(const AdvanceCall& call, const ContactSolver& solver, uint32_t row, AdvanceIsland& island,
                        const AdvanceState& state, PreparedConstraint& c) {
    const ContactRows& rows = state.rows;
    const Bodies& bodies = call.inputs.bodies;
    const Meshes& meshes = call.inputs.meshes;
    const uint32_t a = rows.body[row], b = rows.other[row];
    c.row = row;
    c.rigid_a = c.rigid_b = kNone;
    c.offset = c.restitution = 0;
    c.angular.free = {kNone, kNone};
    const bool in_face = rows.third[row] != kNone;
    c.weight_a = {1.0 - rows.along[row] - rows.across[row], rows.along[row], rows.across[row]};
    c.weight_b = {rows.weight[row][0], rows.weight[row][1], rows.weight[row][2]};
    c.plane = to_vec4(rows.normal[row]);
    c.impulse = c.held = Vec4d{};
    c.warm = solver.starts_warm ? start_impulse(call, state.rows, row) : Vec4d{};
    c.friction_coefficient = rows.friction[row];
    c.ended = std::isinf(rows.distance[row]);
    if (is_deformable(bodies, a)) {
        TROCAR_ASSERT(island.slot_of_body[a] != kNone);
        const auto& vertex = rows.vertex[row];
        c.node_a[0] = vertex_slot(island.slot_of_body[a], vertex[0], island);
        c.node_a[1] = vertex[1] == vertex[0] ? c.node_a[0] : vertex_slot(island.slot_of_body[a], vertex[1], island);
        c.node_a[2] = in_face ? vertex_slot(island.slot_of_body[a], rows.third[row], island) : c.node_a[0];
    } else {
        c.rigid_a = rigid_slot(call, a, island, state);
        c.point_a = c.weight_a[0] * rest_position(meshes, bodies.mesh[a], rows.vertex[row][0]) +
                    c.weight_a[1] * rest_position(meshes, bodies.mesh[a], rows.vertex[row][1]);
        if (in_face) c.point_a += c.weight_a[2] * rest_position(meshes, bodies.mesh[a], rows.third[row]);
    }
    if (is_deformable(bodies, b)) {
        TROCAR_ASSERT(island.slot_of_body[b] != kNone);
        for (int i = 0; i < 3; ++i) c.node_b[i] = vertex_slot(island.slot_of_body[b], rows.triangle[row][i], island);
    } else {
        c.rigid_b = rigid_slot(call, b, island, state);
        c.point_b = Vec4d{};
        for (int i = 0; i < 3; ++i) {
            c.point_b += c.weight_b[i] * rest_position(meshes, bodies.mesh[b], rows.triangle[row][i]);
        }
    }
    if (c.rigid_a != kNone && c.rigid_b != kNone) {
        c.restitution = std::max(bodies.tissue[a].restitution, bodies.tissue[b].restitution);
    }
    if (meshes.info[bodies.mesh[b]].admission == Admission::kSheet) c.offset = 0.5 * bodies.thickness[b];
}

void plan_contacts(const AdvanceCall& call, std::span<const uint32_t> island_rows, ContactSorting& sorting, ContactSolver& solver,
                   AdvanceIsland& island, const AdvanceState& state) {
    island.nodes.skin_point.clear();
    island.nodes.node_of_particle.resize(state.particles.offset.size(), kNone);
    // neighbours in the list are neighbours on the surface and share nodes: parts of a long list are dealt in turn, so
    // that the processor can work on one row while another waits for its sums; a short one converges better in order
    const uint32_t count = static_cast<uint32_t>(island_rows.size());
    const size_t nodes = island.nodes.node.size() + 2 * count;
    if (island.nodes.node.capacity() < nodes) island.nodes.node.reserve(2 * nodes), island.nodes.change.reserve(2 * nodes);
    make_room(sorting.dealt, count);
    make_room(sorting.ungrouped, count);
    const uint32_t parts = std::clamp(count / kRowsPerPart, 1u, kMostParts), part = (count + parts - 1) / parts;
    sorting.dealt.clear();
    for (uint32_t i = 0; i < part; ++i)
        for (uint32_t row = i; row < count; row += part) sorting.dealt.push_back(island_rows[row]);
    number_nodes(call, sorting, island_rows, island, state);
    solver.starts_warm = may_start_warm(call, island);
    group_rows(call, island, state.rows, sorting, solver);
    plan_blocks(call, sorting, solver, island, state);
    for (uint32_t g = 0; g < solver.phase[4]; ++g) make_room(solver.group[g].active, solver.group[g].prepared.count);
}

void forget_contacts(const AdvanceCall& call, const ContactSolver& solver, AdvanceIsland& island, ContactRows& rows,
                     AdvanceResult& result) {
    const bool carries = solver.starts_warm && !rows.carried.empty();
    for (const PreparedConstraint& c : solver.prepared) {
        rows.impulse[c.row] += to_vec3(c.impulse);
        if (c.ended) end_row(c.row, rows, result);
        if (carries) rows.carried[c.row] = to_vec3(c.warm / call.dt);
    }
    forget_blocks(call, solver, rows, result);
    parallel_for(uint32_t(island.nodes.node.size()), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t n = begin; n < end; ++n)
            if (island.nodes.node[n].particle != kNone) island.nodes.node_of_particle[island.nodes.node[n].particle] = kNone;
    });
    for (const AdvanceBody& b : island.body) island.slot_of_body[b.body] = kNone;
    for (const AdvanceRigid& r : island.rigid) island.slot_of_body[r.body] = kNone;
}

void note_velocities(const Particles& particles, ContactNodeSet& nodes) {
    parallel_for(uint32_t(nodes.node.size()), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t n = begin; n < end; ++n) {
            const uint32_t i = nodes.node[n].particle;
            if (i != kNone) nodes.change[n].before = particle_velocity(particles, i);
        }
    });
}

void find_held_rows(const AdvanceCall& call, const ContactRows& rows, ContactSolver& solver, AdvanceIsland& island) {
    solver.held.clear();
    if (std::none_of(island.body.begin(), island.body.end(), [](const AdvanceBody& b) { return b.synchronous(); })) return;
    for (size_t n = 0; n < island.nodes.node.size(); ++n) {
        const ContactNode node = island.nodes.node[n];
        if (node.particle == kNone || !island.body[node.owner].synchronous()) continue;
        const AdvanceBody& body = island.body[node.owner];
        node.place = body.origin + float_vec4(_mm_load_ps(&body.now[node.particle - body.particles.first].x));
    }
    for (uint32_t i = 0; i < solver.prepared.size(); ++i) {
        PreparedConstraint& c = solver.prepared[i];
        c.held = Vec4d{};
        const uint32_t rigid = c.rigid_a != kNone ? c.rigid_a : c.rigid_b;
        if (c.ended || rigid == kNone || island.rigid[rigid].node != kNone || (c.rigid_a != kNone && c.rigid_b != kNone)) continue;
        uint32_t point = c.rigid_a == kNone ? c.node_a[0] : c.node_b[0];
        if (point & kSkinPoint) point = island.nodes.skin_point[point & ~kSkinPoint].node[0];
        const uint32_t owner = island.nodes.node[point].owner;
        if (!island.body[owner].synchronous()) continue;
        const RowState r = find_gap(island, c);
        const Foot foot = find_foot(call, island, rows, c, r);
        if (foot.left_behind || !std::isfinite(r.gap)) continue;
        set_substep(call, r, foot, 0, island, c);
        c.implicit.owner = owner;
        solver.held.push_back(i);
    }
}

void apply_impulses(const AdvanceCall& call, ContactComponents& components, ContactSolver& solver, AdvanceIsland& island,
                    const AdvanceState& state, AdvanceResult& result) {
    const double fastest = gather_nodes(call, state.particles, island, result) + fastest_rigid(call, island);
    // most constraints are too far away whatever the velocities: no separation shrinks faster than twice `fastest`
    const double reach = 2.001 * fastest * call.dt;
    for_each_group(solver, [&](RowGroup& group) {
        activate_blocks(call, island.nodes, reach, solver, group);
        find_active_rows(call, state.rows, reach, solver, island, group);
        if (solver.starts_warm) start_rows(solver, island, group);
    });
    for (uint32_t g = 0; g < solver.phase[4]; ++g) result.active_rows += solver.group[g].active.size() + solver.group[g].active_lanes;
    solver.bounces = !island.free.empty() && any_bounces(solver);
    const auto is_free = [](const AdvanceFree& f) { return !f.held; };
    if (any_turns(solver) && std::any_of(island.free.begin(), island.free.end(), is_free)) {
        settle_rows(call, components, solver, island);
    } else if (any_turns(solver)) {
        // a tool in the hand does not rest on its contacts: the next substep goes on with what is left
        for (uint32_t pass = 0; pass < std::max(call.params.contact.iterations, kHeldSweeps); ++pass)
            for_each_group(solver, [&](RowGroup& group) {
                solve_blocks(group, solver, island.nodes);
                for (const uint32_t i : group.active) solve_row(island, solver.prepared[i]);
            });
    } else {
        const uint32_t sweeps = std::max(call.params.contact.iterations, island.nodes.skin_point.empty() ? 1 : kSkinSweeps);
        for (uint32_t pass = 0; pass < sweeps; pass += kSweepsAtOnce) {
            for_each_group(solver, [&](RowGroup& group) {
                for (uint32_t sweep = pass; sweep < std::min(sweeps, pass + kSweepsAtOnce); ++sweep) {
                    solve_blocks(group, solver, island.nodes);
                    for (const uint32_t i : group.active) solve_row(island, solver.prepared[i]);
                }
            });
        }
    }
    scatter_velocities(call, island, state.particles, result);
    if (call.params.account_energy && !island.rigid.empty()) book_hands(solver, island, result);
    for_each_group(solver, [&](const RowGroup& group) { add_impulses(call, island, group, solver, state.tools); });
}

}  // namespace trocar
