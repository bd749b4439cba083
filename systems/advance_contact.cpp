#include <algorithm>
#include <cmath>

#include "engine/check.hpp"
#include "engine/surfaces.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

// A free body this near (m) to what carries it rests on it.
constexpr double kRestingGap = 5e-6;
constexpr uint32_t kHeldSweeps = 4;  // with tools that turn in the hand
// Many rows of a skin share few nodes: after one sweep what is left of their speeds shakes them (20 times the work of damping
// in a press of 20 mm).
constexpr uint32_t kSkinSweeps = 4;
// Sweeps over a group before the next one: its rows are still in the cache then (a tenth of the time of a heap's advance).
// Groups hear of each other in the next substep at the latest.
constexpr uint32_t kSweepsAtOnce = 4;
constexpr uint32_t kRowsPerChunk = 2048;

uint32_t node_slot(const AdvanceScratch& s, uint32_t owner, uint32_t vertex) {
    return s.node_of_particle[s.body[owner].particles.first + vertex];
}

// Node of a vertex of a deformable body, or the new skin point of one that rides.
uint32_t vertex_slot(AdvanceScratch& s, uint32_t owner, uint32_t vertex) {
    if (!s.body[owner].skin_node) return node_slot(s, owner, vertex);
    ContactSkinPoint point;
    for (int k = 0; k < 4; ++k) point.node[k] = node_slot(s, owner, s.body[owner].skin_node[vertex][k]);
    point.weight = s.body[owner].skin_weight[vertex];
    s.skin_point.push_back(point);
    return kSkinPoint | static_cast<uint32_t>(s.skin_point.size() - 1);
}

Vec4d rest_position(const Meshes& meshes, uint32_t prototype, uint32_t vertex) {
    return to_vec4(meshes.position[meshes.info[prototype].vertices.first + vertex]);
}

