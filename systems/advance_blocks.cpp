#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include "engine/check.hpp"
#include "engine/surfaces.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

constexpr uint32_t kParts = ContactBlock::kParts;
// Fewer rows than this converge better one after the other, in the order of the surface; with static planes, this.
constexpr uint32_t kFewestRows = 64, kFewestWithFixed = 2048;
constexpr uint32_t kOpenBlocks = 16;
// Two ways within 60 degrees of a third are within 120 of each other, which is kOpposed.
constexpr double kLean = 0.5;
constexpr uint32_t kPlansPerChunk = 512;
// That are fetched before they are asked for.
constexpr uint32_t kRowsAhead = 8, kBlocksAhead = 3;

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
bool is_fixed(const AdvanceIsland& island, uint32_t body) {
    const AdvanceScratch& s = island.scratch;
    return (s.phase[4] > 1 || s.dealt.size() >= kFewestWithFixed) && island.inputs.bodies.motion[body] == Motion::kStatic;
}

// Way of a row's normal in the world.
Vec4d way_of(const AdvanceIsland& island, uint32_t row) {
    const AdvanceScratch& s = island.scratch;
    const Vec4d normal = to_vec4(island.rows.normal[row]);
    const uint32_t other = island.rows.other[row];
    return is_deformable(island.inputs.bodies, other) ? normal : s.rigid[s.slot_of_body[other]].place[0].turn(normal);
}

bool fits_block(const AdvanceIsland& island, uint32_t row, const RowSketch& sketch) {
    const AdvanceScratch& s = island.scratch;
    const Bodies& bodies = island.inputs.bodies;
    const uint32_t point = island.rows.body[row], plane = island.rows.other[row];
    if (island.rows.third[row] != kNone || !is_deformable(bodies, point)) return false;  // a block has no part for a third corner
    const AdvanceBody& body = s.body[s.slot_of_body[point]];
    if (body.skin_node) return false;  // its vertices are no nodes
    if (is_deformable(bodies, plane) ? s.body[s.slot_of_body[plane]].skin_node != nullptr
                                     : !is_fixed(island, plane) || body.synchronous()) {  // whose step holds the row
        return false;
    }
    return are_distinct(nodes_of(sketch));
}

