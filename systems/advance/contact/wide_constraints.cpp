#include "systems/advance/contact/wide_constraints.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include "engine/base/check.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/surface_walk.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/advance/contact/contact_impulses.hpp"
#include "systems/advance/contact/implicit_contacts.hpp"
#include "systems/advance/contact/position_correction.hpp"
#include "systems/advance/island/constants.hpp"
namespace trocar {
namespace {

constexpr uint32_t kParts = WideConstraint::kParts;
constexpr uint32_t kWidePerChunk = 512;

// Nodes of a constraint that may become a lane of a wide one.
struct ConstraintNodes {
    std::array<uint32_t, kParts> node;
    uint32_t count = 0;
};
ConstraintNodes nodes_of(const ConstraintKey& key) {
    ConstraintNodes r;
    for (uint32_t part = 0; part < kParts; ++part)
        if (key.node[part] != kNone) r.node[r.count++] = key.node[part];
    return r;
}
bool are_distinct(const ConstraintNodes& nodes) {
    for (uint32_t i = 0; i < nodes.count; ++i)
        for (uint32_t k = 0; k < i; ++k)
            if (nodes.node[i] == nodes.node[k]) return false;
    return true;
}

// Whether a constraint's side does not move during the whole call. Short lists with static bodies stay in
// order.
bool is_fixed(const AdvanceCall& call, const ContactSorting& sorting, uint32_t body) {
    return sorting.static_planes && call.inputs.bodies.motion[body] == Motion::kStatic;
}

// World direction of a constraint's normal.
Vec4d direction_of(const AdvanceCall& call, const AdvanceIsland& island, const ContactConstraints& constraints, uint32_t constraint) {
    const Vec4d normal = to_vec4(constraints.normal[constraint]);
    const uint32_t other = constraints.other[constraint];
    return is_deformable(call.inputs.bodies, other) ? normal : island.rigid[island.slot_of_body[other]].pose[0].turn(normal);
}

bool fits_wide(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island, const ContactConstraints& constraints,
               uint32_t constraint, const ConstraintKey& key) {
    const Bodies& bodies = call.inputs.bodies;
    const uint32_t point = constraints.body[constraint], plane = constraints.other[constraint];
    if (constraints.third[constraint] != kNone || !is_deformable(bodies, point))
        return false;  // wide constraints have no part for a third corner
    const AdvanceBody& body = island.body[island.slot_of_body[point]];
    if (body.embedding_node) return false;  // its vertices are not nodes
    if (is_deformable(bodies, plane) ? island.body[island.slot_of_body[plane]].embedding_node != nullptr
                                     : !is_fixed(call, sorting, plane)) {
        return false;
    }
    return are_distinct(nodes_of(key));
}

// Edge points are separate, as their wide constraints have one more part; so are constraints that start
// outside, most of which stay inactive; and those with fixed planes, whose kinds are last.
constexpr uint8_t kFixedPlane = 3, kKinds = 6;
ConstraintKey make_key(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island,
                       const ContactConstraints& constraints, uint32_t constraint) {
    const Bodies& bodies = call.inputs.bodies;
    ConstraintKey key;
    key.node.fill(kNone);
    const auto put = [&](uint32_t part, const AdvanceBody& body, uint32_t vertex) {
        if (!body.embedding_node) key.node[part] = island.nodes.node_of_particle[body.particles.first + vertex];
    };
    const bool edge = constraints.vertex[constraint][1] != constraints.vertex[constraint][0];
    if (is_deformable(bodies, constraints.body[constraint])) {
        const AdvanceBody& body = island.body[island.slot_of_body[constraints.body[constraint]]];
        put(0, body, constraints.vertex[constraint][0]);
        if (edge) put(1, body, constraints.vertex[constraint][1]);
        if (constraints.third[constraint] != kNone) put(5, body, constraints.third[constraint]);
    }
    const bool plane_moves = is_deformable(bodies, constraints.other[constraint]);
    for (uint32_t k = 0; plane_moves && k < 3; ++k)
        put(2 + k, island.body[island.slot_of_body[constraints.other[constraint]]], constraints.triangle[constraint][k]);
    const int kind = edge ? 1 : std::signbit(constraints.distance[constraint]) ? 0 : 2;
    key.kind = fits_wide(call, sorting, island, constraints, constraint, key) ? static_cast<uint8_t>(kind + (plane_moves ? 0 : kFixedPlane))
                                                                              : ConstraintKey::kSingle;
    return key;
}

// A group's constraints are scattered in memory.
void fetch_direction(const ContactConstraints& constraints, uint32_t constraint) {
    __builtin_prefetch(&constraints.other[constraint]);
    __builtin_prefetch(&constraints.normal[constraint]);
}
void fetch_sides(const ContactConstraints& constraints, uint32_t constraint) {
    __builtin_prefetch(&constraints.body[constraint]);
    __builtin_prefetch(&constraints.other[constraint]);
    __builtin_prefetch(&constraints.vertex[constraint]);
    __builtin_prefetch(&constraints.third[constraint]);
    __builtin_prefetch(&constraints.triangle[constraint]);
    __builtin_prefetch(&constraints.distance[constraint]);
}
void fetch_constraint(const ContactConstraints& constraints, uint32_t constraint) {
    fetch_sides(constraints, constraint);
    __builtin_prefetch(&constraints.along[constraint]);
    __builtin_prefetch(&constraints.weight[constraint]);
    __builtin_prefetch(&constraints.normal[constraint]);
    __builtin_prefetch(&constraints.friction[constraint]);
    if (!constraints.warm_start.empty()) __builtin_prefetch(&constraints.warm_start[constraint]);
}

// Calls visit(node, direction of a constraint that presses it, key index), group by group.
template <typename Visit>
void for_each_direction(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island,
                        const ContactConstraints& constraints, ContactSolver& solver, const Visit& visit) {
    for_each_group(solver, [&](ConstraintGroup& group) {
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
            if (i + kConstraintsAhead < group.prepared.end()) fetch_direction(constraints, sorting.order[i + kConstraintsAhead]);
            const Vec4d direction = direction_of(call, island, constraints, sorting.order[i]), back = -direction;
            const auto& node = sorting.key[i].node;
            for (const uint32_t part : {0, 1, 5, 2, 3, 4})
                if (node[part] != kNone) visit(node[part], part < 2 || part == 5 ? direction : back, i);
        }
    });
}

// Planes of rigid bodies may rotate.
bool may_turn(const AdvanceCall& call, const ContactSorting& sorting, const ContactConstraints& constraints, uint32_t constraint) {
    const Bodies& bodies = call.inputs.bodies;
    for (const uint32_t body : {constraints.body[constraint], constraints.other[constraint]})
        if (!is_deformable(bodies, body) && !is_fixed(call, sorting, body)) return true;
    return false;
}

// Finds the nodes that no two constraints of the call can press from opposite sides: all directions lie
// within 60 degrees of their mean. Constraints of other nodes, and of planes that may rotate, stay scalar.
void find_conflicting_nodes(const AdvanceCall& call, const ContactConstraints& constraints, ContactSorting& sorting, ContactSolver& solver,
                            AdvanceIsland& island) {
    RawVector<Vec4d>& sum =
        island.nodes.change.displacement;  // of the directions of all constraints that press a node; valid until the first substep
    parallel_for(uint32_t(island.nodes.node.size()), kNodesPerChunk,
                 [&](uint32_t begin, uint32_t end) { std::fill(sum.begin() + begin, sum.begin() + end, Vec4d{}); });
    sorting.may_conflict.assign(island.nodes.node.size(), 0);
    for_each_direction(call, sorting, island, constraints, solver,
                       [&](uint32_t node, Vec4d direction, uint32_t) { sum[node] += direction; });
    for_each_direction(call, sorting, island, constraints, solver, [&](uint32_t node, Vec4d direction, uint32_t i) {
        const double along = dot(sum[node], direction);
        const bool leans = !(along > 0 && along * along >= kLean * kLean * norm2(sum[node]));
        if (leans || may_turn(call, sorting, constraints, sorting.order[i])) sorting.may_conflict[node] = 1;
    });
    for_each_group(solver, [&](ConstraintGroup& group) {
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
            const auto& node = sorting.key[i].node;
            if (std::any_of(node.begin(), node.end(), [&](uint32_t n) { return n != kNone && sorting.may_conflict[n]; }))
                sorting.key[i].kind = ConstraintKey::kSingle;
        }
    });
}