// Gives the rigid sides and the nodes of all rows their places in scratch: nodes in the order of bodies and particles, so that
// what is done to all of them runs through memory once, and rows find theirs close together.
void number_nodes(AdvanceIsland& island, std::span<const uint32_t> island_rows) {
    AdvanceScratch& s = island.scratch;
    const ContactRows& rows = island.rows;
    constexpr uint32_t kAsked = kNone - 1;
    for (const uint32_t row : s.dealt)
        for (const uint32_t body : {rows.body[row], rows.other[row]})
            if (!is_deformable(island.inputs.bodies, body)) rigid_slot(island, body);
    // several threads may ask for one node
    const auto put = [](auto& place, auto value) {
        const std::atomic_ref at(place);
        if (at.load(std::memory_order_relaxed) != value) at.store(value, std::memory_order_relaxed);
    };
    const auto ask = [&](uint32_t body, std::initializer_list<uint32_t> vertices) {
        if (!is_deformable(island.inputs.bodies, body)) return;
        TROCAR_ASSERT(s.slot_of_body[body] != kNone);
        AdvanceBody& b = s.body[s.slot_of_body[body]];
        put(b.touched, true);
        for (const uint32_t v : vertices) {
            if (v == kNone) continue;
            if (!b.skin_node)
                put(s.node_of_particle[b.particles.first + v], kAsked);
            else
                for (const uint32_t node : b.skin_node[v]) put(s.node_of_particle[b.particles.first + node], kAsked);
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
    const size_t first = s.node.size();
    for (uint32_t owner = 0; owner < s.body.size(); ++owner) {
        const AdvanceBody& b = s.body[owner];
        if (!b.touched) continue;
        for (uint32_t particle = b.particles.first; particle < b.particles.end(); ++particle) {
            if (s.node_of_particle[particle] != kAsked) continue;
            s.node_of_particle[particle] = static_cast<uint32_t>(s.node.particle.size());
            s.node.particle.push_back(particle);
            s.node.owner.push_back(owner);
        }
    }
    const size_t nodes = s.node.particle.size();
    s.node.resize(nodes);
    s.change.resize(nodes);
    parallel_for(static_cast<uint32_t>(s.node.size() - first), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (size_t n = first + begin; n < first + end; ++n) {
            const ContactNode node = s.node[n];
            const AdvanceBody& b = s.body[node.owner];
            node.particle_inv_mass = b.now[node.particle - b.particles.first].w;
            node.inv_mass = b.impulse_left * node.particle_inv_mass;
        }
    });
}

// Where the two points of a row are at the start of a substep.
struct RowState {
    Vec4d point, plane, normal;  // m
    double gap;                  // m
};

RowState find_gap(const AdvanceScratch& s, const ContactPlan& plan) {
    RowState r;
    if (plan.rigid_a == kNone) {
        r.point = field_at(s, plan.node_a[0], &ContactNodes::place);
        if (plan.weight_a[1] != 0 || plan.weight_a[2] != 0) {
            r.point = plan.weight_a[0] * r.point + plan.weight_a[1] * field_at(s, plan.node_a[1], &ContactNodes::place);
        }
        if (plan.weight_a[2] != 0) r.point += plan.weight_a[2] * field_at(s, plan.node_a[2], &ContactNodes::place);
    } else {
        r.point = s.rigid[plan.rigid_a].place[0](plan.point_a);
    }
    if (plan.rigid_b == kNone) {
        const auto place = [&](int k) { return field_at(s, plan.node_b[k], &ContactNodes::place); };
        r.plane = plan.weight_b[0] * place(0) + plan.weight_b[1] * place(1) + plan.weight_b[2] * place(2);
        r.normal = plan.normal;
    } else {
        const RigidMap& place = s.rigid[plan.rigid_b].place[0];
        r.plane = place(plan.point_b);
        r.normal = place.turn(plan.normal);
    }
    r.gap = dot(r.normal, r.point - r.plane) - plan.offset;
    return r;
}

// Velocity of a point of a rigid body, m/s.
Vec4d rigid_velocity(const AdvanceScratch& s, uint32_t slot, Vec4d point) {
    const AdvanceRigid& rigid = s.rigid[slot];
    const Vec4d velocity = rigid.velocity(point);
    return rigid.node == kNone ? velocity : velocity + s.node[rigid.node].velocity;
}

// Velocity of the point relative to the plane point, m/s.
Vec4d relative_velocity(const AdvanceScratch& s, const ContactPlan& plan) {
    Vec4d v;
    if (plan.rigid_a == kNone) {
        v = plan.weight_a[0] * field_at(s, plan.node_a[0], &ContactNodes::velocity);
        if (plan.weight_a[1] != 0) v += plan.weight_a[1] * field_at(s, plan.node_a[1], &ContactNodes::velocity);
        if (plan.weight_a[2] != 0) v += plan.weight_a[2] * field_at(s, plan.node_a[2], &ContactNodes::velocity);
    } else {
        v = rigid_velocity(s, plan.rigid_a, plan.point_a);
    }
    if (plan.rigid_b != kNone) return v - rigid_velocity(s, plan.rigid_b, plan.point_b);
    for (int k = 0; k < 3; ++k) v -= plan.weight_b[k] * field_at(s, plan.node_b[k], &ContactNodes::velocity);
    return v;
}

// No point of a rigid body of the island is faster than this, m/s, its node aside.
double fastest_rigid(const AdvanceIsland& island) {
    double fastest = 0;
    for (const AdvanceRigid& rigid : island.scratch.rigid) {
        double spin2 = 0;
        for (const Vec4d& column : rigid.velocity.column) spin2 += norm2(column);
        const double radius = island.inputs.meshes.info[island.inputs.bodies.mesh[rigid.body]].radius;
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

Foot find_foot(const AdvanceIsland& island, const ContactPlan& plan, const RowState& r) {
    const AdvanceScratch& s = island.scratch;
    if (plan.rigid_b == kNone) {
        const auto place = [&](int k) { return field_at(s, plan.node_b[k], &ContactNodes::place); };
        return find_foot(place(0), place(1), place(2), r.point, r.plane, r.normal, plan.weight_b);
    }
    const AdvanceRigid& rigid = s.rigid[plan.rigid_b];
    const Meshes& meshes = island.inputs.meshes;
    const uint32_t mesh = island.inputs.bodies.mesh[rigid.body];
    const Triangle& t = island.rows.triangle[plan.row];
    const Vec4d point = rigid.place[0].turn_back(r.point - rigid.place[0].shift);
    return find_foot(rest_position(meshes, mesh, t[0]), rest_position(meshes, mesh, t[1]), rest_position(meshes, mesh, t[2]), point,
                     plan.point_b, plan.normal, plan.weight_b);
}

void add_node(ContactActive& active, uint32_t node, double weight) {
    if (weight == 0) return;
    // an edge point whose two ends are one vertex is one node
    for (uint32_t k = 0; k < active.nodes; ++k) {
        if (active.node[k] == node) {
            active.weight[k] += weight;
            return;
        }
    }
    active.node[active.nodes] = node;
    active.weight[active.nodes++] = weight;
}
void add_point(const AdvanceScratch& s, ContactActive& active, uint32_t point, double weight) {
    visit_nodes(s, point, [&](uint32_t node, double share) { add_node(active, node, share * weight); });
}

// Counts a row for its nodes, and sees which are pressed from both sides.
void note_rows(AdvanceScratch& s, const ContactActive& active) {
    for (uint32_t k = 0; k < active.nodes; ++k) {
        const ContactNodeChange change = s.change[active.node[k]];
        // past the side of its triangle a point's push turns the sign of the corner across: nobody presses that one
        const bool of_point = k < active.point_nodes, pressed = (active.weight[k] > 0) == of_point;
        const Vec4d way = of_point ? active.normal : -active.normal;
        if (change.rows++ == 0) {
            change.way = way;
        } else if (pressed && !change.opposed && dot(change.way, way) < kOpposed) {
            change.opposed = true;
        }
    }
}

bool has_free_side(const AdvanceScratch& s, const ContactPlan& plan) {
    const auto is_free = [&](uint32_t rigid) { return rigid != kNone && s.rigid[rigid].free != kNone; };
    return is_free(plan.rigid_a) || is_free(plan.rigid_b);
}

bool is_bounced_away(const ContactPlan& plan, double approach) { return plan.restitution > 0 && approach > kLeastBounce; }

// Half of what the kick of this substep added to the velocity along the normal, m/s: velocities are half a step ahead of places.
double half_kick(const AdvanceScratch& s, const ContactActive& active) {
    Vec4d kick = {};
    for (uint32_t k = 0; k < active.nodes; ++k) {
        const auto change = s.change[active.node[k]];
        kick += active.weight[k] * (change.kicked - change.before);
    }
    return 0.5 * dot(active.normal, kick);
}

// What a row's velocity along the normal must be at least after the substep, m/s; all nodes are known. Bodies that bounce: minus
// the restitution times that before, of those too that move apart (Moreau 1988, "Unilateral contact and dry friction in finite
// freedom dynamics"): with one restitution for all no impact makes energy then, however many rows it has. Both at the time of
// the places: with the kick as it is a ball would rise by (1 + e) g dt / (e v) too high.
double least_velocity(const AdvanceIsland& island, const ContactPlan& plan, const ContactActive& active, double gap, double approach) {
    const double closed = -std::max(gap, 0.0) / island.dt;
    const bool hits = plan.restitution > 0 && approach < -kLeastBounce && gap + approach * island.dt < 0;
    if (!hits && !is_bounced_away(plan, approach)) return closed;
    const double ahead = half_kick(island.scratch, active), back = ahead - plan.restitution * (approach - ahead);
    return hits ? std::max(back, 0.0) : std::min(closed, back);
}

// Where pushes act, and their gap is measured: at the foot, or if that is beside its triangle as near as its weights say, so that no
// corner is pulled where others are pushed. Were they measured elsewhere, rows of a vertex could undo more than each other's pushes.
void set_push_weights(const AdvanceScratch& s, const ContactPlan& plan, const RowState& r, const Foot& foot, ContactActive& active) {
    std::copy_n(active.weight.begin(), active.nodes, active.push_weight.begin());
    active.push_gap = 0;
    if (plan.rigid_b != kNone) return;
    std::array<double, 3> weight = foot.weight;
    const bool beside = *std::min_element(weight.begin(), weight.end()) < 0;
    if (beside) {
        for (double& w : weight) w = std::max(w, 0.0);
        const double sum = weight[0] + weight[1] + weight[2];
        for (double& w : weight) w /= sum;
    }
    Vec4d at = {};
    for (int k = 0; k < 3; ++k) at += weight[k] * field_at(s, plan.node_b[k], &ContactNodes::place);
    active.push_gap = dot(r.normal, at - r.plane);
    if (!beside) return;
    const auto first = active.node.begin() + active.point_nodes, last = active.node.begin() + active.nodes;
    std::fill(active.push_weight.begin() + active.point_nodes, active.push_weight.begin() + active.nodes, 0.0);
    for (int k = 0; k < 3; ++k)
        visit_nodes(s, plan.node_b[k], [&](uint32_t node, double share) {
            const auto found = std::find(first, last, node);
            if (found != last) active.push_weight[found - active.node.begin()] -= share * weight[k];
        });
}

// Adds a row to the active ones. approach: m/s along the normal, before any impulse of the substep.
void add_active(AdvanceIsland& island, uint32_t plan_row, const RowState& r, const Foot& foot, double approach,
                std::vector<ContactActive>& rows) {
    AdvanceScratch& s = island.scratch;
    const ContactPlan& plan = s.plan[plan_row];
    ContactActive& active = rows.emplace_back();
    active.plan = plan_row;
    active.friction = plan.friction;
    active.normal = r.normal;
    active.rigid_velocity = active.friction_impulse = Vec4d{};
    if (plan.rigid_a == kNone) {
        for (int i = 0; i < 3; ++i) add_point(s, active, plan.node_a[i], plan.weight_a[i]);
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_a];
        if (rigid.free == kNone)
            active.rigid_velocity += rigid.velocity(plan.point_a);
        else if (rigid.jaw != kNone)
            active.rigid_velocity += rigid.grip_velocity(plan.point_a);
        if (rigid.node != kNone) add_node(active, rigid.node, 1);
    }
    active.point_nodes = active.nodes;
    if (plan.rigid_b == kNone) {
        for (int k = 0; k < 3; ++k) add_point(s, active, plan.node_b[k], -foot.weight[k]);
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_b];
        if (rigid.free == kNone)
            active.rigid_velocity -= rigid.velocity(foot.point);
        else if (rigid.jaw != kNone)
            active.rigid_velocity -= rigid.grip_velocity(foot.point);
        if (rigid.node != kNone) add_node(active, rigid.node, -1);
    }
    double sum = 0;
    for (uint32_t k = 0; k < active.nodes; ++k) {
        sum += active.weight[k] * active.weight[k] * s.node[active.node[k]].inv_mass;
    }
    active.inv_sum = sum > 0 ? 1 / sum : 0;
    set_push_weights(s, plan, r, foot, active);
    active.least_velocity = least_velocity(island, plan, active, r.gap, approach);
    // a free body rests anywhere in a thin band: gaps of a micrometre among its rows would let it rock at 1 mm/s
    if (r.gap < kRestingGap && !is_bounced_away(plan, approach) && !s.free.empty() && has_free_side(s, plan)) {
        active.least_velocity = std::max(active.least_velocity, 0.0);
    }
    // both impulses act at one point, so that angular momentum is kept: the foot, which a deformable plane rides on
    if (!s.free.empty() && has_free_side(s, plan)) {
        add_turning_sides(island, plan, plan.rigid_b == kNone ? foot.point : r.point, active);
    }
}

// Adds a row to the active ones, or ends it. What the implicit step gave counts as given.
void activate(AdvanceIsland& island, uint32_t plan_row, const RowState& r, double approach, std::vector<ContactActive>& rows) {
    AdvanceScratch& s = island.scratch;
    ContactPlan& plan = s.plan[plan_row];
    const Foot foot = find_foot(island, plan, r);
    if (foot.left_behind) {
        plan.ended = true;
        end_row(island, plan.row);
        return;
    }
    add_active(island, plan_row, r, foot, approach, rows);
    ContactActive& active = rows.back();
    active.normal_impulse = dot(plan.held, active.normal);
    if (active.normal_impulse > 0) {
        active.friction_impulse = plan.held - active.normal_impulse * active.normal;
        active.friction = std::max(active.friction, std::sqrt(norm2(active.friction_impulse)) / active.normal_impulse);
    }
    note_rows(s, active);
}

void find_active_rows(AdvanceIsland& island, double reach, RowGroup& group) {
    const AdvanceScratch& s = island.scratch;
    group.active.clear();
    group.turning_rows = 0;
    for (uint32_t i = group.plan.first; i < group.plan.end(); ++i) {
        const ContactPlan& plan = s.plan[i];
        if (plan.ended) continue;
        const RowState r = find_gap(s, plan);
        if (!(r.gap < reach)) continue;
        const Vec4d velocity = relative_velocity(s, plan);
        const double gap_after = r.gap + std::min(dot(r.normal, velocity), 0.0) * island.dt;
        // a point that is not finite belongs to a body about to be restored: it must not reach its neighbours
        if (!std::isfinite(gap_after + norm2(velocity))) continue;
        // a free body's row may be crossed because of an impulse at another of its rows
        if (!(gap_after < 0) && (s.free.empty() || !has_free_side(s, plan))) continue;
        activate(island, i, r, dot(r.normal, velocity), group.active);
    }
    for (const ContactActive& row : group.active) group.turning_rows += row.turning != kNone;
    std::atomic_ref(island.result.active_rows).fetch_add(group.active.size(), std::memory_order_relaxed);
}

// Gives one row the impulse that its nodes' velocities ask for now. kNodes is how many it has, 0 for any number.
template <uint32_t kNodes>
void solve_nodes(AdvanceScratch& s, ContactActive& row) {
    const uint32_t nodes = kNodes > 0 ? kNodes : row.nodes;
    const auto part = [&](uint32_t k) { return row.weight[k] * s.node[row.node[k]].velocity; };
    Vec4d velocity = row.rigid_velocity;
    if constexpr (kNodes == 4) {
        velocity += (part(0) + part(1)) + (part(2) + part(3));
    } else {
        for (uint32_t k = 0; k < nodes; ++k) velocity += part(k);
    }
    const double approach = dot(row.normal, velocity);
    const double normal_impulse = std::max(0.0, row.normal_impulse - (approach - row.least_velocity) * row.inv_sum);
    Vec4d impulse = (normal_impulse - row.normal_impulse) * row.normal;
    row.normal_impulse = normal_impulse;
    if (row.friction > 0) {
        const double most = row.friction * normal_impulse;
        Vec4d friction = row.friction_impulse - (velocity - approach * row.normal) * row.inv_sum;
        const double size2 = norm2(friction);
        if (size2 > most * most) friction *= most / std::sqrt(size2);
        impulse += friction - row.friction_impulse;
        row.friction_impulse = friction;
    }
    for (uint32_t k = 0; k < nodes; ++k) {
        const ContactNode node = s.node[row.node[k]];
        node.velocity += (row.weight[k] * node.inv_mass) * impulse;
    }
}

// Every row starts from what it carried in the substep before: what rests is found at once, and one sweep a substep is
// enough for what changes slowly.
void start_rows(AdvanceScratch& s, RowGroup& group) {
    start_blocks(s, group);
    for (ContactActive& row : group.active) {
        const Vec4d warm = row.warm = s.warm[row.plan];
        if (row.normal_impulse > 0) continue;  // held, and given already
        row.normal_impulse = std::max(0.0, dot(warm, row.normal));
        if (row.normal_impulse == 0) continue;
        row.friction_impulse = warm - dot(warm, row.normal) * row.normal;
        const Vec4d impulse = row.normal_impulse * row.normal + row.friction_impulse;
        if (row.turning != kNone) {
            give_impulse(s, row, s.turning[row.turning], impulse);
            continue;
        }
        for (uint32_t k = 0; k < row.nodes; ++k) {
            const ContactNode node = s.node[row.node[k]];
            node.velocity += (row.weight[k] * node.inv_mass) * impulse;
        }
    }
    std::fill_n(s.warm.begin() + group.plan.first, group.plan.count, Vec4d{});
}

bool any_bounces(const AdvanceScratch& s) {
    const auto bounces = [](const ContactActive& row) { return row.least_velocity > 0; };
    return std::ranges::any_of(std::span(s.group).first(s.phase[4]),
                               [&](const RowGroup& g) { return std::ranges::any_of(g.active, bounces); });
}

Vec4d particle_velocity(const Particles& p, uint32_t i) { return make_vec4(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]); }

