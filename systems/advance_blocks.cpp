#include "systems/advance_blocks.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include "engine/check.hpp"
#include "engine/surfaces.hpp"
#include "systems/advance_constants.hpp"
#include "systems/advance_contact.hpp"
#include "systems/advance_push.hpp"
namespace trocar {
namespace {

constexpr uint32_t kParts = ContactBlock::kParts;
constexpr uint32_t kConstraintsPerChunk = 512;

// Nodes of a row that is in a block.
struct RowNodes {
    std::array<uint32_t, kParts> node;
    uint32_t count = 0;
};
RowNodes nodes_of(const RowSketch& row) {
    RowNodes r;
    for (uint32_t part = 0; part < kParts; ++part)
        if (row.node[part] != kNone) r.node[r.count++] = row.node[part];
    return r;
}
bool are_distinct(const RowNodes& nodes) {
    for (uint32_t i = 0; i < nodes.count; ++i)
        for (uint32_t k = 0; k < i; ++k)
            if (nodes.node[i] == nodes.node[k]) return false;
    return true;
}

// Whether a side of a row is at rest for the whole call. Short lists with static bodies converge better in order.
bool is_fixed(const AdvanceCall& call, const ContactSorting& sorting, uint32_t body) {
    return sorting.static_planes && call.inputs.bodies.motion[body] == Motion::kStatic;
}

// Way of a row's normal in the world.
Vec4d way_of(const AdvanceCall& call, const AdvanceIsland& island, const ContactRows& rows, uint32_t row) {
    const Vec4d normal = to_vec4(rows.normal[row]);
    const uint32_t other = rows.other[row];
    return is_deformable(call.inputs.bodies, other) ? normal : island.rigid[island.slot_of_body[other]].place[0].turn(normal);
}

bool fits_block(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island, const ContactRows& rows, uint32_t row,
                const RowSketch& sketch) {
    const Bodies& bodies = call.inputs.bodies;
    const uint32_t point = rows.body[row], plane = rows.other[row];
    if (rows.third[row] != kNone || !is_deformable(bodies, point)) return false;  // a block has no part for a third corner
    const AdvanceBody& body = island.body[island.slot_of_body[point]];
    if (body.skin_node) return false;  // its vertices are no nodes
    if (is_deformable(bodies, plane) ? island.body[island.slot_of_body[plane]].skin_node != nullptr
                                     : !is_fixed(call, sorting, plane) || body.synchronous()) {  // whose step holds the row
        return false;
    }
    return are_distinct(nodes_of(sketch));
}

// Points of edges are apart, their blocks have one part more; and rows that start outside, of which most do not act; and those
// with fixed planes, whose kinds are the last.
constexpr uint8_t kFixedPlane = 3, kKinds = 6;
RowSketch make_sketch(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island, const ContactRows& rows,
                      uint32_t row) {
    const Bodies& bodies = call.inputs.bodies;
    RowSketch sketch;
    sketch.node.fill(kNone);
    const auto put = [&](uint32_t part, const AdvanceBody& body, uint32_t vertex) {
        if (!body.skin_node) sketch.node[part] = island.nodes.node_of_particle[body.particles.first + vertex];
    };
    const bool edge = rows.vertex[row][1] != rows.vertex[row][0];
    if (is_deformable(bodies, rows.body[row])) {
        const AdvanceBody& body = island.body[island.slot_of_body[rows.body[row]]];
        put(0, body, rows.vertex[row][0]);
        if (edge) put(1, body, rows.vertex[row][1]);
        if (rows.third[row] != kNone) put(5, body, rows.third[row]);
    }
    const bool plane_moves = is_deformable(bodies, rows.other[row]);
    for (uint32_t k = 0; plane_moves && k < 3; ++k) put(2 + k, island.body[island.slot_of_body[rows.other[row]]], rows.triangle[row][k]);
    const int kind = edge ? 1 : std::signbit(rows.distance[row]) ? 0 : 2;
    sketch.kind = fits_block(call, sorting, island, rows, row, sketch) ? static_cast<uint8_t>(kind + (plane_moves ? 0 : kFixedPlane))
                                                                       : RowSketch::kSingle;
    return sketch;
}

// Rows of a group lie here and there in memory.
void fetch_way(const ContactRows& rows, uint32_t row) {
    __builtin_prefetch(&rows.other[row]);
    __builtin_prefetch(&rows.normal[row]);
}
void fetch_sides(const ContactRows& rows, uint32_t row) {
    __builtin_prefetch(&rows.body[row]);
    __builtin_prefetch(&rows.other[row]);
    __builtin_prefetch(&rows.vertex[row]);
    __builtin_prefetch(&rows.third[row]);
    __builtin_prefetch(&rows.triangle[row]);
    __builtin_prefetch(&rows.distance[row]);
}
void fetch_row(const ContactRows& rows, uint32_t row) {
    fetch_sides(rows, row);
    __builtin_prefetch(&rows.along[row]);
    __builtin_prefetch(&rows.weight[row]);
    __builtin_prefetch(&rows.normal[row]);
    __builtin_prefetch(&rows.friction[row]);
    if (!rows.carried.empty()) __builtin_prefetch(&rows.carried[row]);
}

// Calls visit(node, way of a row that presses it, row of sketch), group by group.
template <typename Visit>
void for_each_way(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island, const ContactRows& rows,
                  ContactSolver& solver, const Visit& visit) {
    for_each_group(solver, [&](RowGroup& group) {
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
            if (i + kRowsAhead < group.prepared.end()) fetch_way(rows, sorting.dealt[i + kRowsAhead]);
            const Vec4d way = way_of(call, island, rows, sorting.dealt[i]), back = -way;
            const auto& node = sorting.sketch[i].node;
            for (const uint32_t part : {0, 1, 5, 2, 3, 4})
                if (node[part] != kNone) visit(node[part], part < 2 || part == 5 ? way : back, i);
        }
    });
}

// Planes of rigid bodies turn.
bool may_turn(const AdvanceCall& call, const ContactSorting& sorting, const ContactRows& rows, uint32_t row) {
    const Bodies& bodies = call.inputs.bodies;
    for (const uint32_t body : {rows.body[row], rows.other[row]})
        if (!is_deformable(bodies, body) && !is_fixed(call, sorting, body)) return true;
    return false;
}

// Finds the nodes that no two rows of the call can press from both sides: all ways lie within 60 degrees of their mean. Rows of
// other nodes, and of planes that may turn, are in no block.
void find_opposable(const AdvanceCall& call, const ContactRows& rows, ContactSorting& sorting, ContactSolver& solver,
                    AdvanceIsland& island) {
    RawVector<Vec4d>& sum = island.nodes.change.way;  // of the ways of all rows that press a node: until the first substep
    parallel_for(uint32_t(island.nodes.node.size()), kNodesPerChunk,
                 [&](uint32_t begin, uint32_t end) { std::fill(sum.begin() + begin, sum.begin() + end, Vec4d{}); });
    sorting.may_oppose.assign(island.nodes.node.size(), 0);
    for_each_way(call, sorting, island, rows, solver, [&](uint32_t node, Vec4d way, uint32_t) { sum[node] += way; });
    for_each_way(call, sorting, island, rows, solver, [&](uint32_t node, Vec4d way, uint32_t i) {
        const double along = dot(sum[node], way);
        const bool leans = !(along > 0 && along * along >= kLean * kLean * norm2(sum[node]));
        if (leans || may_turn(call, sorting, rows, sorting.dealt[i])) sorting.may_oppose[node] = 1;
    });
    for_each_group(solver, [&](RowGroup& group) {
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
            const auto& node = sorting.sketch[i].node;
            if (std::any_of(node.begin(), node.end(), [&](uint32_t n) { return n != kNone && sorting.may_oppose[n]; }))
                sorting.sketch[i].kind = RowSketch::kSingle;
        }
    });
}