// Without particle or mass: target of lanes without a constraint and of vertices without a second end.
uint32_t add_massless_node(ContactNodeSet& nodes) {
    add_node(nodes);
    return static_cast<uint32_t>(nodes.node.size()) - 1;
}

// Skips fields that activate writes before they are read.
void clear_wide(uint32_t massless_node, WideConstraint& wide_constraint) {
    for (auto& nodes : wide_constraint.node) nodes.fill(massless_node);
    wide_constraint.weight.fill({});
    wide_constraint.normal = wide_constraint.impulse = wide_constraint.friction_impulse = FourPoints{};
    wide_constraint.offset = wide_constraint.normal_impulse = Vec4d{};
    wide_constraint.along = wide_constraint.friction = wide_constraint.load = wide_constraint.load_share = {};
    wide_constraint.constraint.fill(kNone);
    wide_constraint.open = 0;
    wide_constraint.edges = false;
    wide_constraint.fixed = kNone;
}

void put_fixed_triangle(const AdvanceCall& call, const AdvanceIsland& island, const ContactConstraints& constraints, uint32_t constraint,
                        uint32_t lane, ContactSolver& solver, WideConstraint& wide_constraint) {
    const uint32_t other = constraints.other[constraint];
    const RigidMap& pose = island.rigid[island.slot_of_body[other]].pose[0];
    const Meshes& meshes = call.inputs.meshes;
    const uint32_t first = meshes.info[call.inputs.bodies.mesh[other]].vertices.first;
    for (uint32_t k = 0; k < 3; ++k) {
        const Vec4d corner = to_vec4(meshes.position[first + constraints.triangle[constraint][k]]);
        set_lane(solver.fixed[wide_constraint.fixed].corner[k], lane, pose(corner));
        wide_constraint.weight[k].lane[lane] = constraints.weight[constraint][k];
    }
    set_lane(wide_constraint.normal, lane, pose.turn(to_vec4(constraints.normal[constraint])));
}