// Points of edges are apart, their blocks have one part more; and rows that start outside, of which most do not act; and those
// with fixed planes, whose kinds are the last.
constexpr uint8_t kFixedPlane = 3, kKinds = 6;
RowSketch make_sketch(const AdvanceIsland& island, uint32_t row) {
    const AdvanceScratch& s = island.scratch;
    const ContactRows& rows = island.rows;
    const Bodies& bodies = island.inputs.bodies;
    RowSketch sketch;
    sketch.node.fill(kNone);
    const auto put = [&](uint32_t part, const AdvanceBody& body, uint32_t vertex) {
        if (!body.skin_node) sketch.node[part] = s.node_of_particle[body.particles.first + vertex];
    };
    const bool edge = rows.vertex[row][1] != rows.vertex[row][0];
    if (is_deformable(bodies, rows.body[row])) {
        const AdvanceBody& body = s.body[s.slot_of_body[rows.body[row]]];
        put(0, body, rows.vertex[row][0]);
        if (edge) put(1, body, rows.vertex[row][1]);
        if (rows.third[row] != kNone) put(5, body, rows.third[row]);
    }
    const bool plane_moves = is_deformable(bodies, rows.other[row]);
    for (uint32_t k = 0; plane_moves && k < 3; ++k) put(2 + k, s.body[s.slot_of_body[rows.other[row]]], rows.triangle[row][k]);
    const int kind = edge ? 1 : std::signbit(rows.distance[row]) ? 0 : 2;
    sketch.kind = fits_block(island, row, sketch) ? static_cast<uint8_t>(kind + (plane_moves ? 0 : kFixedPlane)) : RowSketch::kSingle;
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
void for_each_way(AdvanceIsland& island, const Visit& visit) {
    AdvanceScratch& s = island.scratch;
    for_each_group(s, [&](RowGroup& group) {
        for (uint32_t i = group.plan.first; i < group.plan.end(); ++i) {
            if (i + kRowsAhead < group.plan.end()) fetch_way(island.rows, s.dealt[i + kRowsAhead]);
            const Vec4d way = way_of(island, s.dealt[i]), back = -way;
            const auto& node = s.sketch[i].node;
            for (const uint32_t part : {0, 1, 5, 2, 3, 4})
                if (node[part] != kNone) visit(node[part], part < 2 || part == 5 ? way : back, i);
        }
    });
}

// Planes of rigid bodies turn.
bool may_turn(const AdvanceIsland& island, uint32_t row) {
    const Bodies& bodies = island.inputs.bodies;
    for (const uint32_t body : {island.rows.body[row], island.rows.other[row]})
        if (!is_deformable(bodies, body) && !is_fixed(island, body)) return true;
    return false;
}

// Finds the nodes that no two rows of the call can press from both sides: all ways lie within 60 degrees of their mean. Rows of
// other nodes, and of planes that may turn, are in no block.
void find_opposable(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    RawVector<Vec4d>& sum = s.change.way;  // of the ways of all rows that press a node: until the first substep
    parallel_for(uint32_t(s.node.size()), kNodesPerChunk,
                 [&](uint32_t begin, uint32_t end) { std::fill(sum.begin() + begin, sum.begin() + end, Vec4d{}); });
    s.may_oppose.assign(s.node.size(), 0);
    for_each_way(island, [&](uint32_t node, Vec4d way, uint32_t) { sum[node] += way; });
    for_each_way(island, [&](uint32_t node, Vec4d way, uint32_t i) {
        const double along = dot(sum[node], way);
        const bool leans = !(along > 0 && along * along >= kLean * kLean * norm2(sum[node]));
        if (leans || may_turn(island, s.dealt[i])) s.may_oppose[node] = 1;
    });
    for_each_group(s, [&](RowGroup& group) {
        for (uint32_t i = group.plan.first; i < group.plan.end(); ++i) {
            const auto& node = s.sketch[i].node;
            if (std::any_of(node.begin(), node.end(), [&](uint32_t n) { return n != kNone && s.may_oppose[n]; }))
                s.sketch[i].kind = RowSketch::kSingle;
        }
    });
}

// Particle-less and without mass: what lanes without a row, and vertices without a second end, point to.
uint32_t add_idle_node(AdvanceScratch& s) {
    add_node(s);
    return static_cast<uint32_t>(s.node.size()) - 1;
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

void put_fixed_triangle(AdvanceIsland& island, uint32_t row, uint32_t lane, ContactBlock& block) {
    AdvanceScratch& s = island.scratch;
    const uint32_t other = island.rows.other[row];
    const RigidMap& place = s.rigid[s.slot_of_body[other]].place[0];
    const Meshes& meshes = island.inputs.meshes;
    const uint32_t first = meshes.info[island.inputs.bodies.mesh[other]].vertices.first;
    for (uint32_t k = 0; k < 3; ++k) {
        const Vec4d corner = to_vec4(meshes.position[first + island.rows.triangle[row][k]]);
        set_lane(s.fixed[block.fixed].corner[k], lane, place(corner));
        block.weight[k].lane[lane] = island.rows.weight[row][k];
    }
    set_lane(block.normal, lane, place.turn(to_vec4(island.rows.normal[row])));
}

// As make_plan, of a row that fits_block.
void put_row(AdvanceIsland& island, uint32_t row, const RowSketch& sketch, ContactBlock& block) {
    const ContactRows& rows = island.rows;
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
        put_fixed_triangle(island, row, lane, block);
    }
    const Bodies& bodies = island.inputs.bodies;
    const uint32_t other = rows.other[row];
    if (island.inputs.meshes.info[bodies.mesh[other]].admission == Admission::kSheet) block.offset[lane] = 0.5 * bodies.thickness[other];
    block.friction.lane[lane] = rows.friction[row];
    block.row[lane] = row;
    if (!std::isinf(rows.distance[row])) block.open |= uint8_t(1u << lane);
    const Vec4d start = start_impulse(island, row), normal = lane_of(block.normal, lane);
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
inline __attribute__((always_inline)) void for_active_blocks(AdvanceScratch& s, const RowGroup& group, BlockPart part, const Run& run) {
    const std::vector<uint32_t>& active = group.active_block;
    for (size_t i = 0; i < active.size(); ++i) {
        if (i + kBlocksAhead < active.size()) fetch(s.block[active[i + kBlocksAhead]], part);
        run(s.block[active[i]]);
    }
}

// Deals rows out to the blocks of a group: each to the first of a few unfinished ones that has none of its nodes.
class BlockDealer {
 public:
    explicit BlockDealer(AdvanceScratch& s) : s_(s) { block_.fill(kNone); }
    void add(RowSketch& row) {
        const RowNodes nodes = nodes_of(row);
        uint32_t shared = 0;
        for (uint32_t k = 0; k < nodes.count; ++k) shared |= s_.open_blocks_of_node[nodes.node[k]];
        uint32_t slot = uint32_t(std::countr_one(shared));
        if (slot >= kOpenBlocks) close(slot = next_ = (next_ + 1) % kOpenBlocks);
        if (block_[slot] == kNone) block_[slot] = count_++;
        row.block = block_[slot];
        row.lane = static_cast<uint8_t>(row_[slot].count);
        row_[slot].nodes[row_[slot].count++] = nodes;
        for (uint32_t k = 0; k < nodes.count; ++k) s_.open_blocks_of_node[nodes.node[k]] |= uint16_t(1u << slot);
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
            for (uint32_t k = 0; k < nodes.count; ++k) s_.open_blocks_of_node[nodes.node[k]] &= uint16_t(~(1u << slot));
        }
        block_[slot] = kNone;
        row_[slot].count = 0;
    }
    struct Rows {
        std::array<RowNodes, 4> nodes;
        uint32_t count = 0;
    };
    AdvanceScratch& s_;
    std::array<uint32_t, kOpenBlocks> block_;  // per slot: row of block in the group, or kNone
    std::array<Rows, kOpenBlocks> row_;        // and what is in it
    uint32_t count_ = 0;
    uint32_t next_ = 0;  // slot to close when none will do
};

// Places of the nodes of one part of a block, one of the fields of ContactNodes.
inline __attribute__((always_inline)) FourPoints part_of(const AdvanceScratch& s, const ContactBlock& block, uint32_t part,
                                                         RawVector<Vec4d> ContactNodes::*field) {
    const auto& n = block.node[part];
    const Vec4d* value = (s.node.*field).data();
    return side_by_side(value[n[0]], value[n[1]], value[n[2]], value[n[3]]);
}
inline __attribute__((always_inline)) Vec4d inv_mass_of(const AdvanceScratch& s, const ContactBlock& block, uint32_t part) {
    const auto& n = block.node[part];
    const double* value = s.node.inv_mass.data();
    return Vec4d{value[n[0]], value[n[1]], value[n[2]], value[n[3]]};
}
inline __attribute__((always_inline)) FourPoints point_of(const AdvanceScratch& s, const ContactBlock& block,
                                                          RawVector<Vec4d> ContactNodes::*field) {
    const FourPoints first = part_of(s, block, 0, field);
    if (!block.edges) return first;
    const Vec4d along = wide(block.along);
    return (1 - along) * first + along * part_of(s, block, 1, field);
}
inline __attribute__((always_inline)) FourPoints weighted(const std::array<Vec4d, 3>& w, const FourPoints& a, const FourPoints& b,
                                                          const FourPoints& c) {
    return w[0] * a + w[1] * b + w[2] * c;
}
inline __attribute__((always_inline)) std::array<Vec4d, 3> corner_weights(const ContactBlock& block) {
    return {wide(block.weight[0]), wide(block.weight[1]), wide(block.weight[2])};
}
inline __attribute__((always_inline)) FourPoints plane_of(const AdvanceScratch& s, const ContactBlock& block,
                                                          RawVector<Vec4d> ContactNodes::*field) {
    return weighted(corner_weights(block), part_of(s, block, 2, field), part_of(s, block, 3, field), part_of(s, block, 4, field));
}
// Corners of the planes: their places, or where they are after the substep.
inline __attribute__((always_inline)) FourPoints corner_of(const AdvanceScratch& s, const ContactBlock& block, uint32_t k,
                                                           RawVector<Vec4d> ContactNodes::*field) {
    return block.fixed == kNone ? part_of(s, block, 2 + k, field) : s.fixed[block.fixed].corner[k];
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

void end_rows(AdvanceIsland& island, ContactBlock& block, Mask4 ended) {
    for (uint32_t lane = 0; lane < 4; ++lane) {
        if (ended[lane] == 0) continue;
        end_row(island, block.row[lane]);
    }
    block.open &= uint8_t(~mask_bits(ended));
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
bool activate_block(AdvanceIsland& island, double reach, ContactBlock& block) {
    const AdvanceScratch& s = island.scratch;
    const FourPoints a = corner_of(s, block, 0, &ContactNodes::place), b = corner_of(s, block, 1, &ContactNodes::place),
                     c = corner_of(s, block, 2, &ContactNodes::place);
    const std::array<Vec4d, 3> fixed = corner_weights(block);
    const FourPoints point = point_of(s, block, &ContactNodes::place), plane = weighted(fixed, a, b, c);
    const Vec4d gap = dot(block.normal, point - plane) - block.offset;
    Mask4 active = mask_lanes(block.open) & (gap < reach);
    if (!any(active)) return false;
    // what is inside acts whatever its velocity, if only that is finite
    if (!std::isfinite(reach) || any(active & (gap >= 0))) {
        FourPoints velocity = point_of(s, block, &ContactNodes::velocity);
        if (block.fixed == kNone) velocity = velocity - plane_of(s, block, &ContactNodes::velocity);
        const Vec4d gap_after = gap + least(dot(block.normal, velocity), Vec4d{}) * island.dt;
        const Vec4d all = gap_after + norm2(velocity);  // not finite if one of them is not
        active &= (gap_after < 0) & (all - all == 0);
        if (!any(active)) return false;
    }
    const FourFeet feet = find_feet(a, b, c, point, plane, block.normal, fixed);
    if (any(feet.left_behind & active)) {
        end_rows(island, block, feet.left_behind & active);
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
        sum += lever * lever * inv_mass_of(s, block, k);
    }
    block.inv_sum = keep(active & (sum > 0), 1 / sum);
    block.least_velocity = keep(active, -greatest(gap, Vec4d{}) / island.dt);
    // of the substep before: start_blocks
    const Mask4 warm = starts_warm(island) ? active : Mask4{};
    block.normal_impulse = keep(warm, block.normal_impulse);
    block.friction_impulse = keep(warm, block.friction_impulse);
    return true;
}

// Adds to a field of the nodes of one part.
void add_to_part(AdvanceScratch& s, const ContactBlock& block, uint32_t part, const FourPoints& way,
                 RawVector<Vec4d> ContactNodes::*field) {
    const std::array<Vec4d, 4> ways = one_by_one(way);
    Vec4d* value = (s.node.*field).data();
    for (uint32_t lane = 0; lane < 4; ++lane) value[block.node[part][lane]] += ways[lane];
}

// As solve_row, for four rows.
template <bool kEdges, uint32_t kMoving>
void solve_block(AdvanceScratch& s, ContactBlock& block) {
    const Mask4 active = mask_lanes(block.active);
    Vec4d lever[kMoving];
    FourPoints part[kMoving];
    FourPoints velocity;
    for (uint32_t k = 0; k < kMoving; ++k) {
        if (k == 1 && !kEdges) continue;
        lever[k] = lever_of<kEdges>(block, active, k);
        part[k] = part_of(s, block, k, &ContactNodes::velocity);
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
        const std::array<Vec4d, 4> now = one_by_one(part[k] + (lever[k] * inv_mass_of(s, block, k)) * impulse);
        for (uint32_t lane = 0; lane < 4; ++lane) s.node.velocity[block.node[k][lane]] = now[lane];
    }
}

// Gaps at the end of the substep, as gap_after.
Vec4d gaps_after(const AdvanceScratch& s, const ContactBlock& block) {
    const auto corner = [&](uint32_t k) { return corner_of(s, block, k, &ContactNodes::after); };
    const FourPoints foot = weighted(push_foot_of(block, mask_lanes(block.active)), corner(0), corner(1), corner(2));
    return dot(block.normal, point_of(s, block, &ContactNodes::after) + foot) + block.rest;
}

// As add_push, for the rows that are deep.
void add_pushes(const AdvanceIsland& island, const ContactBlock& block, const FourPoints& way, const Mask4& deep, uint8_t sweep) {
    AdvanceScratch& s = island.scratch;
    const bool by_mass = island.params.contact.share == ResponseShare::kMass;
    const Mask4 active = mask_lanes(block.active);
    const std::array<Vec4d, 3> foot = push_foot_of(block, active);
    Vec4d unit[kParts], lever[kParts], sum[2] = {}, scale[2];
    for (uint32_t k = 0; k < kParts; ++k) {
        const Vec4d inv_mass = inv_mass_of(s, block, k);
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
            if (deep[lane]) share[lane] = share_of_point(island, block.row[lane]);
        scale[0] = keep(sum[0] > 0, share / sum[0]);
        scale[1] = keep(sum[1] > 0, (1 - share) / sum[1]);
    }
    for (uint32_t k = 0; k < parts_of(block); ++k) {
        if (k == 1 && !block.edges) continue;
        add_to_part(s, block, k, (lever[k] * unit[k] * scale[k >= 2]) * way, &ContactNodes::after);
        for (uint32_t lane = 0; lane < 4; ++lane)
            if (deep[lane] && unit[k][lane] > 0) s.moved_in[block.node[k][lane]] = sweep;
    }
}

// Whether a node of a block has moved in a sweep or a later one.
bool has_moved(const AdvanceScratch& s, const ContactBlock& block, uint8_t since) {
    bool moved = false;
    for (uint32_t k = 0; k < parts_of(block); k += k == 0 && !block.edges ? 2 : 1)
        for (const uint32_t node : block.node[k]) moved |= s.moved_in[node] >= since;
    return moved;
}

// Deals out the rows of a group that fit, and counts its blocks.
void deal_blocks(AdvanceScratch& s, RowGroup& group) {
    BlockDealer dealer(s);
    uint32_t before_fixed = 0;
    for (uint8_t kind = 0; kind < kKinds; ++kind) {
        if (kind == kFixedPlane) before_fixed = dealer.count();
        for (uint32_t i = group.plan.first; i < group.plan.end(); ++i)
            if (s.sketch[i].kind == kind) dealer.add(s.sketch[i]);
        dealer.close_all();
    }
    group.block.count = dealer.count();
    group.fixed.count = dealer.count() - before_fixed;
}

void fill_blocks(AdvanceIsland& island, const RowGroup& group) {
    AdvanceScratch& s = island.scratch;
    const uint32_t before_fixed = group.block.count - group.fixed.count;
    for (uint32_t i = group.plan.first; i < group.plan.end(); ++i) {
        if (i + kRowsAhead < group.plan.end()) fetch_row(island.rows, s.dealt[i + kRowsAhead]);
        const RowSketch& row = s.sketch[i];
        if (row.kind == RowSketch::kSingle) continue;
        ContactBlock& block = s.block[group.block.first + row.block];
        if (row.lane == 0) {  // the first of the block
            if (row.block + kBlocksAhead < group.block.count) fetch(s.block[group.block.first + row.block + kBlocksAhead], kWholeBlock);
            clear_block(group.idle, block);
            if (row.block >= before_fixed) {
                block.fixed = group.fixed.first + row.block - before_fixed;
                s.fixed[block.fixed] = {};
            }
        }
        put_row(island, s.dealt[i], row, block);
    }
}

// Places of the blocks of all groups, one after the other.
void lay_out_blocks(AdvanceScratch& s) {
    uint32_t blocks = 0, fixed = 0;
    for (uint32_t g = 0; g < s.phase[4]; ++g) {
        RowGroup& group = s.group[g];
        group.block.first = blocks, group.fixed.first = fixed;
        blocks += group.block.count, fixed += group.fixed.count;
        make_room(group.active_block, group.block.count);
    }
    have_rows(s.block, blocks);
    have_rows(s.fixed, fixed);
}

// Plans the rows that are not in a block; all of them without sketches.
void plan_single_rows(AdvanceIsland& island, bool sketched) {
    AdvanceScratch& s = island.scratch;
    const auto is_single = [&](uint32_t i) { return !sketched || s.sketch[i].kind == RowSketch::kSingle; };
    // the list of single rows, in place
    uint32_t count = 0;
    for (uint32_t g = 0; g < s.phase[4]; ++g) {
        RowGroup& group = s.group[g];
        const uint32_t first = count;
        for (uint32_t i = group.plan.first; i < group.plan.end(); ++i)
            if (is_single(i)) s.dealt[count++] = s.dealt[i];
        group.plan = {first, count - first};
    }
    make_room(s.plan, count);
    s.plan.resize(count);
    parallel_for(count, any_rides(s) ? std::max(count, 1u) : kPlansPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) s.plan[i] = make_plan(island, s.dealt[i]);
    });
}

}  // namespace

