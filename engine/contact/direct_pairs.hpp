#pragma once
#include "engine/contact/convex_pairs.hpp"
namespace trocar {

// Methods to find the triangles of a broad-phase pair that are near each other. All find the same ones. kNone: it needs no triangles.
enum class PairSearch : uint8_t { kCells, kDirect, kTrees, kNone };

// A pair with few screened triangles, up to `most` pairs of them, has all compared with all. A pair with so
// many that cells would be crowded, more than an eighth of all triangles of both bodies and more than a few
// thousand, uses trees. Neither needs cells. 0: all pairs do.
inline PairSearch pair_search(const ContactInputs& in, const ScreenedTriangles& screened, uint32_t pair, uint64_t most) {
    constexpr uint64_t kMany = 1 << 14;  // triangles from which trees may gain more than attaching them costs
    if (touch_as_hulls(in, pair)) return PairSearch::kNone;
    if (most == 0) return PairSearch::kCells;
    uint64_t product = 1, screened_sum = 0, sum = 0;
    for (const uint32_t body : {in.pairs.a[pair], in.pairs.b[pair]}) {
        product *= screened.body[body].count;
        screened_sum += screened.body[body].count;
        sum += in.surfaces.meshes.info[in.surfaces.bodies.mesh[body]].triangles.count;
    }
    if (product <= most) return PairSearch::kDirect;
    return screened_sum >= kMany && 8 * screened_sum >= sum ? PairSearch::kTrees : PairSearch::kCells;
}

}  // namespace trocar