// As prepare_constraint, for one that fits_wide.
void put_constraint(const AdvanceCall& call, const AdvanceIsland& island, const ContactConstraints& constraints, uint32_t constraint,
                    const ConstraintKey& key, ContactSolver& solver, WideConstraint& wide_constraint) {
    const uint32_t lane = key.lane;
    const auto put = [&](uint32_t part) { wide_constraint.node[part][lane] = key.node[part]; };
    put(0);
    if (key.node[1] != kNone) {
        put(1);
        wide_constraint.along.lane[lane] = constraints.along[constraint];
        wide_constraint.edges = true;
    }
    if (key.node[2] != kNone) {
        for (uint32_t k = 0; k < 3; ++k) put(2 + k), wide_constraint.weight[k].lane[lane] = constraints.weight[constraint][k];
        set_lane(wide_constraint.normal, lane, to_vec4(constraints.normal[constraint]));
    } else {
        put_fixed_triangle(call, island, constraints, constraint, lane, solver, wide_constraint);
    }
    const Bodies& bodies = call.inputs.bodies;
    const uint32_t other = constraints.other[constraint];
    if (call.inputs.meshes.info[bodies.mesh[other]].admission == Admission::kSheet)
        wide_constraint.offset[lane] = 0.5 * bodies.thickness[other];
    if (const double gap = gap_of(constraints, constraint); gap > 0) wide_constraint.offset[lane] = gap;
    wide_constraint.offset[lane] += left_overlap(call, constraints, constraint);
    wide_constraint.friction.lane[lane] = constraints.friction[constraint];
    wide_constraint.constraint[lane] = constraint;
    if (!std::isinf(constraints.distance[constraint])) wide_constraint.open |= uint8_t(1u << lane);
    const Vec4d start = warm_start_impulse(call, constraints, constraint), normal = lane_of(wide_constraint.normal, lane);
    wide_constraint.normal_impulse[lane] = std::max(0.0, dot(start, normal));
    const double share = wide_constraint.normal_impulse[lane] > 0 ? solver.load_share : 1;
    wide_constraint.load_share.lane[lane] = static_cast<float>(share);
    wide_constraint.load.lane[lane] = static_cast<float>((1 - share) * wide_constraint.normal_impulse[lane]);
    if (wide_constraint.normal_impulse[lane] > 0) set_lane(wide_constraint.friction_impulse, lane, start - dot(start, normal) * normal);
}

// Part of a wide constraint that a loop reads, bytes.
struct WidePart {
    size_t first, end;
};
constexpr WidePart kWholeConstraint = {0, sizeof(WideConstraint)};
constexpr WidePart kSeparationPart = {offsetof(WideConstraint, along), offsetof(WideConstraint, effective_mass)};
constexpr WidePart kSweepPart = {offsetof(WideConstraint, node), offsetof(WideConstraint, impulse)};
constexpr WidePart kSumPart = {offsetof(WideConstraint, normal_impulse), sizeof(WideConstraint)};

inline __attribute__((always_inline)) void fetch(const WideConstraint& wide_constraint, WidePart part) {
    constexpr size_t kLine = 64;
    const char* start = reinterpret_cast<const char*>(&wide_constraint);
    for (size_t byte = part.first; byte < part.end; byte += kLine) __builtin_prefetch(start + byte);
    __builtin_prefetch(start + part.end - 1);
}

// Calls run(wide) for the active wide constraints of a group in order, prefetching a later one: they are far
// apart in memory.
template <typename Run>
inline __attribute__((always_inline)) void for_active_wide(const ConstraintGroup& group, WidePart part, ContactSolver& solver,
                                                           const Run& run) {
    const std::vector<uint32_t>& active = group.active_wide;
    for (size_t i = 0; i < active.size(); ++i) {
        if (i + kWideAhead < active.size()) fetch(solver.wide_constraint[active[i + kWideAhead]], part);
        run(solver.wide_constraint[active[i]]);
    }
}

// Packs a group's constraints into wide ones: each into the first open one that has none of its nodes.
class WidePacker {
 public:
    // open: per node, which of the unfinished wide constraints contain it.
    explicit WidePacker(std::vector<uint16_t>& open) : open_(open) { wide_.fill(kNone); }
    void add(ConstraintKey& key) {
        const ConstraintNodes nodes = nodes_of(key);
        uint32_t shared = 0;
        for (uint32_t k = 0; k < nodes.count; ++k) shared |= open_[nodes.node[k]];
        uint32_t slot = uint32_t(std::countr_one(shared));
        if (slot >= kOpenWide) close(slot = next_ = (next_ + 1) % kOpenWide);
        if (wide_[slot] == kNone) wide_[slot] = count_++;
        key.wide = wide_[slot];
        key.lane = static_cast<uint8_t>(members_[slot].count);
        members_[slot].nodes[members_[slot].count++] = nodes;
        for (uint32_t k = 0; k < nodes.count; ++k) open_[nodes.node[k]] |= uint16_t(1u << slot);
        if (members_[slot].count == 4) close(slot);
    }
    void close_all() {
        for (uint32_t slot = 0; slot < kOpenWide; ++slot) {
            if (wide_[slot] != kNone) close(slot);
        }
    }
    uint32_t count() const { return count_; }

 private:
    void close(uint32_t slot) {
        for (uint32_t i = 0; i < members_[slot].count; ++i) {
            const ConstraintNodes& nodes = members_[slot].nodes[i];
            for (uint32_t k = 0; k < nodes.count; ++k) open_[nodes.node[k]] &= uint16_t(~(1u << slot));
        }
        wide_[slot] = kNone;
        members_[slot].count = 0;
    }
    struct Members {
        std::array<ConstraintNodes, 4> nodes;
        uint32_t count = 0;
    };
    std::vector<uint16_t>& open_;
    std::array<uint32_t, kOpenWide> wide_;    // per slot: index in the group, or kNone
    std::array<Members, kOpenWide> members_;  // and the wide constraint
    uint32_t count_ = 0;
    uint32_t next_ = 0;  // slot to close if none fits
};