// Runs visit(begin, end, sums) for chunks of nodes.
template <typename Visit>
void for_node_chunks(AdvanceScratch& s, const Visit& visit) {
    const uint32_t nodes = uint32_t(s.node.size());
    s.node_sums.assign(chunk_count(nodes, kNodesPerChunk), {});
    parallel_for(nodes, kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        NodeSums sums;
        visit(begin, end, sums);
        s.node_sums[begin / kNodesPerChunk] = sums;
    });
}

// Writes what the rows did to the particles: velocity, and the drift that belongs to it. Books the work: a leapfrog kick
// does work at the mean of the velocities before and after it, all its impulses together; what damping took is at
// that mean too, where the kernel's books had the velocity before the rows.
void scatter_velocities(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    Particles& p = island.particles;
    const auto scatter = [&](uint32_t n, NodeSums& sums) {
        const ContactNode node = s.node[n];
        const ContactNodeChange change = s.change[n];
        const __m256d same = _mm256_cmp_pd((__m256d)node.velocity, (__m256d)change.kicked, _CMP_EQ_UQ);
        if (_mm256_movemask_pd(same) == 15 || node.particle == kNone || node.inv_mass == 0) return;
        const __m128 velocity = _mm256_cvtpd_ps((__m256d)node.velocity);
        p.velocity_x[node.particle] = velocity[0];
        p.velocity_y[node.particle] = velocity[1];
        p.velocity_z[node.particle] = velocity[2];
        node.velocity = float_vec4(velocity);
        const Vec4d kick = node.velocity - change.kicked;
        move_particle(s.body[node.owner], node, island.dt * kick);
        if (s.body[node.owner].measured()) return;
        const double left = s.body[node.owner].impulse_left;
        const Vec4d half = (0.5 / node.inv_mass) * kick;
        sums.work += half * (change.before + node.velocity);
        sums.damped += left * half * (change.damped - change.before) - (1 - left) * half * (change.before + node.velocity);
    };
    for_node_chunks(s, [&](uint32_t begin, uint32_t end, NodeSums& sums) {
        for (uint32_t n = begin; n < end; ++n) scatter(n, sums);
    });
    Vec4d work = {}, damped = {};
    for (const NodeSums& sums : s.node_sums) work += sums.work, damped += sums.damped;
    if (island.params.account_energy) {
        island.result.work_contact += work[0] + work[1] + work[2];
        island.result.work_damping += damped[0] + damped[1] + damped[2];
    }
    if (island.params.account_energy && !s.free.empty()) island.result.work_contact += contact_work_on_free(island);
}