// Particle-less and without mass: what lanes without a row, and vertices without a second end, point to.
uint32_t add_idle_node(ContactNodeSet& nodes) {
    add_node(nodes);
    return static_cast<uint32_t>(nodes.node.size()) - 1;
}

// Leaves out what activate writes before it is read.
void clear_block(uint32_t idle, ContactBlock& block) {
    for (auto& nodes : block.node) nodes.fill(idle);
    block.weight.fill({});
    block.normal = block.impulse = block.friction_impulse = FourPoints{};
    block.offset = block.normal_impulse = Vec4d{};
    block.along = block.friction = {};
    block.row.fill(kNone);
    block.open = 0;
    block.edges = false;
    block.fixed = kNone;
}

void put_fixed_triangle(const AdvanceCall& call, const AdvanceIsland& island, const ContactRows& rows, uint32_t row, uint32_t lane,
                        ContactSolver& solver, ContactBlock& block) {
    const uint32_t other = rows.other[row];
    const RigidMap& place = island.rigid[island.slot_of_body[other]].place[0];
    const Meshes& meshes = call.inputs.meshes;
    const uint32_t first = meshes.info[call.inputs.bodies.mesh[other]].vertices.first;
    for (uint32_t k = 0; k < 3; ++k) {
        const Vec4d corner = to_vec4(meshes.position[first + rows.triangle[row][k]]);
        set_lane(solver.fixed[block.fixed].corner[k], lane, place(corner));
        block.weight[k].lane[lane] = rows.weight[row][k];
    }
    set_lane(block.normal, lane, place.turn(to_vec4(rows.normal[row])));
}