// One field of ContactNodes for the nodes of one part of a wide constraint.
inline __attribute__((always_inline)) FourPoints part_of(const ContactNodeSet& nodes, const WideConstraint& wide_constraint, uint32_t part,
                                                         RawVector<Vec4d> ContactNodes::*field) {
    const auto& n = wide_constraint.node[part];
    const Vec4d* value = (nodes.node.*field).data();
    return side_by_side(value[n[0]], value[n[1]], value[n[2]], value[n[3]]);
}
inline __attribute__((always_inline)) Vec4d inv_mass_of(const ContactNodeSet& nodes, const WideConstraint& wide_constraint, uint32_t part) {
    const auto& n = wide_constraint.node[part];
    const double* value = nodes.node.inv_mass.data();
    return Vec4d{value[n[0]], value[n[1]], value[n[2]], value[n[3]]};
}
inline __attribute__((always_inline)) FourPoints point_of(const ContactNodeSet& nodes, const WideConstraint& wide_constraint,
                                                          RawVector<Vec4d> ContactNodes::*field) {
    const FourPoints first = part_of(nodes, wide_constraint, 0, field);
    if (!wide_constraint.edges) return first;
    const Vec4d along = wide(wide_constraint.along);
    return (1 - along) * first + along * part_of(nodes, wide_constraint, 1, field);
}
inline __attribute__((always_inline)) FourPoints weighted(const std::array<Vec4d, 3>& w, const FourPoints& a, const FourPoints& b,
                                                          const FourPoints& c) {
    return w[0] * a + w[1] * b + w[2] * c;
}
inline __attribute__((always_inline)) std::array<Vec4d, 3> corner_weights(const WideConstraint& wide_constraint) {
    return {wide(wide_constraint.weight[0]), wide(wide_constraint.weight[1]), wide(wide_constraint.weight[2])};
}
inline __attribute__((always_inline)) FourPoints plane_of(const ContactNodeSet& nodes, const WideConstraint& wide_constraint,
                                                          RawVector<Vec4d> ContactNodes::*field) {
    return weighted(corner_weights(wide_constraint), part_of(nodes, wide_constraint, 2, field), part_of(nodes, wide_constraint, 3, field),
                    part_of(nodes, wide_constraint, 4, field));
}
// Corners of the planes: their positions, or those after the substep.
inline __attribute__((always_inline)) FourPoints corner_of(const ContactSolver& solver, const ContactNodeSet& nodes,
                                                           const WideConstraint& wide_constraint, uint32_t k,
                                                           RawVector<Vec4d> ContactNodes::*field) {
    return wide_constraint.fixed == kNone ? part_of(nodes, wide_constraint, 2 + k, field) : solver.fixed[wide_constraint.fixed].corner[k];
}
// Parts that move: all, or those of the point.
inline uint32_t parts_of(const WideConstraint& wide_constraint) { return wide_constraint.fixed == kNone ? kParts : 2; }

// As find_closest_point for one constraint: weights of the corners, and which constraints have expired.
struct FourClosestPoints {
    std::array<Vec4d, 3> weight;
    Mask4 expired;
};
FourClosestPoints find_closest_points(const FourPoints& a, const FourPoints& b, const FourPoints& c, const FourPoints& point,
                                      const FourPoints& plane, const FourPoints& normal, const std::array<Vec4d, 3>& fixed) {
    const FourPoints u = b - a, v = c - a, twice_area = cross(u, v);
    const Vec4d edge2[3] = {norm2(c - b), norm2(v), norm2(u)};  // opposite corner k
    const Vec4d longest2 = greatest(edge2[0], greatest(edge2[1], edge2[2]));
    const Vec4d area2 = norm2(twice_area), along = dot(normal, twice_area);
    const Mask4 near = (along > 0) & (along * along > (kLeastCosine * kLeastCosine) * area2) & (area2 > 1e-12 * longest2 * longest2);
    const FourPoints apart = point - plane, slide = apart - dot(normal, apart) * normal;
    const Mask4 slid = norm2(slide) > longest2;

    const FourPoints q = point - (dot(point - a, twice_area) / along) * normal - a;
    const Vec4d per_area2 = 1 / area2;
    const Vec4d w1 = dot(q, cross(v, twice_area)) * per_area2, w2 = dot(q, cross(twice_area, u)) * per_area2;
    const std::array<Vec4d, 3> weight = {1 - w1 - w2, w1, w2};
    FourClosestPoints closest;
    Mask4 beyond = {};
    for (int k = 0; k < 3; ++k) {
        const Vec4d w = weight[k];
        beyond |= (w < 0) & (w * w * area2 > longest2 * edge2[k]);  // see find_closest_point
        closest.weight[k] = near ? w : fixed[k];
    }
    closest.expired = near ? beyond : slid;
    return closest;
}

// Weight of a part in the relative velocity: + for the point, - for its projection; 0 if inactive.
template <bool kEdges>
inline __attribute__((always_inline)) Vec4d lever_of(const WideConstraint& wide_constraint, Mask4 active, uint32_t part) {
    if (part >= 2) return wide_constraint.plane_weight[part - 2];
    if (!kEdges) return keep(active, all_lanes(part == 0 ? 1 : 0));
    return keep(active, part == 0 ? 1 - wide(wide_constraint.along) : wide(wide_constraint.along));
}
inline __attribute__((always_inline)) Vec4d lever_of(const WideConstraint& wide_constraint, Mask4 active, uint32_t part) {
    return wide_constraint.edges ? lever_of<true>(wide_constraint, active, part) : lever_of<false>(wide_constraint, active, part);
}