// What hands and scripted bodies did of the work of the rows.
void book_hands(AdvanceIsland& island) {
    const AdvanceScratch& s = island.scratch;
    double hand = 0;
    const auto book = [&](const ContactActive& row) {
        const ContactPlan& plan = s.plan[row.plan];
        const auto is_held = [&](uint32_t rigid) {
            return rigid != kNone && s.rigid[rigid].free != kNone && s.free[s.rigid[rigid].free].held;
        };
        const auto is_driven = [&](uint32_t rigid) { return rigid != kNone && (s.rigid[rigid].free == kNone || is_held(rigid)); };
        if (is_driven(plan.rigid_a) == is_driven(plan.rigid_b)) return;
        Vec4d surface = row.rigid_velocity;
        for (uint32_t k = 0; k < row.nodes; ++k) {
            const uint32_t n = row.node[k];
            if (s.node[n].particle != kNone || (s.rigid[s.node[n].owner].free != kNone && !is_held(s.node[n].owner))) continue;
            surface += row.weight[k] * 0.5 * (s.change[n].before + s.node[n].velocity);
        }
        for (int side = 0; side < 2; ++side) {
            if (!is_held(side == 0 ? plan.rigid_a : plan.rigid_b)) continue;
            const ContactTurning& turning = s.turning[row.turning];
            const AdvanceFree& f = s.free[turning.free[side]];
            surface += (side == 0 ? 0.5 : -0.5) * cross(f.spin_before + f.spin, turning.arm[side]);
        }
        hand -= dot(surface, row.normal_impulse * row.normal + row.friction_impulse);
    };
    for (uint32_t g = 0; g < s.phase[4]; ++g)
        for (const ContactActive& row : s.group[g].active) book(row);
    island.result.work_hand += hand;
    island.result.work_contact -= hand;
}

