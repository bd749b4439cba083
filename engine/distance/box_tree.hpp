#pragma once
#include <immintrin.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>
namespace trocar {

struct alignas(32) FloatBox {
    float min[4], max[4];  // the fourth is unused
};

inline void clear(FloatBox& box) {
    box = {};
    for (int k = 0; k < 3; ++k) box.min[k] = INFINITY, box.max[k] = -INFINITY;
}
inline void grow(FloatBox& box, const FloatBox& other) {
    for (int k = 0; k < 3; ++k) {
        box.min[k] = std::min(box.min[k], other.min[k]);
        box.max[k] = std::max(box.max[k], other.max[k]);
    }
}
inline float half_area(const FloatBox& box) {
    const float x = box.max[0] - box.min[0], y = box.max[1] - box.min[1], z = box.max[2] - box.min[2];
    return x * y + y * z + z * x;
}

constexpr uint32_t kBoxLeaf = 1u << 31;  // a child that is a box, not a node

// Eight children, one per lane. Unused ones have an empty box, infinitely far from everything.
struct alignas(64) BoxNode {
    float low[3][8], high[3][8];
    alignas(32) uint32_t child[8];  // node, or kBoxLeaf | index of the box
    uint32_t count;
    uint32_t parent, slot;  // of the parent; 0 for the root
};

// Tree over boxes; root first, every child after its parent.
struct BoxTree {
    std::vector<BoxNode> node;
    double built_area = 0;  // summed area of nodes and boxes after the last build
    uint64_t builds = 0;    // by Embree
};

// Has Embree build the tree: binned surface-area heuristic (Wald, On fast construction of SAH-based bounding volume
// hierarchies, RT 2007), eight children a node, one box a leaf.
void build_box_tree(std::span<const FloatBox> boxes, BoxTree& tree);

// Refits the nodes to boxes that moved and returns the summed half areas of nodes and boxes, a measure of the
// query cost (Goldsmith & Salmon, IEEE CG&A 7(5), 1987).
double refit_box_tree(std::span<const FloatBox> boxes, BoxTree& tree);

// Largest depth of a tree: eight levels above it Embree switches to even splits. A search keeps at most 7 pending
// nodes per level and writes 8.
constexpr uint32_t kBoxDepth = 32;
constexpr uint32_t kBoxStack = 8 * kBoxDepth;

// For every set of lanes, its lanes in ascending order, then arbitrary ones: moves chosen lanes to the front.
inline constexpr auto kLanesToFront = [] {
    std::array<std::array<uint8_t, 8>, 256> table{};
    for (uint32_t set = 0; set < 256; ++set)
        for (uint32_t i = 0, to = 0; i < 8; ++i)
            if (set >> i & 1) table[set][to++] = static_cast<uint8_t>(i);
    return table;
}();

// Calls visit(box index) for boxes whose squared distance from q, in float, is at most `limit`, the nearest
// children first; visit returns the new limit, negative to stop. Rounding: limit must be a factor 1 + 16 *
// 2^-24 above the exact one.
template <typename Visit>  // Visit: float(uint32_t)
void visit_near_boxes(const BoxTree& tree, const float* q, float limit, const Visit& visit) {
    float squared[kBoxStack];
    uint32_t child[kBoxStack], height = 0, at = 0;
    const __m256 x = _mm256_set1_ps(q[0]), y = _mm256_set1_ps(q[1]), z = _mm256_set1_ps(q[2]);
    const auto outside = [](const float* low, const float* high, __m256 p) {
        return _mm256_max_ps(_mm256_max_ps(_mm256_sub_ps(_mm256_load_ps(low), p), _mm256_sub_ps(p, _mm256_load_ps(high))),
                             _mm256_setzero_ps());
    };
    for (;;) {
        if (at < kBoxLeaf) {
            const BoxNode& n = tree.node[at];
            const __m256 dx = outside(n.low[0], n.high[0], x), dy = outside(n.low[1], n.high[1], y), dz = outside(n.low[2], n.high[2], z);
            const __m256 d = _mm256_fmadd_ps(dz, dz, _mm256_fmadd_ps(dy, dy, _mm256_mul_ps(dx, dx)));
            const uint32_t near = static_cast<uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(d, _mm256_set1_ps(limit), _CMP_LE_OQ)));
            if (near != 0) {
                // distances >= 0 compare like integers; their upper halves suffice for the order
                const __m256i bits = _mm256_srli_epi32(_mm256_castps_si256(d), 16);
                const __m128i least = _mm_minpos_epu16(_mm_packus_epi32(_mm256_castsi256_si128(bits), _mm256_extracti128_si256(bits, 1)));
                const uint32_t best = static_cast<uint32_t>(_mm_cvtsi128_si32(least)) >> 16;
                const uint32_t others = near & ~(1u << best);
                const __m256i front = _mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(kLanesToFront[others].data())));
                _mm256_storeu_ps(squared + height, _mm256_permutevar8x32_ps(d, front));
                _mm256_storeu_si256(reinterpret_cast<__m256i*>(child + height),
                                    _mm256_permutevar8x32_epi32(_mm256_load_si256(reinterpret_cast<const __m256i*>(n.child)), front));
                height += static_cast<uint32_t>(std::popcount(others));
                at = n.child[best];
                continue;
            }
        } else {
            limit = visit(at & ~kBoxLeaf);
        }
        do {
            if (height == 0) return;
            --height;
        } while (!(squared[height] <= limit));
        at = child[height];
    }
}

}  // namespace trocar