// As prepare_constraint, of a row that fits_block.
void put_row(const AdvanceCall& call, const AdvanceIsland& island, const ContactRows& rows, uint32_t row, const RowSketch& sketch,
             ContactSolver& solver, ContactBlock& block) {
    const uint32_t lane = sketch.lane;
    const auto put = [&](uint32_t part) { block.node[part][lane] = sketch.node[part]; };
    put(0);
    if (sketch.node[1] != kNone) {
        put(1);
        block.along.lane[lane] = rows.along[row];
        block.edges = true;
    }
    if (sketch.node[2] != kNone) {
        for (uint32_t k = 0; k < 3; ++k) put(2 + k), block.weight[k].lane[lane] = rows.weight[row][k];
        set_lane(block.normal, lane, to_vec4(rows.normal[row]));
    } else {
        put_fixed_triangle(call, island, rows, row, lane, solver, block);
    }
    const Bodies& bodies = call.inputs.bodies;
    const uint32_t other = rows.other[row];
    if (call.inputs.meshes.info[bodies.mesh[other]].admission == Admission::kSheet) block.offset[lane] = 0.5 * bodies.thickness[other];
    block.friction.lane[lane] = rows.friction[row];
    block.row[lane] = row;
    if (!std::isinf(rows.distance[row])) block.open |= uint8_t(1u << lane);
    const Vec4d start = start_impulse(call, rows, row), normal = lane_of(block.normal, lane);
    block.normal_impulse[lane] = std::max(0.0, dot(start, normal));
    if (block.normal_impulse[lane] > 0) set_lane(block.friction_impulse, lane, start - dot(start, normal) * normal);
}

// Part of a block that a loop over blocks asks for, bytes.
struct BlockPart {
    size_t first, end;
};
constexpr BlockPart kWholeBlock = {0, sizeof(ContactBlock)};
constexpr BlockPart kGapPart = {offsetof(ContactBlock, along), offsetof(ContactBlock, inv_sum)};
constexpr BlockPart kSweepPart = {offsetof(ContactBlock, node), offsetof(ContactBlock, impulse)};
constexpr BlockPart kSumPart = {offsetof(ContactBlock, normal_impulse), sizeof(ContactBlock)};

inline __attribute__((always_inline)) void fetch(const ContactBlock& block, BlockPart part) {
    constexpr size_t kLine = 64;
    const char* start = reinterpret_cast<const char*>(&block);
    for (size_t byte = part.first; byte < part.end; byte += kLine) __builtin_prefetch(start + byte);
    __builtin_prefetch(start + part.end - 1);
}

// Calls run(block) for the active blocks of a group, one after the other. They come from far away in memory: that of a later
// one is fetched meanwhile.
template <typename Run>
inline __attribute__((always_inline)) void for_active_blocks(const RowGroup& group, BlockPart part, ContactSolver& solver, const Run& run) {
    const std::vector<uint32_t>& active = group.active_block;
    for (size_t i = 0; i < active.size(); ++i) {
        if (i + kBlocksAhead < active.size()) fetch(solver.block[active[i + kBlocksAhead]], part);
        run(solver.block[active[i]]);
    }
}

// Deals rows out to the blocks of a group: each to the first of a few unfinished ones that has none of its nodes.
class BlockDealer {
 public:
    // open: per node, which of the unfinished blocks have it.
    explicit BlockDealer(std::vector<uint16_t>& open) : open_(open) { block_.fill(kNone); }
    void add(RowSketch& row) {
        const RowNodes nodes = nodes_of(row);
        uint32_t shared = 0;
        for (uint32_t k = 0; k < nodes.count; ++k) shared |= open_[nodes.node[k]];
        uint32_t slot = uint32_t(std::countr_one(shared));
        if (slot >= kOpenBlocks) close(slot = next_ = (next_ + 1) % kOpenBlocks);
        if (block_[slot] == kNone) block_[slot] = count_++;
        row.block = block_[slot];
        row.lane = static_cast<uint8_t>(row_[slot].count);
        row_[slot].nodes[row_[slot].count++] = nodes;
        for (uint32_t k = 0; k < nodes.count; ++k) open_[nodes.node[k]] |= uint16_t(1u << slot);
        if (row_[slot].count == 4) close(slot);
    }
    void close_all() {
        for (uint32_t slot = 0; slot < kOpenBlocks; ++slot) {
            if (block_[slot] != kNone) close(slot);
        }
    }
    uint32_t count() const { return count_; }