// As set_correction_weights: weights of the corners in position corrections, negative; 0 if inactive.
inline __attribute__((always_inline)) std::array<Vec4d, 3> correction_weights_of(const WideConstraint& wide_constraint, Mask4 active) {
    std::array<Vec4d, 3> plane_weight;
    for (uint32_t k = 0; k < 3; ++k) plane_weight[k] = least(wide_constraint.plane_weight[k], Vec4d{});
    const Vec4d scale = keep(active, -1 / (plane_weight[0] + plane_weight[1] + plane_weight[2]));
    for (uint32_t k = 0; k < 3; ++k) plane_weight[k] *= scale;
    return plane_weight;
}

// Whether a point that has left a constraint's triangle is still over the same plane of a static body.
bool continues_flat(const AdvanceCall& call, const AdvanceState& state, uint32_t constraint, Vec4d point) {
    const Bodies& bodies = call.inputs.bodies;
    const uint32_t other = state.constraints.other[constraint];
    if (is_deformable(bodies, other)) return false;
    const Vec3d in_frame = rotate_back(state.poses.orientation[other], to_vec3(point) - state.poses.origin[other]);
    return walk_surface(mesh_view(call.inputs.meshes, bodies.mesh[other]), state.constraints.triangle[constraint],
                        state.constraints.normal[constraint], in_frame)
               .normal == state.constraints.normal[constraint];
}

// Activates the constraints that act in this substep. As find_active_constraints and activate.
bool activate_wide_constraint(const AdvanceCall& call, const AdvanceState& state, const ContactSolver& solver, const ContactNodeSet& nodes,
                              double reach, WideConstraint& wide_constraint) {
    const FourPoints a = corner_of(solver, nodes, wide_constraint, 0, &ContactNodes::position),
                     b = corner_of(solver, nodes, wide_constraint, 1, &ContactNodes::position),
                     c = corner_of(solver, nodes, wide_constraint, 2, &ContactNodes::position);
    const std::array<Vec4d, 3> fixed = corner_weights(wide_constraint);
    const FourPoints point = point_of(nodes, wide_constraint, &ContactNodes::position), plane = weighted(fixed, a, b, c);
    const Vec4d separation = dot(wide_constraint.normal, point - plane) - wide_constraint.offset;
    Mask4 active = mask_lanes(wide_constraint.open) & (separation < reach);
    if (!any(active)) return false;
    // inside points act at any finite velocity
    if (!std::isfinite(reach) || any(active & (separation >= 0))) {
        FourPoints velocity = point_of(nodes, wide_constraint, &ContactNodes::velocity);
        if (wide_constraint.fixed == kNone) velocity = velocity - plane_of(nodes, wide_constraint, &ContactNodes::velocity);
        const Vec4d separation_after = separation + least(dot(wide_constraint.normal, velocity), Vec4d{}) * call.dt;
        const Vec4d all = separation_after + norm2(velocity);  // non-finite if either is
        active &= (separation_after < 0) & (all - all == 0);
        if (!any(active)) return false;
    }
    const FourClosestPoints closest = find_closest_points(a, b, c, point, plane, wide_constraint.normal, fixed);
    if (any(closest.expired & active)) {
        for (uint32_t lane = 0; lane < 4; ++lane)
            if ((closest.expired & active)[lane] && !continues_flat(call, state, wide_constraint.constraint[lane], lane_of(point, lane)))
                wide_constraint.open &= uint8_t(~(1u << lane));
        active &= mask_lanes(wide_constraint.open);
        if (!any(active)) return false;
    }
    wide_constraint.active = static_cast<uint8_t>(mask_bits(active));
    for (uint32_t k = 0; k < 3; ++k) wide_constraint.plane_weight[k] = keep(active, -closest.weight[k]);
    wide_constraint.correction_weight = correction_weights_of(wide_constraint, active);
    wide_constraint.rest =
        -dot(wide_constraint.normal, weighted(wide_constraint.correction_weight, a, b, c) + plane) - wide_constraint.offset;
    Vec4d sum = {};
    for (uint32_t k = 0; k < kParts; ++k) {
        const Vec4d lever = lever_of(wide_constraint, active, k), inv_mass = inv_mass_of(nodes, wide_constraint, k);
        sum += lever * lever * inv_mass;
        wide_constraint.response[k] = lever * inv_mass;
    }
    wide_constraint.effective_mass = keep(active & (sum > 0), 1 / sum);
    wide_constraint.target_velocity = keep(active, -greatest(separation, Vec4d{}) / call.dt);
    // of the preceding substep: warm_start_wide_constraints
    const Mask4 warm = solver.starts_warm ? active : Mask4{};
    wide_constraint.normal_impulse = keep(warm, wide_constraint.normal_impulse);
    wide_constraint.friction_impulse = keep(warm, wide_constraint.friction_impulse);
    return true;
}

// Adds to a field of the nodes of one part.
void add_to_part(const WideConstraint& wide_constraint, uint32_t part, const FourPoints& change, RawVector<Vec4d> ContactNodes::*field,
                 ContactNodeSet& nodes) {
    const std::array<Vec4d, 4> by_lane = one_by_one(change);
    Vec4d* value = (nodes.node.*field).data();
    for (uint32_t lane = 0; lane < 4; ++lane) value[wide_constraint.node[part][lane]] += by_lane[lane];
}