void add_impulses(AdvanceIsland& island, const RowGroup& group) {
    AdvanceScratch& s = island.scratch;
    add_block_impulses(s, group);
    for (const ContactActive& row : group.active) {
        const Vec4d impulse = row.normal_impulse * row.normal + row.friction_impulse;
        ContactPlan& plan = s.plan[row.plan];
        plan.impulse += impulse;
        if (!s.warm.empty()) s.warm[row.plan] = s.bounces ? row.warm : impulse;
        const auto on_tool = [&](uint32_t rigid, int side, Vec4d j) {
            if (rigid == kNone) return;
            const AdvanceRigid& hit = s.rigid[s.rigid[rigid].holder == kNone ? rigid : s.rigid[rigid].holder];
            if (hit.tool == kNone) return;
            ToolState& tool = island.tools[hit.tool];
            tool.contact_impulse += to_vec3(j);
            if (row.turning == kNone) return;
            const Vec4d arm = s.turning[row.turning].arm[side];
            tool.contact_moment += to_vec3(cross(arm, j));
            add_grip_moment(island, rigid, s.node[hit.node].place + arm, j);
        };
        on_tool(plan.rigid_a, 0, impulse);
        on_tool(plan.rigid_b, 1, -impulse);
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
void gather_run(AdvanceIsland& island, size_t begin, size_t end, NodeSums& sums) {
    AdvanceScratch& s = island.scratch;
    const bool particles = s.node.particle[begin] != kNone, books = island.params.account_energy, later = island.substep > 0;
    const AdvanceBody* const body = particles ? &s.body[s.node.owner[begin]] : nullptr;
    const KickOfBody kick = particles ? KickOfBody(*body) : KickOfBody(AdvanceBody{});
    const uint32_t first = particles ? body->particles.first : 0;
    const Float4 *const now = particles ? body->now : nullptr, *const next = particles ? body->next : nullptr;
    for (size_t n = begin; n < end; ++n) {
        const ContactNode node = s.node[n];
        const ContactNodeChange change = s.change[n];
        if (particles) {
            const uint32_t vertex = node.particle - first;
            if (later) change.before = node.velocity;
            node.place = kick.origin + float_vec4(_mm_load_ps(&now[vertex].x));
            node.after = kick.origin + float_vec4(_mm_load_ps(&next[vertex].x));
            node.velocity = particle_velocity(island.particles, node.particle);
            if (books) sums.work[0] += note_kick(kick, node, change);
        }
        change.kicked = node.velocity;
        change.change = Vec4d{};
        sums.fastest = greatest(node.velocity * node.velocity, sums.fastest);
        sums.total += node.velocity;
    }
    // apart: after a byte is written the compiler reads all pointers again
    std::fill(s.change.rows.begin() + begin, s.change.rows.begin() + end, 0);
    for (auto* flag : {&s.change.pushed, &s.change.opposed}) std::fill(flag->begin() + begin, flag->begin() + end, uint8_t{0});
}

// Nodes after kick and drift; books the pushes of the substep before. Returns a bound of their velocities, m/s; infinite
// if one of them is not finite.
double gather_nodes(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    for_node_chunks(s, [&](uint32_t begin, uint32_t end, NodeSums& sums) {
        while (begin < end) {
            uint32_t last = begin + 1;
            const bool particle = s.node.particle[begin] != kNone;
            while (last < end && s.node.owner[last] == s.node.owner[begin] && (s.node.particle[last] != kNone) == particle) ++last;
            gather_run(island, begin, last, sums);
            begin = last;
        }
    });
    Vec4d most = {}, total = {};
    double work = 0;
    for (const NodeSums& sums : s.node_sums) most = greatest(sums.fastest, most), total += sums.total, work += sums.work[0];
    if (std::isfinite(work)) island.result.work_push -= work;  // else a body about to be restored
    const bool finite = std::isfinite(total[0] + total[1] + total[2]);
    return finite ? std::sqrt(most[0] + most[1] + most[2]) : std::numeric_limits<double>::infinity();
}

}  // namespace

double solve_row(AdvanceScratch& s, ContactActive& row) {
    if (row.turning != kNone) return solve_turning_row(s, row);
    row.nodes == 4 ? solve_nodes<4>(s, row) : solve_nodes<0>(s, row);
    return 0;
}

ContactPlan make_plan(AdvanceIsland& island, uint32_t row) {
    AdvanceScratch& s = island.scratch;
    const ContactRows& rows = island.rows;
    const Bodies& bodies = island.inputs.bodies;
    const Meshes& meshes = island.inputs.meshes;
    const uint32_t a = rows.body[row], b = rows.other[row];
    ContactPlan plan;
    plan.row = row;
    const bool in_face = rows.third[row] != kNone;
    plan.weight_a = {1.0 - rows.along[row] - rows.across[row], rows.along[row], rows.across[row]};
    plan.weight_b = {rows.weight[row][0], rows.weight[row][1], rows.weight[row][2]};
    plan.normal = to_vec4(rows.normal[row]);
    plan.impulse = plan.held = Vec4d{};
    plan.friction = rows.friction[row];
    plan.ended = std::isinf(rows.distance[row]);
    if (is_deformable(bodies, a)) {
        TROCAR_ASSERT(s.slot_of_body[a] != kNone);
        const auto& vertex = rows.vertex[row];
        plan.node_a[0] = vertex_slot(s, s.slot_of_body[a], vertex[0]);
        plan.node_a[1] = vertex[1] == vertex[0] ? plan.node_a[0] : vertex_slot(s, s.slot_of_body[a], vertex[1]);
        plan.node_a[2] = in_face ? vertex_slot(s, s.slot_of_body[a], rows.third[row]) : plan.node_a[0];
    } else {
        plan.rigid_a = rigid_slot(island, a);
        plan.point_a = plan.weight_a[0] * rest_position(meshes, bodies.mesh[a], rows.vertex[row][0]) +
                       plan.weight_a[1] * rest_position(meshes, bodies.mesh[a], rows.vertex[row][1]);
        if (in_face) plan.point_a += plan.weight_a[2] * rest_position(meshes, bodies.mesh[a], rows.third[row]);
    }
    if (is_deformable(bodies, b)) {
        TROCAR_ASSERT(s.slot_of_body[b] != kNone);
        for (int i = 0; i < 3; ++i) plan.node_b[i] = vertex_slot(s, s.slot_of_body[b], rows.triangle[row][i]);
    } else {
        plan.rigid_b = rigid_slot(island, b);
        plan.point_b = Vec4d{};
        for (int i = 0; i < 3; ++i) {
            plan.point_b += plan.weight_b[i] * rest_position(meshes, bodies.mesh[b], rows.triangle[row][i]);
        }
    }
    if (plan.rigid_a != kNone && plan.rigid_b != kNone) {
        plan.restitution = std::max(bodies.tissue[a].restitution, bodies.tissue[b].restitution);
    }
    if (meshes.info[bodies.mesh[b]].admission == Admission::kSheet) plan.offset = 0.5 * bodies.thickness[b];
    return plan;
}

void plan_contacts(AdvanceIsland& island, std::span<const uint32_t> island_rows) {
    AdvanceScratch& s = island.scratch;
    s.skin_point.clear();
    s.node_of_particle.resize(island.particles.offset.size(), kNone);
    // neighbours in the list are neighbours on the surface and share nodes: parts of a long list are dealt in turn, so
    // that the processor can work on one row while another waits for its sums; a short one converges better in order
    constexpr uint32_t kMostParts = 8, kRowsPerPart = 32;
    const uint32_t count = static_cast<uint32_t>(island_rows.size());
    const size_t nodes = s.node.size() + 2 * count;
    if (s.node.capacity() < nodes) s.node.reserve(2 * nodes), s.change.reserve(2 * nodes);
    make_room(s.dealt, count);
    make_room(s.ungrouped, count);
    const uint32_t parts = std::clamp(count / kRowsPerPart, 1u, kMostParts), part = (count + parts - 1) / parts;
    s.dealt.clear();
    for (uint32_t i = 0; i < part; ++i)
        for (uint32_t row = i; row < count; row += part) s.dealt.push_back(island_rows[row]);
    number_nodes(island, island_rows);
    group_rows(island);
    plan_blocks(island);
    for (uint32_t g = 0; g < s.phase[4]; ++g) make_room(s.group[g].active, s.group[g].plan.count);
    s.warm.clear();
    if (starts_warm(island)) {
        make_room(s.warm, s.plan.size());
        for (const ContactPlan& plan : s.plan) s.warm.push_back(start_impulse(island, plan.row));
    }
    if (!s.free.empty()) {
        make_room(s.turning, s.plan.size());
        s.turning.resize(s.plan.size());
        make_room(s.settling, s.plan.size());
        make_room(s.component, s.node.size());
        make_room(s.component_of, s.node.size());
    }
}

void forget_contacts(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    for (const ContactPlan& plan : s.plan) island.rows.impulse[plan.row] += to_vec3(plan.impulse);
    if (!island.rows.carried.empty()) {
        for (size_t i = 0; i < s.warm.size(); ++i) island.rows.carried[s.plan[i].row] = to_vec3(s.warm[i] / island.dt);
    }
    forget_blocks(island);
    parallel_for(uint32_t(s.node.size()), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t n = begin; n < end; ++n)
            if (s.node[n].particle != kNone) s.node_of_particle[s.node[n].particle] = kNone;
    });
    for (const AdvanceBody& b : s.body) s.slot_of_body[b.body] = kNone;
    for (const AdvanceRigid& r : s.rigid) s.slot_of_body[r.body] = kNone;
}