void plan_blocks(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    for (uint32_t g = 0; g < s.phase[4]; ++g) s.group[g].block = s.group[g].fixed = {};
    const uint32_t rows = static_cast<uint32_t>(s.dealt.size());
    if (rows < kFewestRows) {
        plan_single_rows(island, false);
        return;
    }
    have_rows(s.sketch, rows);
    make_room(s.may_oppose, s.node.capacity());
    parallel_for(rows, kPlansPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            if (i + kRowsAhead < end) fetch_sides(island.rows, s.dealt[i + kRowsAhead]);
            s.sketch[i] = make_sketch(island, s.dealt[i]);
        }
    });
    find_opposable(island);
    for (uint32_t g = 0; g < s.phase[4]; ++g) s.group[g].idle = add_idle_node(s);
    s.open_blocks_of_node.resize(s.node.size(), 0);
    for_each_group(s, [&](RowGroup& group) { deal_blocks(s, group); });
    lay_out_blocks(s);
    for_each_group(s, [&](RowGroup& group) { fill_blocks(island, group); });
    plan_single_rows(island, true);
}

void forget_blocks(AdvanceIsland& island) {
    const auto forget = [&](const ContactBlock& block) {
        for (uint32_t lane = 0; lane < 4; ++lane) {
            const uint32_t row = block.row[lane];
            if (row == kNone) continue;
            island.rows.impulse[row] += to_vec3(lane_of(block.impulse, lane));
            if (island.rows.carried.empty()) continue;
            const Vec4d last = block.normal_impulse[lane] * lane_of(block.normal, lane) + lane_of(block.friction_impulse, lane);
            island.rows.carried[row] = to_vec3(last / island.dt);
        }
    };
    const AdvanceScratch& s = island.scratch;
    const uint32_t blocks = s.group[s.phase[4] - 1].block.end();
    parallel_for(blocks, 256, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) forget(s.block[i]);
    });
}