 private:
    void close(uint32_t slot) {
        for (uint32_t i = 0; i < row_[slot].count; ++i) {
            const RowNodes& nodes = row_[slot].nodes[i];
            for (uint32_t k = 0; k < nodes.count; ++k) open_[nodes.node[k]] &= uint16_t(~(1u << slot));
        }
        block_[slot] = kNone;
        row_[slot].count = 0;
    }
    struct Rows {
        std::array<RowNodes, 4> nodes;
        uint32_t count = 0;
    };
    std::vector<uint16_t>& open_;
    std::array<uint32_t, kOpenBlocks> block_;  // per slot: row of block in the group, or kNone
    std::array<Rows, kOpenBlocks> row_;        // and what is in it
    uint32_t count_ = 0;
    uint32_t next_ = 0;  // slot to close when none will do
};

// Places of the nodes of one part of a block, one of the fields of ContactNodes.
inline __attribute__((always_inline)) FourPoints part_of(const ContactNodeSet& nodes, const ContactBlock& block, uint32_t part,
                                                         RawVector<Vec4d> ContactNodes::*field) {
    const auto& n = block.node[part];
    const Vec4d* value = (nodes.node.*field).data();
    return side_by_side(value[n[0]], value[n[1]], value[n[2]], value[n[3]]);
}
inline __attribute__((always_inline)) Vec4d inv_mass_of(const ContactNodeSet& nodes, const ContactBlock& block, uint32_t part) {
    const auto& n = block.node[part];
    const double* value = nodes.node.inv_mass.data();
    return Vec4d{value[n[0]], value[n[1]], value[n[2]], value[n[3]]};
}
inline __attribute__((always_inline)) FourPoints point_of(const ContactNodeSet& nodes, const ContactBlock& block,
                                                          RawVector<Vec4d> ContactNodes::*field) {
    const FourPoints first = part_of(nodes, block, 0, field);
    if (!block.edges) return first;
    const Vec4d along = wide(block.along);
    return (1 - along) * first + along * part_of(nodes, block, 1, field);
}
inline __attribute__((always_inline)) FourPoints weighted(const std::array<Vec4d, 3>& w, const FourPoints& a, const FourPoints& b,
                                                          const FourPoints& c) {
    return w[0] * a + w[1] * b + w[2] * c;
}
inline __attribute__((always_inline)) std::array<Vec4d, 3> corner_weights(const ContactBlock& block) {
    return {wide(block.weight[0]), wide(block.weight[1]), wide(block.weight[2])};
}
inline __attribute__((always_inline)) FourPoints plane_of(const ContactNodeSet& nodes, const ContactBlock& block,
                                                          RawVector<Vec4d> ContactNodes::*field) {
    return weighted(corner_weights(block), part_of(nodes, block, 2, field), part_of(nodes, block, 3, field),
                    part_of(nodes, block, 4, field));
}
// Corners of the planes: their places, or where they are after the substep.
inline __attribute__((always_inline)) FourPoints corner_of(const ContactSolver& solver, const ContactNodeSet& nodes,
                                                           const ContactBlock& block, uint32_t k, RawVector<Vec4d> ContactNodes::*field) {
    return block.fixed == kNone ? part_of(nodes, block, 2 + k, field) : solver.fixed[block.fixed].corner[k];
}
// Parts that move: all, or those of the point.
inline uint32_t parts_of(const ContactBlock& block) { return block.fixed == kNone ? kParts : 2; }

// As find_foot of one row: weights of the corners, and which rows have left their triangle behind.
struct FourFeet {
    std::array<Vec4d, 3> weight;
    Mask4 left_behind;
};
FourFeet find_feet(const FourPoints& a, const FourPoints& b, const FourPoints& c, const FourPoints& point, const FourPoints& plane,
                   const FourPoints& normal, const std::array<Vec4d, 3>& fixed) {
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
    FourFeet feet;
    Mask4 beyond = {};
    for (int k = 0; k < 3; ++k) {
        const Vec4d w = weight[k];
        beyond |= (w < 0) & (w * w * area2 > longest2 * edge2[k]);  // see find_foot
        feet.weight[k] = near ? w : fixed[k];
    }
    feet.left_behind = near ? beyond : slid;
    return feet;
}