// As solve_constraint, for four constraints.
template <bool kEdges, uint32_t kMoving>
void solve_wide_constraint(double least_load_share, ContactNodeSet& nodes, WideConstraint& wide_constraint) {
    const Mask4 active = mask_lanes(wide_constraint.active);
    Vec4d lever[kMoving];
    FourPoints part[kMoving];
    FourPoints velocity;
    for (uint32_t k = 0; k < kMoving; ++k) {
        if (k == 1 && !kEdges) continue;
        lever[k] = lever_of<kEdges>(wide_constraint, active, k);
        part[k] = part_of(nodes, wide_constraint, k, &ContactNodes::velocity);
        velocity = velocity + lever[k] * part[k];
    }
    const Vec4d approach = dot(wide_constraint.normal, velocity);
    const Vec4d normal_impulse =
        greatest(wide_constraint.normal_impulse - (approach - wide_constraint.target_velocity) * wide_constraint.effective_mass, Vec4d{});
    if (!any((normal_impulse > 0) | (wide_constraint.normal_impulse > 0))) return;  // then there is no friction either
    // as most_friction
    const Vec4d share = wide(wide_constraint.load_share), average = wide(wide_constraint.load) + share * normal_impulse;
    const Mask4 averaged = share <= static_cast<float>(least_load_share);
    const Vec4d most = keep(normal_impulse > 0, wide(wide_constraint.friction) * (averaged ? average : normal_impulse));
    FourPoints friction =
        wide_constraint.friction_impulse - wide_constraint.effective_mass * (velocity - approach * wide_constraint.normal);
    const Vec4d size2 = norm2(friction);
    const Mask4 slips = size2 > most * most;
    if (any(slips)) friction = (slips ? most / square_root(size2) : all_lanes(1)) * friction;
    const FourPoints impulse = keep(
        active, (normal_impulse - wide_constraint.normal_impulse) * wide_constraint.normal + (friction - wide_constraint.friction_impulse));
    wide_constraint.normal_impulse = normal_impulse;
    wide_constraint.friction_impulse = keep(active, friction);
    for (uint32_t k = 0; k < kMoving; ++k) {
        if (k == 1 && !kEdges) continue;
        const std::array<Vec4d, 4> now = one_by_one(part[k] + wide_constraint.response[k] * impulse);
        for (uint32_t lane = 0; lane < 4; ++lane) nodes.node.velocity[wide_constraint.node[k][lane]] = now[lane];
    }
}

// Separations at the end of the substep, as separation_after.
Vec4d separations_after(const ContactSolver& solver, const ContactNodeSet& nodes, const WideConstraint& wide_constraint) {
    const auto corner = [&](uint32_t k) { return corner_of(solver, nodes, wide_constraint, k, &ContactNodes::after); };
    const FourPoints plane = weighted(wide_constraint.correction_weight, corner(0), corner(1), corner(2));
    return dot(wide_constraint.normal, point_of(nodes, wide_constraint, &ContactNodes::after) + plane) + wide_constraint.rest;
}

// Whether a node has moved in this sweep or a later one.
bool has_moved_lane(const ContactNodeSet& nodes, const WideConstraint& wide_constraint, uint8_t since) {
    bool moved = false;
    for (uint32_t k = 0; k < parts_of(wide_constraint); k += k == 0 && !wide_constraint.edges ? 2 : 1)
        for (const uint32_t node : wide_constraint.node[k]) moved |= nodes.moved_in[node] >= since;
    return moved;
}

// As add_correction, for the deep constraints of a wide one. Returns whether there is any.
bool push_block(const AdvanceCall& call, const ContactSolver& solver, const ContactConstraints& constraints, const CorrectionSweep& sweep,
                const WideConstraint& wide_constraint, ContactNodeSet& nodes) {
    const Mask4 active = mask_lanes(wide_constraint.active);
    const Vec4d overlap = -separations_after(solver, nodes, wide_constraint);
    Mask4 deep = active & (overlap > sweep.least);
    if (sweep.stamp > 1) deep &= overlap <= sweep.most;
    if (!any(deep)) return false;
    const FourPoints displacement = keep(deep, least(overlap, all_lanes(sweep.most))) * wide_constraint.normal;
    const bool by_mass = call.params.contact.share == ResponseShare::kMass;
    Vec4d unit[kParts], lever[kParts], sum[2] = {}, scale[2];
    for (uint32_t k = 0; k < kParts; ++k) {
        const Vec4d inv_mass = inv_mass_of(nodes, wide_constraint, k);
        unit[k] = by_mass ? inv_mass : keep(inv_mass > 0, all_lanes(1));
        lever[k] = k < 2 ? lever_of(wide_constraint, active, k) : wide_constraint.correction_weight[k - 2];
        sum[k >= 2] += lever[k] * lever[k] * unit[k];
    }
    if (by_mass) {
        const Vec4d both = sum[0] + sum[1];
        scale[0] = scale[1] = keep(both > 0, 1 / both);
    } else {
        Vec4d share = {};
        for (uint32_t lane = 0; lane < 4; ++lane)
            if (deep[lane]) share[lane] = share_of_point(call, constraints, wide_constraint.constraint[lane]);
        scale[0] = keep(sum[0] > 0, share / sum[0]);
        scale[1] = keep(sum[1] > 0, (1 - share) / sum[1]);
    }
    for (uint32_t k = 0; k < parts_of(wide_constraint); ++k) {
        if (k == 1 && !wide_constraint.edges) continue;
        add_to_part(wide_constraint, k, (lever[k] * unit[k] * scale[k >= 2]) * displacement, &ContactNodes::after, nodes);
        for (uint32_t lane = 0; lane < 4; ++lane)
            if (deep[lane] && unit[k][lane] > 0) nodes.moved_in[wide_constraint.node[k][lane]] = sweep.stamp;
    }
    return true;
}

