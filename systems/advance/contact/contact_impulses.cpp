#include "systems/advance/contact/contact_impulses.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/mesh/surface_walk.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/advance/contact/graph_colouring.hpp"
#include "systems/advance/contact/implicit_contacts.hpp"
#include "systems/advance/contact/nncg.hpp"
#include "systems/advance/contact/wide_constraints.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/advance/rigid/free_bodies.hpp"
#include "systems/advance/rigid/rigid_bodies.hpp"
namespace trocar {
namespace {

constexpr uint32_t kConstraintsPerChunk = 2048;

uint32_t node_slot(const AdvanceIsland& island, uint32_t owner, uint32_t vertex) {
    return island.nodes.node_of_particle[island.body[owner].particles.first + vertex];
}

// Node of a deformable body's vertex, or a new embedded point for a vertex of an embedded surface.
uint32_t vertex_slot(uint32_t owner, uint32_t vertex, AdvanceIsland& island) {
    if (!island.body[owner].embedding_node) return node_slot(island, owner, vertex);
    EmbeddedPoint point;
    for (int k = 0; k < 4; ++k) point.node[k] = node_slot(island, owner, island.body[owner].embedding_node[vertex][k]);
    point.weight = island.body[owner].embedding_weight[vertex];
    island.nodes.embedded_point.push_back(point);
    return kEmbeddedPoint | static_cast<uint32_t>(island.nodes.embedded_point.size() - 1);
}

Vec4d rest_position(const Meshes& meshes, uint32_t prototype, uint32_t vertex) {
    return to_vec4(meshes.position[meshes.info[prototype].vertices.first + vertex]);
}

// Numbers the rigid sides and the nodes of all constraints: nodes in the order of bodies and particles, so
// that loops over all nodes run through memory once and a constraint's nodes are close together.
void number_nodes(const AdvanceCall& call, const ContactSorting& sorting, std::span<const uint32_t> island_constraints,
                  AdvanceIsland& island, const AdvanceState& state) {
    const ContactConstraints& constraints = state.constraints;
    constexpr uint32_t kAsked = kNone - 1;
    for (const uint32_t constraint : sorting.order)
        for (const uint32_t body : {constraints.body[constraint], constraints.other[constraint]})
            if (!is_deformable(call.inputs.bodies, body)) rigid_slot(call, body, island, state);
    // several threads may write one node
    const auto put = [](auto& target, auto value) {
        const std::atomic_ref at(target);
        if (at.load(std::memory_order_relaxed) != value) at.store(value, std::memory_order_relaxed);
    };
    const auto ask = [&](uint32_t body, std::initializer_list<uint32_t> vertices) {
        if (!is_deformable(call.inputs.bodies, body)) return;
        TROCAR_ASSERT(island.slot_of_body[body] != kNone);
        AdvanceBody& b = island.body[island.slot_of_body[body]];
        put(b.touched, true);
        for (const uint32_t v : vertices) {
            if (v == kNone) continue;
            if (!b.embedding_node)
                put(island.nodes.node_of_particle[b.particles.first + v], kAsked);
            else
                for (const uint32_t node : b.embedding_node[v]) put(island.nodes.node_of_particle[b.particles.first + node], kAsked);
        }
    };
    parallel_for(static_cast<uint32_t>(island_constraints.size()), kConstraintsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const uint32_t constraint = island_constraints[i];
            const Triangle& t = constraints.triangle[constraint];
            ask(constraints.body[constraint],
                {constraints.vertex[constraint][0], constraints.vertex[constraint][1], constraints.third[constraint]});
            ask(constraints.other[constraint], {t[0], t[1], t[2]});
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
struct ConstraintGeometry {
    Vec4d point, plane, normal;  // m
    double separation;           // m
};

ConstraintGeometry geometry_of(const AdvanceIsland& island, const PreparedConstraint& c) {
    ConstraintGeometry r;
    if (c.rigid_a == kNone) {
        r.point = field_at(island.nodes, c.node_a[0], &ContactNodes::position);
        if (c.weight_a[1] != 0 || c.weight_a[2] != 0) {
            r.point = c.weight_a[0] * r.point + c.weight_a[1] * field_at(island.nodes, c.node_a[1], &ContactNodes::position);
        }
        if (c.weight_a[2] != 0) r.point += c.weight_a[2] * field_at(island.nodes, c.node_a[2], &ContactNodes::position);
    } else {
        r.point = island.rigid[c.rigid_a].pose[0](c.point_a);
    }
    if (c.rigid_b == kNone) {
        const auto position = [&](int k) { return field_at(island.nodes, c.node_b[k], &ContactNodes::position); };
        r.plane = c.weight_b[0] * position(0) + c.weight_b[1] * position(1) + c.weight_b[2] * position(2);
        r.normal = c.plane;
    } else {
        const RigidMap& pose = island.rigid[c.rigid_b].pose[0];
        r.plane = pose(c.point_b);
        r.normal = pose.turn(c.plane);
    }
    r.separation = dot(r.normal, r.point - r.plane) - c.offset;
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

// Bound on the speed of points of the island's rigid bodies relative to their nodes, m/s.
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

// Projection of the point on the plane of the constraint's triangle, along the normal, so that angular
// momentum is kept exactly: barycentric weights. Frame of the other body if it is rigid.
struct ClosestPoint {
    std::array<double, 3> weight;
    Vec4d point;   // m
    bool expired;  // more than one edge length beyond the triangle; of a rigid body, if its surface does not go on there
};

ClosestPoint find_closest_point(Vec4d a, Vec4d b, Vec4d c, Vec4d point, Vec4d plane, Vec4d normal, const std::array<double, 3>& fixed) {
    const Vec4d u = b - a, v = c - a;
    const double edge2[3] = {norm2(c - b), norm2(v), norm2(u)};  // opposite corner k
    const double longest2 = std::max({edge2[0], edge2[1], edge2[2]});
    const Vec4d twice_area = cross(u, v);
    const double area2 = norm2(twice_area), along = dot(normal, twice_area);
    if (!(along > 0 && along * along > kLeastCosine * kLeastCosine * area2 && area2 > 1e-12 * longest2 * longest2)) {
        const Vec4d apart = point - plane, slide = apart - normal * dot(normal, apart);
        return {fixed, plane, norm2(slide) > longest2};
    }
    ClosestPoint closest;
    closest.point = point - normal * (dot(point - a, twice_area) / along);
    const Vec4d q = closest.point - a;
    const double per_area2 = 1 / area2;
    closest.weight[1] = dot(q, cross(v, twice_area)) * per_area2;
    closest.weight[2] = dot(q, cross(twice_area, u)) * per_area2;
    closest.weight[0] = 1 - closest.weight[1] - closest.weight[2];
    closest.expired = false;
    for (int k = 0; k < 3; ++k) {
        // distance beyond side k = -weight * height of the side
        const double w = closest.weight[k];
        closest.expired = closest.expired || (w < 0 && w * w * area2 > longest2 * edge2[k]);
    }
    return closest;
}

// Whether a constraint's plane ends with a triangle; those of convex hulls do not.
bool is_bounded(const ContactConstraints& constraints, uint32_t constraint) {
    return constraints.triangle[constraint][1] != constraints.triangle[constraint][2];
}

// Attaches the plane of a constraint to the rigid body's triangle where it was detected; that of a hull, which no triangle bounds, where
// the point of the other body is.
void place_plane(const AdvanceCall& call, const AdvanceIsland& island, const ContactConstraints& constraints, PreparedConstraint& c) {
    const uint32_t mesh = call.inputs.bodies.mesh[island.rigid[c.rigid_b].body];
    c.plane = to_vec4(constraints.normal[c.constraint]);
    c.point_b = Vec4d{};
    for (int i = 0; i < 3; ++i) c.point_b += c.weight_b[i] * rest_position(call.inputs.meshes, mesh, constraints.triangle[c.constraint][i]);
    c.moved_plane = false;
    if (!is_bounded(constraints, c.constraint)) {
        const RigidMap &a = island.rigid[c.rigid_a].pose[0], &b = island.rigid[c.rigid_b].pose[0];
        const Vec4d point = b.turn_back(a(c.point_a) - b.shift);
        c.point_b = point - c.plane * dot(c.plane, point - c.point_b);
    }
}

// The same for a constraint. Where its point has left the triangle of a rigid body, the plane follows the body's surface.
ClosestPoint find_closest_point(const AdvanceCall& call, const AdvanceIsland& island, const ContactConstraints& constraints,
                                PreparedConstraint& c, ConstraintGeometry& r) {
    if (c.rigid_b == kNone) {
        const auto position = [&](int k) { return field_at(island.nodes, c.node_b[k], &ContactNodes::position); };
        return find_closest_point(position(0), position(1), position(2), r.point, r.plane, r.normal, c.weight_b);
    }
    if (!is_bounded(constraints, c.constraint)) return {c.weight_b, c.point_b, false};
    const AdvanceRigid& rigid = island.rigid[c.rigid_b];
    const MeshView mesh = mesh_view(call.inputs.meshes, call.inputs.bodies.mesh[rigid.body]);
    const Triangle& t = constraints.triangle[c.constraint];
    const Vec4d point = rigid.pose[0].turn_back(r.point - rigid.pose[0].shift);
    const auto corner = [&](int k) { return to_vec4(mesh.position[t[k]]); };
    ClosestPoint closest = find_closest_point(corner(0), corner(1), corner(2), point, c.point_b, c.plane, c.weight_b);
    if (!closest.expired) return closest;
    const SurfacePlane below = walk_surface(mesh, t, constraints.normal[c.constraint], to_vec3(point));
    if (below.triangle == kNone) return closest;
    const Vec4d on_plane = to_vec4(mesh.position[mesh.triangle[below.triangle][0]]);
    c.plane = to_vec4(below.normal);
    c.point_b = point - c.plane * dot(c.plane, point - on_plane);
    c.moved_plane = true;
    r = geometry_of(island, c);
    return {closest.weight, c.point_b, false};
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

// Counts a constraint for its nodes, and marks nodes pressed from opposite sides.
void note_constraint(const PreparedConstraint& c, ContactNodeSet& nodes) {
    for (uint32_t k = 0; k < c.nodes; ++k) {
        const ContactNodeChange change = nodes.change[c.node[k]];
        // beyond a side of the triangle the opposite corner's weight is negative: the constraint pulls that
        // corner
        const bool of_point = k < c.point_nodes, pressed = (c.weight[k] > 0) == of_point;
        const Vec4d direction = of_point ? c.normal : -c.normal;
        if (change.constraint_count++ == 0) {
            change.displacement = direction;
        } else if (pressed && !change.conflicting && dot(change.displacement, direction) < kConflictCosine) {
            change.conflicting = true;
        }
    }
}

bool has_free_side(const AdvanceIsland& island, const PreparedConstraint& c) {
    const auto is_free = [&](uint32_t rigid) { return rigid != kNone && island.rigid[rigid].free != kNone; };
    return is_free(c.rigid_a) || is_free(c.rigid_b);
}

bool is_bounced_away(const PreparedConstraint& c, double approach) { return c.restitution > 0 && approach > kLeastBounce; }

// Half of this substep's kick along the normal, m/s: velocities are half a step ahead of positions.
double half_kick(const PreparedConstraint& c, ContactNodeSet& nodes) {
    Vec4d kick = {};
    for (uint32_t k = 0; k < c.nodes; ++k) {
        const auto change = nodes.change[c.node[k]];
        kick += c.weight[k] * (change.kicked - change.before);
    }
    return 0.5 * dot(c.normal, kick);
}

// Target velocity along the normal after the substep, m/s; all nodes are known. With restitution: minus
// restitution times the velocity before, also for separating points (Moreau 1988, "Unilateral contact and dry
// friction in finite freedom dynamics"): with one coefficient for all, no impact then adds energy, whatever
// the number of constraints. Both at the time of the positions: including the kick, a ball would rise by (1 +
// e) g dt / (e v) too high.
double target_velocity(const AdvanceCall& call, const PreparedConstraint& c, double separation, double approach, ContactNodeSet& nodes) {
    const double closed = -std::max(separation, 0.0) / call.dt;
    const bool hits = c.restitution > 0 && approach < -kLeastBounce && separation + approach * call.dt < 0;
    if (!hits && !is_bounced_away(c, approach)) return closed;
    const double ahead = half_kick(c, nodes), back = ahead - c.restitution * (approach - ahead);
    return hits ? std::max(back, 0.0) : std::min(closed, back);
}

// Where position corrections act and separations are measured: at the projection or, if that is beside its
// triangle, at the point of the triangle with its clamped weights, so that corrections pull no corner.
// Measured elsewhere, two constraints of a vertex could undo more than each other's corrections.
void set_correction_weights(const ContactNodeSet& nodes, const ConstraintGeometry& r, const ClosestPoint& closest, PreparedConstraint& c) {
    std::copy_n(c.weight.begin(), c.nodes, c.correction_weight.begin());
    c.correction_offset = 0;
    if (c.rigid_b != kNone) return;
    std::array<double, 3> weight = closest.weight;
    const bool beside = *std::min_element(weight.begin(), weight.end()) < 0;
    if (beside) {
        for (double& w : weight) w = std::max(w, 0.0);
        const double sum = weight[0] + weight[1] + weight[2];
        for (double& w : weight) w /= sum;
    }
    Vec4d at = {};
    for (int k = 0; k < 3; ++k) at += weight[k] * field_at(nodes, c.node_b[k], &ContactNodes::position);
    c.correction_offset = dot(r.normal, at - r.plane);
    if (!beside) return;
    const auto first = c.node.begin() + c.point_nodes, last = c.node.begin() + c.nodes;
    std::fill(c.correction_weight.begin() + c.point_nodes, c.correction_weight.begin() + c.nodes, 0.0);
    for (int k = 0; k < 3; ++k)
        visit_nodes(nodes, c.node_b[k], [&](uint32_t node, double share) {
            const auto found = std::find(first, last, node);
            if (found != last) c.correction_weight[found - c.node.begin()] -= share * weight[k];
        });
}

// The side of a rigid body in a constraint: its node, if any, and the velocity of its motion relative to it.
// sign: + of the point.
void add_rigid_side(const AdvanceIsland& island, uint32_t rigid_index, Vec4d at, double sign, PreparedConstraint& c) {
    const AdvanceRigid& rigid = island.rigid[rigid_index];
    if (rigid.free == kNone)
        c.rigid_velocity += sign * rigid.velocity(at);
    else if (rigid.jaw != kNone)
        c.rigid_velocity += sign * rigid.grip_velocity(at);
    if (rigid.node != kNone) add_node(c, rigid.node, sign);
}

// Prepares a constraint for the substep. approach: m/s along the normal, before any impulse of the substep.
void set_substep(const AdvanceCall& call, const ConstraintGeometry& r, const ClosestPoint& closest, double approach, AdvanceIsland& island,
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
        for (int k = 0; k < 3; ++k) add_point(island.nodes, c.node_b[k], -closest.weight[k], c);
    } else {
        add_rigid_side(island, c.rigid_b, closest.point, -1, c);
    }
    double sum = 0;
    for (uint32_t k = 0; k < c.nodes; ++k) sum += c.weight[k] * c.weight[k] * island.nodes.node[c.node[k]].inv_mass;
    c.effective_mass = sum > 0 ? 1 / sum : 0;
    set_correction_weights(island.nodes, r, closest, c);
    c.target_velocity = target_velocity(call, c, r.separation, approach, island.nodes);
    if (island.free.empty() || !has_free_side(island, c)) return;
    // a free body rests in a thin band: separations of a micrometre among its constraints would let it rock
    // at 1 mm/s
    if (r.separation < kRestingGap && !is_bounced_away(c, approach)) c.target_velocity = std::max(c.target_velocity, 0.0);
    // both impulses act at one point, to keep angular momentum: the projection, fixed to the plane
    add_angular_parts(island, c.rigid_b == kNone ? closest.point : r.point, c);
}

// Activates a constraint in this substep; false if it has expired.
bool activate(const AdvanceCall& call, const ContactConstraints& constraints, ConstraintGeometry& r, Vec4d velocity, AdvanceIsland& island,
              PreparedConstraint& c) {
    const ClosestPoint closest = find_closest_point(call, island, constraints, c, r);
    c.ended = closest.expired;
    if (c.ended) return false;
    set_substep(call, r, closest, dot(r.normal, velocity), island, c);
    note_constraint(c, island.nodes);
    return true;
}

// Activates a constraint that is violated, or would be at the end of the substep. reach: m, see
// apply_impulses.
bool acts(const AdvanceCall& call, const ContactConstraints& constraints, double reach, AdvanceIsland& island, PreparedConstraint& c) {
    if (c.ended) return false;
    if (c.moved_plane) place_plane(call, island, constraints, c);
    ConstraintGeometry r = geometry_of(island, c);
    if (!(r.separation < reach)) return false;
    const Vec4d velocity = relative_velocity(island, c);
    const double separation_after = r.separation + std::min(dot(r.normal, velocity), 0.0) * call.dt;
    // a non-finite point belongs to a body about to be restored: it must not affect its neighbours
    if (!std::isfinite(separation_after + norm2(velocity))) return false;
    // a free body's constraint may become violated by an impulse at another of its constraints
    if (!(separation_after < 0) && (island.free.empty() || !has_free_side(island, c))) return false;
    return activate(call, constraints, r, velocity, island, c);
}

void find_active_constraints(const AdvanceCall& call, const ContactConstraints& constraints, double reach, ContactSolver& solver,
                             AdvanceIsland& island, ConstraintGroup& group) {
    group.active.clear();
    group.angular_count = 0;
    for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
        PreparedConstraint& c = solver.prepared[i];
        if (!acts(call, constraints, reach, island, c)) {
            c.warm = Vec4d{};
            continue;
        }
        group.active.push_back(i);
        group.angular_count += c.turns();
    }
}

// Brings one constraint to its target velocity by an impulse: see PreparedConstraint. kNodes: its number of
// nodes, 0 for any.
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
        const Vec4d friction = limit_friction(c.friction_impulse - sliding * c.effective_mass, most_friction(c, normal_impulse));
        impulse += friction - c.friction_impulse;
        c.friction_impulse = friction;
    }
    for (uint32_t k = 0; k < count; ++k) {
        const ContactNode node = nodes.node[c.node[k]];
        node.velocity += (c.weight[k] * node.inv_mass) * impulse;
    }
}

// Warm start: every constraint starts from its impulse of the preceding substep. Resting contacts are then
// solved at once, and one sweep per substep suffices for slow changes.
void warm_start_constraints(ContactSolver& solver, AdvanceIsland& island, ConstraintGroup& group) {
    warm_start_wide_constraints(group, solver, island.nodes);
    for (const uint32_t i : group.active) {
        PreparedConstraint& c = solver.prepared[i];
        c.normal_impulse = std::max(0.0, dot(c.warm, c.normal));
        if (c.normal_impulse == 0) continue;
        c.friction_impulse = c.warm - dot(c.warm, c.normal) * c.normal;
        give_impulse(c, c.normal_impulse * c.normal + c.friction_impulse, island);
    }
}

bool any_bounces(const ContactSolver& solver) {
    const auto bounces = [&](uint32_t i) { return solver.prepared[i].target_velocity > 0; };
    return std::ranges::any_of(std::span(solver.group).first(solver.colour[4]),
                               [&](const ConstraintGroup& g) { return std::ranges::any_of(g.active, bounces); });
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

// Writes the constraints' impulses to the particles: velocity and drift. Accounts for the work: a leapfrog
// kick does work at the mean of the velocities before and after it, all its impulses together; so does
// damping, for which the kernel used the velocity before the constraints.
void scatter_velocities(const AdvanceCall& call, AdvanceIsland& island, Particles& particles, AdvanceResult& result) {
    Particles& p = particles;
    const auto scatter = [&](uint32_t n, NodeSums& sums) {
        const ContactNode node = island.nodes.node[n];
        const ContactNodeChange change = island.nodes.change[n];
        const __m256d same = _mm256_cmp_pd((__m256d)node.velocity, (__m256d)change.kicked, _CMP_EQ_UQ);
        if (_mm256_movemask_pd(same) == 15 || node.particle == kNone || node.inv_mass == 0) return;
        if (island.body[node.owner].implicit_slot != kNone) {  // stepped with its impulses
            node.after = island.body[node.owner].origin +
                         float_vec4(_mm_load_ps(&island.body[node.owner].next[node.particle - island.body[node.owner].particles.first].x));
            return;
        }
        const __m128 velocity = _mm256_cvtpd_ps((__m256d)node.velocity);
        p.velocity_x[node.particle] = velocity[0];
        p.velocity_y[node.particle] = velocity[1];
        p.velocity_z[node.particle] = velocity[2];
        node.velocity = float_vec4(velocity);
        const Vec4d kick = node.velocity - change.kicked;
        move_particle(island.body[node.owner], node, call.dt * kick);
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

// The work of constraints on hands and scripted bodies.
void account_hands(const ContactSolver& solver, const AdvanceIsland& island, AdvanceResult& result) {
    double hand = 0;
    const auto is_held = [&](uint32_t rigid) {
        return rigid != kNone && island.rigid[rigid].free != kNone && island.free[island.rigid[rigid].free].held;
    };
    const auto is_driven = [&](uint32_t rigid) { return rigid != kNone && (island.rigid[rigid].free == kNone || is_held(rigid)); };
    const auto account = [&](const PreparedConstraint& c) {
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
    for (uint32_t g = 0; g < solver.colour[4]; ++g)
        for (const uint32_t i : solver.group[g].active) account(solver.prepared[i]);
    result.work_hand += hand;
    result.work_contact -= hand;
}

// Adds a constraint's impulse to a tool, if one of its rigid sides is a tool or a jaw of one.
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
    add_grip_moment(call, island, rigid, island.nodes.node[hit.node].position + arm, impulse, tools);
}

void add_impulses(const AdvanceCall& call, const AdvanceIsland& island, const ConstraintGroup& group, ContactSolver& solver,
                  std::span<ToolState> tools) {
    add_wide_impulses(group, solver);
    for (const uint32_t i : group.active) {
        PreparedConstraint& c = solver.prepared[i];
        const Vec4d impulse = c.normal_impulse * c.normal + c.friction_impulse;
        c.impulse += impulse;
        const double load = c.averaged ? c.load + c.load_share * c.normal_impulse : c.normal_impulse;
        c.load_share = next_load_share(c.load_share, solver.load_share);
        c.averaged = c.load_share == solver.load_share;
        c.load = (1 - c.load_share) * load;
        if (!solver.bounces) c.warm = impulse;
        add_tool_impulse(call, island, c, 0, impulse, tools);
        add_tool_impulse(call, island, c, 1, -impulse, tools);
    }
}

// Data of an owner, shared by its nodes.
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

// Splits a node's velocity change in this kick into damping and all else. Returns the work of the forces
// against the previous substep's position correction, J: energy is path-independent, and half the sum of the
// forces at that substep's start and after the correction is the force at its middle, seen half a substep
// back (exact for forces linear in position).
double note_kick(const KickOfBody& body, const ContactNode& node, const ContactNodeChange& change) {
    Vec4d drag = body.drag_velocity;
    if (body.shape) drag += cross(body.drag_turn, node.position - body.origin);
    const Vec4d lost = body.lost * (change.before - drag), before = change.acceleration;
    change.damped = change.before + lost;
    change.acceleration = (node.velocity - change.damped) / body.kick_dt;
    change.damped += body.kick_less * change.acceleration;
    return change.corrected ? dot(0.5 * (before + change.acceleration), change.change) / node.particle_inv_mass : 0;
}

// Nodes [begin, end), all of one owner, after kick and drift.
void gather_run(const AdvanceCall& call, const Particles& particles, size_t begin, size_t end, AdvanceIsland& island, NodeSums& sums) {
    const bool of_body = island.nodes.node.particle[begin] != kNone, later = call.substep > 0;
    const AdvanceBody* const body = of_body ? &island.body[island.nodes.node.owner[begin]] : nullptr;
    const bool accounting = call.params.account_energy && !(body && body->implicit_slot != kNone);
    const KickOfBody kick = of_body ? KickOfBody(*body) : KickOfBody(AdvanceBody{});
    const uint32_t first = of_body ? body->particles.first : 0;
    const Float4 *const now = of_body ? body->now : nullptr, *const next = of_body ? body->next : nullptr;
    for (size_t n = begin; n < end; ++n) {
        const ContactNode node = island.nodes.node[n];
        const ContactNodeChange change = island.nodes.change[n];
        if (of_body) {
            const uint32_t vertex = node.particle - first;
            if (later) change.before = node.velocity;
            node.position = kick.origin + float_vec4(_mm_load_ps(&now[vertex].x));
            node.after = kick.origin + float_vec4(_mm_load_ps(&next[vertex].x));
            node.velocity = particle_velocity(particles, node.particle);
            if (accounting) sums.work[0] += note_kick(kick, node, change);
        }
        change.kicked = node.velocity;
        change.change = Vec4d{};
        sums.fastest = greatest(node.velocity * node.velocity, sums.fastest);
        sums.total += node.velocity;
    }
    // in a loop of its own: after a byte store the compiler reloads all pointers
    std::fill(island.nodes.change.constraint_count.begin() + begin, island.nodes.change.constraint_count.begin() + end, 0);
    for (auto* flag : {&island.nodes.change.corrected, &island.nodes.change.conflicting})
        std::fill(flag->begin() + begin, flag->begin() + end, uint8_t{0});
}

// Nodes after kick and drift; accounts for the previous substep's position corrections. Returns a bound of
// their speeds, m/s; infinite if one is non-finite.
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
    if (std::isfinite(work)) result.work_push -= work;  // otherwise a body about to be restored
    const bool finite = std::isfinite(total[0] + total[1] + total[2]);
    return finite ? std::sqrt(most[0] + most[1] + most[2]) : std::numeric_limits<double>::infinity();
}

// Whether a hand presses tissue against something else on its other side.
bool hand_pinches(const ContactSolver& solver, const AdvanceIsland& island) {
    if (island.rigid.size() + island.body.size() < 3) return false;
    const auto is_hand = [&](uint32_t rigid) { return rigid != kNone && island.rigid[rigid].tool != kNone; };
    const auto any_active = [&](const auto& test) {
        return std::any_of(solver.group.begin(), solver.group.begin() + solver.colour[4], [&](const ConstraintGroup& group) {
            return std::ranges::any_of(group.active, [&](uint32_t i) { return test(solver.prepared[i]); });
        });
    };
    const auto presses = [](const PreparedConstraint& c, uint32_t node) {
        return std::find(c.node.begin(), c.node.begin() + c.nodes, node) != c.node.begin() + c.nodes;
    };
    return any_active([&](const PreparedConstraint& c) {
        const uint32_t hand = is_hand(c.rigid_a) ? c.rigid_a : c.rigid_b;
        return is_hand(hand) && std::any_of(c.node.begin(), c.node.begin() + c.nodes, [&](uint32_t node) {
                   return island.nodes.change.conflicting[node] && island.nodes.node[node].particle != kNone &&
                          any_active([&](const PreparedConstraint& other) {
                              return other.rigid_a != hand && other.rigid_b != hand && presses(other, node);
                          });
               });
    });
}

}  // namespace

double solve_constraint(AdvanceIsland& island, PreparedConstraint& c) {
    if (c.turns()) return solve_angular_constraint(island, c);
    c.nodes == 4 ? solve_nodes<4>(island.nodes, c) : solve_nodes<0>(island.nodes, c);
    return 0;
}

void prepare_constraint(const AdvanceCall& call, const ContactSolver& solver, uint32_t constraint, AdvanceIsland& island,
                        const AdvanceState& state, PreparedConstraint& c) {
    const ContactConstraints& constraints = state.constraints;
    const Bodies& bodies = call.inputs.bodies;
    const Meshes& meshes = call.inputs.meshes;
    const uint32_t a = constraints.body[constraint], b = constraints.other[constraint];
    c.constraint = constraint;
    c.rigid_a = c.rigid_b = kNone;
    c.offset = c.restitution = 0;
    c.moved_plane = false;
    c.angular.free = {kNone, kNone};
    const bool in_face = constraints.third[constraint] != kNone;
    c.weight_a = {1.0 - constraints.along[constraint] - constraints.across[constraint], constraints.along[constraint],
                  constraints.across[constraint]};
    c.weight_b = {constraints.weight[constraint][0], constraints.weight[constraint][1], constraints.weight[constraint][2]};
    c.plane = to_vec4(constraints.normal[constraint]);
    c.impulse = Vec4d{};
    c.warm = solver.starts_warm ? warm_start_impulse(call, state.constraints, constraint) : Vec4d{};
    c.friction_coefficient = constraints.friction[constraint];
    c.ended = std::isinf(constraints.distance[constraint]);
    if (is_deformable(bodies, a)) {
        TROCAR_ASSERT(island.slot_of_body[a] != kNone);
        const auto& vertex = constraints.vertex[constraint];
        c.node_a[0] = vertex_slot(island.slot_of_body[a], vertex[0], island);
        c.node_a[1] = vertex[1] == vertex[0] ? c.node_a[0] : vertex_slot(island.slot_of_body[a], vertex[1], island);
        c.node_a[2] = in_face ? vertex_slot(island.slot_of_body[a], constraints.third[constraint], island) : c.node_a[0];
    } else {
        c.rigid_a = rigid_slot(call, a, island, state);
        c.point_a = c.weight_a[0] * rest_position(meshes, bodies.mesh[a], constraints.vertex[constraint][0]) +
                    c.weight_a[1] * rest_position(meshes, bodies.mesh[a], constraints.vertex[constraint][1]);
        if (in_face) c.point_a += c.weight_a[2] * rest_position(meshes, bodies.mesh[a], constraints.third[constraint]);
    }
    if (is_deformable(bodies, b)) {
        TROCAR_ASSERT(island.slot_of_body[b] != kNone);
        for (int i = 0; i < 3; ++i) c.node_b[i] = vertex_slot(island.slot_of_body[b], constraints.triangle[constraint][i], island);
    } else {
        c.rigid_b = rigid_slot(call, b, island, state);
        place_plane(call, island, constraints, c);
    }
    const Vec4d normal = c.rigid_b == kNone ? c.plane : island.rigid[c.rigid_b].pose[0].turn(c.plane);
    const double load = std::max(0.0, dot(c.warm, normal));
    c.load_share = load > 0 ? solver.load_share : 1;
    c.averaged = c.load_share == solver.load_share;
    c.load = (1 - c.load_share) * load;
    if (c.rigid_a != kNone && c.rigid_b != kNone) {
        c.restitution = std::max(bodies.tissue[a].restitution, bodies.tissue[b].restitution);
    }
    if (meshes.info[bodies.mesh[b]].admission == Admission::kSheet) c.offset = 0.5 * bodies.thickness[b];
    if (const double gap = gap_of(constraints, constraint); gap > 0) c.offset = gap;
    c.offset += left_overlap(call, constraints, constraint);
}

void prepare_contacts(const AdvanceCall& call, std::span<const uint32_t> island_constraints, ContactSorting& sorting, ContactSolver& solver,
                      AdvanceIsland& island, const AdvanceState& state) {
    island.nodes.embedded_point.clear();
    island.nodes.node_of_particle.resize(state.particles.offset.size(), kNone);
    // neighbours in the list share nodes: parts of a long list are interleaved, so that the processor works
    // on one constraint while another waits for its sums; a short list converges better in order
    const uint32_t count = static_cast<uint32_t>(island_constraints.size());
    const size_t nodes = island.nodes.node.size() + 2 * count;
    if (island.nodes.node.capacity() < nodes) island.nodes.node.reserve(2 * nodes), island.nodes.change.reserve(2 * nodes);
    make_room(sorting.order, count);
    make_room(sorting.ungrouped, count);
    const uint32_t parts = std::clamp(count / kConstraintsPerPart, 1u, kMostParts), part = (count + parts - 1) / parts;
    sorting.order.clear();
    for (uint32_t i = 0; i < part; ++i)
        for (uint32_t k = i; k < count; k += part) sorting.order.push_back(island_constraints[k]);
    number_nodes(call, sorting, island_constraints, island, state);
    solver.starts_warm = may_start_warm(call, island);
    solver.load_share = solver.starts_warm ? -std::expm1(-call.dt / kFrictionLag) : 1;
    colour_constraints(call, island, state.constraints, sorting, solver);
    prepare_wide_constraints(call, sorting, solver, island, state);
    for (uint32_t g = 0; g < solver.colour[4]; ++g) make_room(solver.group[g].active, solver.group[g].prepared.count);
}

void release_contacts(const AdvanceCall& call, const ContactSolver& solver, AdvanceIsland& island, ContactConstraints& constraints,
                      AdvanceResult& result) {
    const bool carries = solver.starts_warm && !constraints.warm_start.empty();
    for (const PreparedConstraint& c : solver.prepared) {
        constraints.impulse[c.constraint] += to_vec3(c.impulse);
        if (c.ended) expire_constraint(c.constraint, constraints, result);
        if (carries) constraints.warm_start[c.constraint] = to_vec3(c.warm / call.dt);
    }
    release_wide_constraints(call, solver, constraints, result);
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

void apply_impulses(const AdvanceCall& call, ContactComponents& components, TissueScratch& tissue, ContactSolver& solver,
                    AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result) {
    const bool implicit = has_touched_implicit(island);
    const double fastest = gather_nodes(call, state.particles, island, result) + fastest_rigid(call, island);
    // most constraints are too far away at any velocity: no separation shrinks faster than twice `fastest`
    const double reach = 2.001 * fastest * call.dt;
    for_each_group(solver, [&](ConstraintGroup& group) {
        activate_wide_constraints(call, state, island.nodes, reach, solver, group);
        find_active_constraints(call, state.constraints, reach, solver, island, group);
        if (solver.starts_warm && !implicit) warm_start_constraints(solver, island, group);
    });
    for (uint32_t g = 0; g < solver.colour[4]; ++g)
        result.active_constraints += solver.group[g].active.size() + solver.group[g].active_lanes;
    solver.bounces = !island.free.empty() && any_bounces(solver);
    const auto is_free = [](const AdvanceFree& f) { return !f.held; };
    if (implicit) {
        solve_with_implicit(call, tissue, solver, island, state, result);
    } else if (any_angular(solver) && std::any_of(island.free.begin(), island.free.end(), is_free)) {
        solve_to_convergence(call, components, solver, island, result);
    } else if (any_angular(solver)) {
        // a tool in the hand does not rest on its contacts: the next substep continues from the remaining
        // error
        for (uint32_t iteration = 0; iteration < std::max(call.params.contact.iterations, kHeldSweeps); ++iteration)
            for_each_group(solver, [&](ConstraintGroup& group) {
                solve_wide_constraints(group, solver, island.nodes);
                for (const uint32_t i : group.active) solve_constraint(island, solver.prepared[i]);
            });
    } else {
        const uint32_t least = hand_pinches(solver, island) ? kPinchedSweeps : island.nodes.embedded_point.empty() ? 1 : kEmbeddedSweeps;
        const uint32_t sweeps = std::max(call.params.contact.iterations, least);
        for (uint32_t iteration = 0; iteration < sweeps; iteration += kSweepsAtOnce) {
            for_each_group(solver, [&](ConstraintGroup& group) {
                for (uint32_t sweep = iteration; sweep < std::min(sweeps, iteration + kSweepsAtOnce); ++sweep) {
                    solve_wide_constraints(group, solver, island.nodes);
                    for (const uint32_t i : group.active) solve_constraint(island, solver.prepared[i]);
                }
            });
        }
    }
    scatter_velocities(call, island, state.particles, result);
    if (call.params.account_energy && !island.rigid.empty()) account_hands(solver, island, result);
    for_each_group(solver, [&](const ConstraintGroup& group) { add_impulses(call, island, group, solver, state.tools); });
}

}  // namespace trocar