// Weight of a part in the relative velocity: + for the point, - for its foot; 0 for rows that do not act.
template <bool kEdges>
inline __attribute__((always_inline)) Vec4d lever_of(const ContactBlock& block, Mask4 active, uint32_t part) {
    if (part >= 2) return block.foot[part - 2];
    if (!kEdges) return keep(active, all_lanes(part == 0 ? 1 : 0));
    return keep(active, part == 0 ? 1 - wide(block.along) : wide(block.along));
}
inline __attribute__((always_inline)) Vec4d lever_of(const ContactBlock& block, Mask4 active, uint32_t part) {
    return block.edges ? lever_of<true>(block, active, part) : lever_of<false>(block, active, part);
}

// As set_push_weights: weights of the corners in pushes, negative; 0 for rows that do not act.
inline __attribute__((always_inline)) std::array<Vec4d, 3> push_foot_of(const ContactBlock& block, Mask4 active) {
    std::array<Vec4d, 3> foot;
    for (uint32_t k = 0; k < 3; ++k) foot[k] = least(block.foot[k], Vec4d{});
    const Vec4d scale = keep(active, -1 / (foot[0] + foot[1] + foot[2]));
    for (uint32_t k = 0; k < 3; ++k) foot[k] *= scale;
    return foot;
}

// Which rows of a block act in this substep, and what their impulses need. As find_active_rows and activate.
bool activate_block(const AdvanceCall& call, const ContactSolver& solver, const ContactNodeSet& nodes, double reach, ContactBlock& block) {
    const FourPoints a = corner_of(solver, nodes, block, 0, &ContactNodes::place),
                     b = corner_of(solver, nodes, block, 1, &ContactNodes::place),
                     c = corner_of(solver, nodes, block, 2, &ContactNodes::place);
    const std::array<Vec4d, 3> fixed = corner_weights(block);
    const FourPoints point = point_of(nodes, block, &ContactNodes::place), plane = weighted(fixed, a, b, c);
    const Vec4d gap = dot(block.normal, point - plane) - block.offset;
    Mask4 active = mask_lanes(block.open) & (gap < reach);
    if (!any(active)) return false;
    // what is inside acts whatever its velocity, if only that is finite
    if (!std::isfinite(reach) || any(active & (gap >= 0))) {
        FourPoints velocity = point_of(nodes, block, &ContactNodes::velocity);
        if (block.fixed == kNone) velocity = velocity - plane_of(nodes, block, &ContactNodes::velocity);
        const Vec4d gap_after = gap + least(dot(block.normal, velocity), Vec4d{}) * call.dt;
        const Vec4d all = gap_after + norm2(velocity);  // not finite if one of them is not
        active &= (gap_after < 0) & (all - all == 0);
        if (!any(active)) return false;
    }
    const FourFeet feet = find_feet(a, b, c, point, plane, block.normal, fixed);
    if (any(feet.left_behind & active)) {
        block.open &= uint8_t(~mask_bits(feet.left_behind & active));
        active &= mask_lanes(block.open);
        if (!any(active)) return false;
    }
    block.active = static_cast<uint8_t>(mask_bits(active));
    for (uint32_t k = 0; k < 3; ++k) block.foot[k] = keep(active, -feet.weight[k]);
    const std::array<Vec4d, 3> push_foot = push_foot_of(block, active);
    block.rest = -dot(block.normal, weighted(push_foot, a, b, c) + plane) - block.offset;
    Vec4d sum = {};
    for (uint32_t k = 0; k < kParts; ++k) {
        const Vec4d lever = lever_of(block, active, k);
        sum += lever * lever * inv_mass_of(nodes, block, k);
    }
    block.inv_sum = keep(active & (sum > 0), 1 / sum);
    block.least_velocity = keep(active, -greatest(gap, Vec4d{}) / call.dt);
    // of the substep before: start_blocks
    const Mask4 warm = solver.starts_warm ? active : Mask4{};
    block.normal_impulse = keep(warm, block.normal_impulse);
    block.friction_impulse = keep(warm, block.friction_impulse);
    return true;
}

// Adds to a field of the nodes of one part.
void add_to_part(const ContactBlock& block, uint32_t part, const FourPoints& way, RawVector<Vec4d> ContactNodes::*field,
                 ContactNodeSet& nodes) {
    const std::array<Vec4d, 4> ways = one_by_one(way);
    Vec4d* value = (nodes.node.*field).data();
    for (uint32_t lane = 0; lane < 4; ++lane) value[block.node[part][lane]] += ways[lane];
}