void activate_blocks(AdvanceIsland& island, double reach, RowGroup& group) {
    AdvanceScratch& s = island.scratch;
    group.active_block.clear();
    uint64_t active = 0;
    for (uint32_t i = group.block.first; i < group.block.end(); ++i) {
        if (i + kBlocksAhead < group.block.end()) fetch(s.block[i + kBlocksAhead], kWholeBlock);
        ContactBlock& block = s.block[i];
        if (block.open == 0 || !activate_block(island, reach, block)) {
            block.normal_impulse = Vec4d{};
            block.friction_impulse = FourPoints{};
            continue;
        }
        group.active_block.push_back(i);
        active += uint32_t(std::popcount(block.active));
    }
    std::atomic_ref(island.result.active_rows).fetch_add(active, std::memory_order_relaxed);
}

void start_blocks(AdvanceScratch& s, const RowGroup& group) {
    for_active_blocks(s, group, kSweepPart, [&](const ContactBlock& block) {
        if (!any(block.normal_impulse > 0)) return;
        const FourPoints impulse = block.normal_impulse * block.normal + block.friction_impulse;
        const Mask4 active = mask_lanes(block.active);
        for (uint32_t k = 0; k < parts_of(block); ++k) {
            if (k == 1 && !block.edges) continue;
            add_to_part(s, block, k, (lever_of(block, active, k) * inv_mass_of(s, block, k)) * impulse, &ContactNodes::velocity);
        }
    });
}