// Packs the constraints of a group that fit, and counts its wide constraints.
void pack_wide(ContactSorting& sorting, ConstraintGroup& group) {
    WidePacker packer(sorting.open_wide_of_node);
    uint32_t before_fixed = 0;
    for (uint8_t kind = 0; kind < kKinds; ++kind) {
        if (kind == kFixedPlane) before_fixed = packer.count();
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i)
            if (sorting.key[i].kind == kind) packer.add(sorting.key[i]);
        packer.close_all();
    }
    group.wide_constraint.count = packer.count();
    group.fixed.count = packer.count() - before_fixed;
}

void fill_wide(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island, const ContactConstraints& constraints,
               const ConstraintGroup& group, ContactSolver& solver) {
    const uint32_t before_fixed = group.wide_constraint.count - group.fixed.count;
    for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
        if (i + kConstraintsAhead < group.prepared.end()) fetch_constraint(constraints, sorting.order[i + kConstraintsAhead]);
        const ConstraintKey& key = sorting.key[i];
        if (key.kind == ConstraintKey::kSingle) continue;
        WideConstraint& wide_constraint = solver.wide_constraint[group.wide_constraint.first + key.wide];
        if (key.lane == 0) {  // the first wide constraint
            if (key.wide + kWideAhead < group.wide_constraint.count)
                fetch(solver.wide_constraint[group.wide_constraint.first + key.wide + kWideAhead], kWholeConstraint);
            clear_wide(group.massless_node, wide_constraint);
            if (key.wide >= before_fixed) {
                wide_constraint.fixed = group.fixed.first + key.wide - before_fixed;
                solver.fixed[wide_constraint.fixed] = {};
            }
        }
        put_constraint(call, island, constraints, sorting.order[i], key, solver, wide_constraint);
    }
}

// Offsets of all groups' wide constraints, one after the other.
void lay_out_wide(ContactSolver& solver) {
    uint32_t wide_count = 0, fixed = 0;
    for (uint32_t g = 0; g < solver.colour[4]; ++g) {
        ConstraintGroup& group = solver.group[g];
        group.wide_constraint.first = wide_count, group.fixed.first = fixed;
        wide_count += group.wide_constraint.count, fixed += group.fixed.count;
        make_room(group.active_wide, group.wide_constraint.count);
    }
    resize_raw(solver.wide_constraint, wide_count);
    resize_raw(solver.fixed, fixed);
}

// Prepares the scalar constraints; all of them without keys.
void prepare_scalar_constraints(const AdvanceCall& call, bool with_keys, ContactSorting& sorting, ContactSolver& solver,
                                AdvanceIsland& island, const AdvanceState& state) {
    const auto is_single = [&](uint32_t i) { return !with_keys || sorting.key[i].kind == ConstraintKey::kSingle; };
    // the list of scalar constraints, in place
    uint32_t count = 0;
    for (uint32_t g = 0; g < solver.colour[4]; ++g) {
        ConstraintGroup& group = solver.group[g];
        const uint32_t first = count;
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i)
            if (is_single(i)) sorting.order[count++] = sorting.order[i];
        group.prepared = {first, count - first};
    }
    make_room(solver.prepared, count);
    solver.prepared.resize(count);
    parallel_for(count, has_embedded_surface(island) ? std::max(count, 1u) : kWidePerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) prepare_constraint(call, solver, sorting.order[i], island, state, solver.prepared[i]);
    });
}

}  // namespace

void prepare_wide_constraints(const AdvanceCall& call, ContactSorting& sorting, ContactSolver& solver, AdvanceIsland& island,
                              const AdvanceState& state) {
    for (uint32_t g = 0; g < solver.colour[4]; ++g) solver.group[g].wide_constraint = solver.group[g].fixed = {};
    const uint32_t count = static_cast<uint32_t>(sorting.order.size());
    if (count < kFewestConstraints || has_touched_implicit(island)) {
        prepare_scalar_constraints(call, false, sorting, solver, island, state);
        return;
    }
    sorting.static_planes = solver.colour[4] > 1 || count >= kFewestWithFixed;
    resize_raw(sorting.key, count);
    make_room(sorting.may_conflict, island.nodes.node.capacity());
    parallel_for(count, kWidePerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            if (i + kConstraintsAhead < end) fetch_sides(state.constraints, sorting.order[i + kConstraintsAhead]);
            sorting.key[i] = make_key(call, sorting, island, state.constraints, sorting.order[i]);
        }
    });
    find_conflicting_nodes(call, state.constraints, sorting, solver, island);
    for (uint32_t g = 0; g < solver.colour[4]; ++g) solver.group[g].massless_node = add_massless_node(island.nodes);
    sorting.open_wide_of_node.resize(island.nodes.node.size(), 0);
    for_each_group(solver, [&](ConstraintGroup& group) { pack_wide(sorting, group); });
    lay_out_wide(solver);
    for_each_group(solver, [&](ConstraintGroup& group) { fill_wide(call, sorting, island, state.constraints, group, solver); });
    prepare_scalar_constraints(call, true, sorting, solver, island, state);
}