// As solve_row, for four rows.
template <bool kEdges, uint32_t kMoving>
void solve_block(ContactNodeSet& nodes, ContactBlock& block) {
    const Mask4 active = mask_lanes(block.active);
    Vec4d lever[kMoving];
    FourPoints part[kMoving];
    FourPoints velocity;
    for (uint32_t k = 0; k < kMoving; ++k) {
        if (k == 1 && !kEdges) continue;
        lever[k] = lever_of<kEdges>(block, active, k);
        part[k] = part_of(nodes, block, k, &ContactNodes::velocity);
        velocity = velocity + lever[k] * part[k];
    }
    const Vec4d approach = dot(block.normal, velocity);
    const Vec4d normal_impulse = greatest(block.normal_impulse - (approach - block.least_velocity) * block.inv_sum, Vec4d{});
    if (!any((normal_impulse > 0) | (block.normal_impulse > 0))) return;  // nor is there friction
    const Vec4d most = wide(block.friction) * normal_impulse;
    FourPoints friction = block.friction_impulse - block.inv_sum * (velocity - approach * block.normal);
    const Vec4d size2 = norm2(friction);
    const Mask4 slips = size2 > most * most;
    if (any(slips)) friction = (slips ? most / square_root(size2) : all_lanes(1)) * friction;
    const FourPoints impulse = keep(active, (normal_impulse - block.normal_impulse) * block.normal + (friction - block.friction_impulse));
    block.normal_impulse = normal_impulse;
    block.friction_impulse = keep(active, friction);
    for (uint32_t k = 0; k < kMoving; ++k) {
        if (k == 1 && !kEdges) continue;
        const std::array<Vec4d, 4> now = one_by_one(part[k] + (lever[k] * inv_mass_of(nodes, block, k)) * impulse);
        for (uint32_t lane = 0; lane < 4; ++lane) nodes.node.velocity[block.node[k][lane]] = now[lane];
    }
}

// Gaps at the end of the substep, as gap_after.
Vec4d gaps_after(const ContactSolver& solver, const ContactNodeSet& nodes, const ContactBlock& block) {
    const auto corner = [&](uint32_t k) { return corner_of(solver, nodes, block, k, &ContactNodes::after); };
    const FourPoints foot = weighted(push_foot_of(block, mask_lanes(block.active)), corner(0), corner(1), corner(2));
    return dot(block.normal, point_of(nodes, block, &ContactNodes::after) + foot) + block.rest;
}

// Whether a node of a block has moved in a sweep or a later one.
bool has_moved_node(const ContactNodeSet& nodes, const ContactBlock& block, uint8_t since) {
    bool moved = false;
    for (uint32_t k = 0; k < parts_of(block); k += k == 0 && !block.edges ? 2 : 1)
        for (const uint32_t node : block.node[k]) moved |= nodes.moved_in[node] >= since;
    return moved;
}

// As add_push, for the constraints of a block that are deep. Returns whether any is.
bool push_block(const AdvanceCall& call, const ContactSolver& solver, const ContactRows& rows, const PushSweep& sweep,
                const ContactBlock& block, ContactNodeSet& nodes) {
    const Mask4 active = mask_lanes(block.active);
    const Vec4d overlap = -gaps_after(solver, nodes, block);
    Mask4 deep = active & (overlap > sweep.least);
    if (sweep.stamp > 1) deep &= overlap <= sweep.most;
    if (!any(deep)) return false;
    const FourPoints way = keep(deep, least(overlap, all_lanes(sweep.most))) * block.normal;
    const bool by_mass = call.params.contact.share == ResponseShare::kMass;
    const std::array<Vec4d, 3> foot = push_foot_of(block, active);
    Vec4d unit[kParts], lever[kParts], sum[2] = {}, scale[2];
    for (uint32_t k = 0; k < kParts; ++k) {
        const Vec4d inv_mass = inv_mass_of(nodes, block, k);
        unit[k] = by_mass ? inv_mass : keep(inv_mass > 0, all_lanes(1));
        lever[k] = k < 2 ? lever_of(block, active, k) : foot[k - 2];
        sum[k >= 2] += lever[k] * lever[k] * unit[k];
    }
    if (by_mass) {
        const Vec4d both = sum[0] + sum[1];
        scale[0] = scale[1] = keep(both > 0, 1 / both);
    } else {
        Vec4d share = {};
        for (uint32_t lane = 0; lane < 4; ++lane)
            if (deep[lane]) share[lane] = share_of_point(call, rows, block.row[lane]);
        scale[0] = keep(sum[0] > 0, share / sum[0]);
        scale[1] = keep(sum[1] > 0, (1 - share) / sum[1]);
    }
    for (uint32_t k = 0; k < parts_of(block); ++k) {
        if (k == 1 && !block.edges) continue;
        add_to_part(block, k, (lever[k] * unit[k] * scale[k >= 2]) * way, &ContactNodes::after, nodes);
        for (uint32_t lane = 0; lane < 4; ++lane)
            if (deep[lane] && unit[k][lane] > 0) nodes.moved_in[block.node[k][lane]] = sweep.stamp;
    }
    return true;
}