void solve_blocks(AdvanceScratch& s, const RowGroup& group) {
    for_active_blocks(s, group, kSweepPart, [&](ContactBlock& block) {
        if (block.fixed == kNone) {
            block.edges ? solve_block<true, kParts>(s, block) : solve_block<false, kParts>(s, block);
        } else {
            block.edges ? solve_block<true, 2>(s, block) : solve_block<false, 2>(s, block);
        }
    });
}

void add_block_impulses(AdvanceScratch& s, const RowGroup& group) {
    for_active_blocks(s, group, kSumPart, [&](ContactBlock& block) {
        block.impulse = block.impulse + (block.normal_impulse * block.normal + block.friction_impulse);
    });
}

bool push_blocks(AdvanceIsland& island, const PushSweep& sweep, const RowGroup& group) {
    AdvanceScratch& s = island.scratch;
    bool pushed = false;
    for_active_blocks(s, group, kGapPart, [&](const ContactBlock& block) {
        if (sweep.since > 0 && !has_moved(s, block, sweep.since)) return;
        const Vec4d overlap = -gaps_after(s, block);
        Mask4 deep = mask_lanes(block.active) & (overlap > sweep.least);
        if (sweep.stamp > 1) deep &= overlap <= sweep.most;
        if (!any(deep)) return;
        add_pushes(island, block, keep(deep, least(overlap, all_lanes(sweep.most))) * block.normal, deep, sweep.stamp);
        pushed = true;
    });
    return pushed;
}

double deepest_in_blocks(AdvanceScratch& s, const RowGroup& group) {
    Vec4d deepest = {};
    for_active_blocks(s, group, kGapPart, [&](const ContactBlock& block) {
        deepest = greatest(keep(mask_lanes(block.active), -gaps_after(s, block)), deepest);
    });
    return std::max({deepest[0], deepest[1], deepest[2], deepest[3]});
}

}  // namespace trocar