void release_wide_constraints(const AdvanceCall& call, const ContactSolver& solver, ContactConstraints& constraints,
                              AdvanceResult& result) {
    const auto forget = [&](const WideConstraint& wide_constraint) {
        for (uint32_t lane = 0; lane < 4; ++lane) {
            const uint32_t constraint = wide_constraint.constraint[lane];
            if (constraint == kNone) continue;
            constraints.impulse[constraint] += to_vec3(lane_of(wide_constraint.impulse, lane));
            if (!(wide_constraint.open & 1u << lane)) expire_constraint(constraint, constraints, result);
            if (constraints.warm_start.empty()) continue;
            const Vec4d last = wide_constraint.normal_impulse[lane] * lane_of(wide_constraint.normal, lane) +
                               lane_of(wide_constraint.friction_impulse, lane);
            constraints.warm_start[constraint] = to_vec3(last / call.dt);
        }
    };
    const uint32_t wide_count = solver.group[solver.colour[4] - 1].wide_constraint.end();
    parallel_for(wide_count, 256, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) forget(solver.wide_constraint[i]);
    });
}

void activate_wide_constraints(const AdvanceCall& call, const AdvanceState& state, const ContactNodeSet& nodes, double reach,
                               ContactSolver& solver, ConstraintGroup& group) {
    group.active_wide.clear();
    group.active_lanes = 0;
    for (uint32_t i = group.wide_constraint.first; i < group.wide_constraint.end(); ++i) {
        if (i + kWideAhead < group.wide_constraint.end()) fetch(solver.wide_constraint[i + kWideAhead], kWholeConstraint);
        WideConstraint& wide_constraint = solver.wide_constraint[i];
        if (wide_constraint.open == 0 || !activate_wide_constraint(call, state, solver, nodes, reach, wide_constraint)) {
            wide_constraint.normal_impulse = Vec4d{};
            wide_constraint.friction_impulse = FourPoints{};
            continue;
        }
        group.active_wide.push_back(i);
        group.active_lanes += uint32_t(std::popcount(wide_constraint.active));
    }
}

void warm_start_wide_constraints(const ConstraintGroup& group, ContactSolver& solver, ContactNodeSet& nodes) {
    for_active_wide(group, kSweepPart, solver, [&](const WideConstraint& wide_constraint) {
        if (!any(wide_constraint.normal_impulse > 0)) return;
        const FourPoints impulse = wide_constraint.normal_impulse * wide_constraint.normal + wide_constraint.friction_impulse;
        for (uint32_t k = 0; k < parts_of(wide_constraint); ++k) {
            if (k == 1 && !wide_constraint.edges) continue;
            add_to_part(wide_constraint, k, wide_constraint.response[k] * impulse, &ContactNodes::velocity, nodes);
        }
    });
}

void solve_wide_constraints(const ConstraintGroup& group, ContactSolver& solver, ContactNodeSet& nodes) {
    for_active_wide(group, kSweepPart, solver, [&](WideConstraint& wide_constraint) {
        if (wide_constraint.fixed == kNone) {
            wide_constraint.edges ? solve_wide_constraint<true, kParts>(solver.load_share, nodes, wide_constraint)
                                  : solve_wide_constraint<false, kParts>(solver.load_share, nodes, wide_constraint);
        } else {
            wide_constraint.edges ? solve_wide_constraint<true, 2>(solver.load_share, nodes, wide_constraint)
                                  : solve_wide_constraint<false, 2>(solver.load_share, nodes, wide_constraint);
        }
    });
}

void add_wide_impulses(const ConstraintGroup& group, ContactSolver& solver) {
    for_active_wide(group, kSumPart, solver, [&](WideConstraint& wide_constraint) {
        wide_constraint.impulse =
            wide_constraint.impulse + (wide_constraint.normal_impulse * wide_constraint.normal + wide_constraint.friction_impulse);
        const Mask4 active = mask_lanes(wide_constraint.active);
        const Vec4d before = wide(wide_constraint.load), share = wide(wide_constraint.load_share);
        const Vec4d next = greatest(all_lanes(solver.load_share), share / (1 + share));  // as next_load_share
        const Mask4 averaged = share <= static_cast<float>(solver.load_share);
        const Vec4d load = averaged ? before + share * wide_constraint.normal_impulse : wide_constraint.normal_impulse;
        narrow(active ? (1 - next) * load : before, wide_constraint.load);
        narrow(active ? next : share, wide_constraint.load_share);
    });
}

bool correct_wide_constraints(const AdvanceCall& call, const ContactConstraints& constraints, const CorrectionSweep& sweep,
                              const ConstraintGroup& group, ContactSolver& solver, ContactNodeSet& nodes) {
    bool corrected = false;
    for_active_wide(group, kSeparationPart, solver, [&](const WideConstraint& wide_constraint) {
        if (sweep.since > 0 && !has_moved_lane(nodes, wide_constraint, sweep.since)) return;
        corrected = push_block(call, solver, constraints, sweep, wide_constraint, nodes) || corrected;
    });
    return corrected;
}

double deepest_in_wide(const ContactNodeSet& nodes, const ConstraintGroup& group, ContactSolver& solver) {
    Vec4d deepest = {};
    for_active_wide(group, kSeparationPart, solver, [&](const WideConstraint& wide_constraint) {
        deepest = greatest(keep(mask_lanes(wide_constraint.active), -separations_after(solver, nodes, wide_constraint)), deepest);
    });
    return std::max({deepest[0], deepest[1], deepest[2], deepest[3]});
}

}  // namespace trocar