// Deals out the rows of a group that fit, and counts its blocks.
void deal_blocks(ContactSorting& sorting, RowGroup& group) {
    BlockDealer dealer(sorting.open_blocks_of_node);
    uint32_t before_fixed = 0;
    for (uint8_t kind = 0; kind < kKinds; ++kind) {
        if (kind == kFixedPlane) before_fixed = dealer.count();
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i)
            if (sorting.sketch[i].kind == kind) dealer.add(sorting.sketch[i]);
        dealer.close_all();
    }
    group.block.count = dealer.count();
    group.fixed.count = dealer.count() - before_fixed;
}

void fill_blocks(const AdvanceCall& call, const ContactSorting& sorting, const AdvanceIsland& island, const ContactRows& rows,
                 const RowGroup& group, ContactSolver& solver) {
    const uint32_t before_fixed = group.block.count - group.fixed.count;
    for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i) {
        if (i + kRowsAhead < group.prepared.end()) fetch_row(rows, sorting.dealt[i + kRowsAhead]);
        const RowSketch& row = sorting.sketch[i];
        if (row.kind == RowSketch::kSingle) continue;
        ContactBlock& block = solver.block[group.block.first + row.block];
        if (row.lane == 0) {  // the first of the block
            if (row.block + kBlocksAhead < group.block.count)
                fetch(solver.block[group.block.first + row.block + kBlocksAhead], kWholeBlock);
            clear_block(group.idle, block);
            if (row.block >= before_fixed) {
                block.fixed = group.fixed.first + row.block - before_fixed;
                solver.fixed[block.fixed] = {};
            }
        }
        put_row(call, island, rows, sorting.dealt[i], row, solver, block);
    }
}

// Places of the blocks of all groups, one after the other.
void lay_out_blocks(ContactSolver& solver) {
    uint32_t blocks = 0, fixed = 0;
    for (uint32_t g = 0; g < solver.phase[4]; ++g) {
        RowGroup& group = solver.group[g];
        group.block.first = blocks, group.fixed.first = fixed;
        blocks += group.block.count, fixed += group.fixed.count;
        make_room(group.active_block, group.block.count);
    }
    have_rows(solver.block, blocks);
    have_rows(solver.fixed, fixed);
}

// Prepares the rows that are not in a block; all of them without sketches.
void prepare_single_rows(const AdvanceCall& call, bool sketched, ContactSorting& sorting, ContactSolver& solver, AdvanceIsland& island,
                         const AdvanceState& state) {
    const auto is_single = [&](uint32_t i) { return !sketched || sorting.sketch[i].kind == RowSketch::kSingle; };
    // the list of single rows, in place
    uint32_t count = 0;
    for (uint32_t g = 0; g < solver.phase[4]; ++g) {
        RowGroup& group = solver.group[g];
        const uint32_t first = count;
        for (uint32_t i = group.prepared.first; i < group.prepared.end(); ++i)
            if (is_single(i)) sorting.dealt[count++] = sorting.dealt[i];
        group.prepared = {first, count - first};
    }
    make_room(solver.prepared, count);
    solver.prepared.resize(count);
    parallel_for(count, any_rides(island) ? std::max(count, 1u) : kConstraintsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) prepare_constraint(call, solver, sorting.dealt[i], island, state, solver.prepared[i]);
    });
}

}  // namespace

void plan_blocks(const AdvanceCall& call, ContactSorting& sorting, ContactSolver& solver, AdvanceIsland& island,
                 const AdvanceState& state) {
    for (uint32_t g = 0; g < solver.phase[4]; ++g) solver.group[g].block = solver.group[g].fixed = {};
    const uint32_t count = static_cast<uint32_t>(sorting.dealt.size());
    if (count < kFewestRows) {
        prepare_single_rows(call, false, sorting, solver, island, state);
        return;
    }
    sorting.static_planes = solver.phase[4] > 1 || count >= kFewestWithFixed;
    have_rows(sorting.sketch, count);
    make_room(sorting.may_oppose, island.nodes.node.capacity());
    parallel_for(count, kConstraintsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            if (i + kRowsAhead < end) fetch_sides(state.rows, sorting.dealt[i + kRowsAhead]);
            sorting.sketch[i] = make_sketch(call, sorting, island, state.rows, sorting.dealt[i]);
        }
    });
    find_opposable(call, state.rows, sorting, solver, island);
    for (uint32_t g = 0; g < solver.phase[4]; ++g) solver.group[g].idle = add_idle_node(island.nodes);
    sorting.open_blocks_of_node.resize(island.nodes.node.size(), 0);
    for_each_group(solver, [&](RowGroup& group) { deal_blocks(sorting, group); });
    lay_out_blocks(solver);
    for_each_group(solver, [&](RowGroup& group) { fill_blocks(call, sorting, island, state.rows, group, solver); });
    prepare_single_rows(call, true, sorting, solver, island, state);
}