void note_velocities(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    parallel_for(uint32_t(s.node.size()), kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t n = begin; n < end; ++n) {
            const uint32_t i = s.node[n].particle;
            if (i != kNone) s.change[n].before = particle_velocity(island.particles, i);
        }
    });
}

void find_held_rows(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    s.held.clear();
    s.held_active.clear();
    if (std::none_of(s.body.begin(), s.body.end(), [](const AdvanceBody& b) { return b.synchronous(); })) return;
    for (size_t n = 0; n < s.node.size(); ++n) {
        const ContactNode node = s.node[n];
        if (node.particle == kNone || !s.body[node.owner].synchronous()) continue;
        const AdvanceBody& body = s.body[node.owner];
        node.place = body.origin + float_vec4(_mm_load_ps(&body.now[node.particle - body.particles.first].x));
    }
    for (uint32_t i = 0; i < s.plan.size(); ++i) {
        ContactPlan& plan = s.plan[i];
        plan.held = Vec4d{};
        const uint32_t rigid = plan.rigid_a != kNone ? plan.rigid_a : plan.rigid_b;
        if (plan.ended || rigid == kNone || s.rigid[rigid].node != kNone || (plan.rigid_a != kNone && plan.rigid_b != kNone)) continue;
        uint32_t point = plan.rigid_a == kNone ? plan.node_a[0] : plan.node_b[0];
        if (point & kSkinPoint) point = s.skin_point[point & ~kSkinPoint].node[0];
        const uint32_t owner = s.node[point].owner;
        if (!s.body[owner].synchronous()) continue;
        const RowState r = find_gap(s, plan);
        const Foot foot = find_foot(island, plan, r);
        if (foot.left_behind || !std::isfinite(r.gap)) continue;
        add_active(island, i, r, foot, 0, s.held_active);
        s.held.push_back({.owner = owner});
    }
}

