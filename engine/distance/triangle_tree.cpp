#include "engine/distance/triangle_tree.hpp"

#include <immintrin.h>

#include <algorithm>
#include <bit>
#include <limits>

#include "engine/distance/box_tree.hpp"
namespace trocar {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

void clear(EightBoxes& boxes) { std::fill_n(&boxes.side[0][0], 48, kInfinity); }
void clear(PackedBox& box) { box.min.fill(kInfinity), box.neg_max.fill(kInfinity); }

void put(const PackedBox& box, uint32_t lane, EightBoxes& boxes) {
    for (uint32_t k = 0; k < 3; ++k) boxes.side[k][lane] = box.min[k], boxes.side[3 + k][lane] = box.neg_max[k];
}
PackedBox box_at(const EightBoxes& boxes, uint32_t lane) {
    PackedBox box;
    for (uint32_t k = 0; k < 3; ++k) box.min[k] = boxes.side[k][lane], box.neg_max[k] = boxes.side[3 + k][lane];
    return box;
}
void grow(PackedBox& box, const PackedBox& other) {
    for (uint32_t k = 0; k < 3; ++k)
        box.min[k] = std::min(box.min[k], other.min[k]), box.neg_max[k] = std::min(box.neg_max[k], other.neg_max[k]);
}
PackedBox hull_of(const EightBoxes& boxes) {
    PackedBox hull = box_at(boxes, 0);
    for (uint32_t lane = 1; lane < 8; ++lane) grow(hull, box_at(boxes, lane));
    return hull;
}

// Which of eight boxes meet one: bits.
uint32_t meeting(const EightBoxes& boxes, const PackedBox& box) {
    const auto below = [&](uint32_t side, float limit) {
        return _mm256_cmp_ps(_mm256_load_ps(boxes.side[side]), _mm256_set1_ps(-limit), _CMP_LE_OQ);
    };
    __m256 met = below(0, box.neg_max[0]);
    for (uint32_t k = 1; k < 3; ++k) met = _mm256_and_ps(met, below(k, box.neg_max[k]));
    for (uint32_t k = 0; k < 3; ++k) met = _mm256_and_ps(met, below(3 + k, box.min[k]));
    return static_cast<uint32_t>(_mm256_movemask_ps(met));
}

template <typename Visit>  // Visit: void(uint32_t bit)
void for_each_bit(uint32_t bits, const Visit& visit) {
    for (; bits != 0; bits &= bits - 1) visit(static_cast<uint32_t>(std::countr_zero(bits)));
}

// Puts the screened triangles into their groups.
void fill_groups(std::span<const uint32_t> lane_of_triangle, const ScreenedTriangles& screened, Range rows, TriangleTree& out) {
    for (uint32_t row = rows.first; row < rows.end(); ++row) {
        const uint32_t lane = lane_of_triangle[screened.triangle[row]], group = lane / 16, at = lane % 16;
        if (out.present[group] == 0) {
            for (uint32_t half = 0; half < 2; ++half) clear(out.box[group][half]), clear(out.own[group][half]);
            clear(out.hull[group]);
        }
        out.present[group] |= static_cast<uint16_t>(1u << at);
        out.row[group][at] = row;
        put(screened.box[row], at % 8, out.box[group][at / 8]);
        put(screened.tight[row], at % 8, out.own[group][at / 8]);
        grow(out.hull[group], screened.box[row]);
    }
}

// Pairs of children of two nodes, or of children of one and a group, whose hulls meet.
template <typename Visit>  // Visit: void(NodePair)
void for_each_pair_below(const TriangleTree& a, const TriangleTree& b, NodePair pair, const Visit& visit) {
    const auto [n, m] = pair;
    if (n >= kBoxLeaf) {
        for_each_bit(meeting(b.child[m], a.hull[n & ~kBoxLeaf]), [&](uint32_t j) { visit({n, b.hierarchy->node[m].child[j]}); });
    } else if (m >= kBoxLeaf) {
        for_each_bit(meeting(a.child[n], b.hull[m & ~kBoxLeaf]), [&](uint32_t i) { visit({a.hierarchy->node[n].child[i], m}); });
    } else {
        const BoxNode &own = a.hierarchy->node[n], &other = b.hierarchy->node[m];
        for (uint32_t i = 0; i < own.count; ++i)
            for_each_bit(meeting(b.child[m], box_at(a.child[n], i)), [&](uint32_t j) { visit({own.child[i], other.child[j]}); });
    }
}

bool are_groups(NodePair pair) { return pair[0] >= kBoxLeaf && pair[1] >= kBoxLeaf; }

void compare_groups(const TriangleTree& a, const TriangleTree& b, NodePair pair, std::vector<MeetingTriangles>& found) {
    const uint32_t n = pair[0] & ~kBoxLeaf, m = pair[1] & ~kBoxLeaf;
    const uint32_t near = meeting(a.box[n][0], b.hull[m]) | meeting(a.box[n][1], b.hull[m]) << 8;
    for_each_bit(near, [&](uint32_t i) {
        const uint32_t row = a.row[n][i];
        for (uint32_t half = 0; half < 2; ++half) {
            const uint32_t met = meeting(b.box[m][half], a.screened->box[row]);
            if (met == 0) continue;
            const uint32_t crossing = meeting(b.own[m][half], a.screened->tight[row]);
            for_each_bit(met, [&](uint32_t j) { found.push_back({row, b.row[m][8 * half + j], (crossing >> j & 1) != 0}); });
        }
    });
}

}  // namespace

void hang_triangles(const ClosestPointTree& tree, const ScreenedTriangles& screened, uint32_t body, TriangleTree& out) {
    out.hierarchy = &tree.hierarchy();
    out.screened = &screened;
    const std::vector<BoxNode>& node = out.hierarchy->node;
    const size_t groups = tree.groups();
    out.present.assign(groups, 0);
    out.hull.resize(groups), out.row.resize(groups), out.box.resize(groups), out.own.resize(groups);
    fill_groups(tree.lane_of_triangle(), screened, screened.body[body], out);
    out.child.resize(node.size());
    for (size_t n = node.size(); n-- > 0;) {
        clear(out.child[n]);
        for (uint32_t i = 0; i < node[n].count; ++i) {
            const uint32_t below = node[n].child[i], group = below & ~kBoxLeaf;
            if (below < kBoxLeaf)
                put(hull_of(out.child[below]), i, out.child[n]);
            else if (out.present[group] != 0)
                put(out.hull[group], i, out.child[n]);
        }
    }
}

void open_node_pairs(const TriangleTree& a, const TriangleTree& b, size_t enough, std::vector<NodePair>& pairs,
                     std::vector<NodePair>& scratch) {
    pairs.assign(1, {0, 0});
    for (bool deeper = true; deeper && pairs.size() < enough;) {
        scratch.clear();
        deeper = false;
        for (const NodePair& pair : pairs) {
            if (are_groups(pair)) {
                scratch.push_back(pair);
                continue;
            }
            deeper = true;
            for_each_pair_below(a, b, pair, [&](const NodePair& p) { scratch.push_back(p); });
        }
        pairs.swap(scratch);
    }
}

void find_meeting_triangles(const TriangleTree& a, const TriangleTree& b, NodePair from, std::vector<MeetingTriangles>& found) {
    if (are_groups(from)) return compare_groups(a, b, from, found);
    for_each_pair_below(a, b, from, [&](const NodePair& below) { find_meeting_triangles(a, b, below, found); });
}

}  // namespace trocar