void forget_blocks(const AdvanceCall& call, const ContactSolver& solver, ContactRows& rows, AdvanceResult& result) {
    const auto forget = [&](const ContactBlock& block) {
        for (uint32_t lane = 0; lane < 4; ++lane) {
            const uint32_t row = block.row[lane];
            if (row == kNone) continue;
            rows.impulse[row] += to_vec3(lane_of(block.impulse, lane));
            if (!(block.open & 1u << lane)) end_row(row, rows, result);
            if (rows.carried.empty()) continue;
            const Vec4d last = block.normal_impulse[lane] * lane_of(block.normal, lane) + lane_of(block.friction_impulse, lane);
            rows.carried[row] = to_vec3(last / call.dt);
        }
    };
    const uint32_t blocks = solver.group[solver.phase[4] - 1].block.end();
    parallel_for(blocks, 256, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) forget(solver.block[i]);
    });
}

void activate_blocks(const AdvanceCall& call, const ContactNodeSet& nodes, double reach, ContactSolver& solver, RowGroup& group) {
    group.active_block.clear();
    group.active_lanes = 0;
    for (uint32_t i = group.block.first; i < group.block.end(); ++i) {
        if (i + kBlocksAhead < group.block.end()) fetch(solver.block[i + kBlocksAhead], kWholeBlock);
        ContactBlock& block = solver.block[i];
        if (block.open == 0 || !activate_block(call, solver, nodes, reach, block)) {
            block.normal_impulse = Vec4d{};
            block.friction_impulse = FourPoints{};
            continue;
        }
        group.active_block.push_back(i);
        group.active_lanes += uint32_t(std::popcount(block.active));
    }
}

void start_blocks(const RowGroup& group, ContactSolver& solver, ContactNodeSet& nodes) {
    for_active_blocks(group, kSweepPart, solver, [&](const ContactBlock& block) {
        if (!any(block.normal_impulse > 0)) return;
        const FourPoints impulse = block.normal_impulse * block.normal + block.friction_impulse;
        const Mask4 active = mask_lanes(block.active);
        for (uint32_t k = 0; k < parts_of(block); ++k) {
            if (k == 1 && !block.edges) continue;
            add_to_part(block, k, (lever_of(block, active, k) * inv_mass_of(nodes, block, k)) * impulse, &ContactNodes::velocity, nodes);
        }
    });
}

void solve_blocks(const RowGroup& group, ContactSolver& solver, ContactNodeSet& nodes) {
    for_active_blocks(group, kSweepPart, solver, [&](ContactBlock& block) {
        if (block.fixed == kNone) {
            block.edges ? solve_block<true, kParts>(nodes, block) : solve_block<false, kParts>(nodes, block);
        } else {
            block.edges ? solve_block<true, 2>(nodes, block) : solve_block<false, 2>(nodes, block);
        }
    });
}

void add_block_impulses(const RowGroup& group, ContactSolver& solver) {
    for_active_blocks(group, kSumPart, solver, [&](ContactBlock& block) {
        block.impulse = block.impulse + (block.normal_impulse * block.normal + block.friction_impulse);
    });
}

bool push_blocks(const AdvanceCall& call, const ContactRows& rows, const PushSweep& sweep, const RowGroup& group, ContactSolver& solver,
                 ContactNodeSet& nodes) {
    bool pushed = false;
    for_active_blocks(group, kGapPart, solver, [&](const ContactBlock& block) {
        if (sweep.since > 0 && !has_moved_node(nodes, block, sweep.since)) return;
        pushed = push_block(call, solver, rows, sweep, block, nodes) || pushed;
    });
    return pushed;
}

double deepest_in_blocks(const ContactNodeSet& nodes, const RowGroup& group, ContactSolver& solver) {
    Vec4d deepest = {};
    for_active_blocks(group, kGapPart, solver, [&](const ContactBlock& block) {
        deepest = greatest(keep(mask_lanes(block.active), -gaps_after(solver, nodes, block)), deepest);
    });
    return std::max({deepest[0], deepest[1], deepest[2], deepest[3]});
}

}  // namespace trocar