void apply_impulses(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    const double fastest = gather_nodes(island) + fastest_rigid(island);
    // most rows are seen to be too far away without asking for velocities: none is closed faster than twice `fastest`
    const double reach = 2.001 * fastest * island.dt;
    for_each_group(s, [&](RowGroup& group) {
        activate_blocks(island, reach, group);
        find_active_rows(island, reach, group);
        if (starts_warm(island)) start_rows(s, group);
    });
    s.bounces = !s.free.empty() && any_bounces(s);
    const auto is_free = [](const AdvanceFree& f) { return !f.held; };
    if (any_turns(s) && std::any_of(s.free.begin(), s.free.end(), is_free)) {
        settle_rows(island);
    } else if (any_turns(s)) {
        // a tool in the hand does not stand on its rows: what a substep leaves, the next goes on from
        for (uint32_t pass = 0; pass < std::max(island.params.contact.iterations, kHeldSweeps); ++pass)
            for_each_group(s, [&](RowGroup& group) {
                solve_blocks(s, group);
                for (ContactActive& row : group.active) solve_row(s, row);
            });
    } else {
        const uint32_t sweeps = std::max(island.params.contact.iterations, s.skin_point.empty() ? 1 : kSkinSweeps);
        for (uint32_t pass = 0; pass < sweeps; pass += kSweepsAtOnce) {
            for_each_group(s, [&](RowGroup& group) {
                for (uint32_t sweep = pass; sweep < std::min(sweeps, pass + kSweepsAtOnce); ++sweep) {
                    solve_blocks(s, group);
                    for (ContactActive& row : group.active) solve_row(s, row);
                }
            });
        }
    }
    scatter_velocities(island);
    if (island.params.account_energy && !s.rigid.empty()) book_hands(island);
    for_each_group(s, [&](const RowGroup& group) { add_impulses(island, group); });
}

}  // namespace trocar
