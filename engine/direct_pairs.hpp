#pragma once
#include "engine/contact_inputs.hpp"
namespace trocar {

// How the triangles of a candidate pair find each other. All ways find the same ones.
enum class PairSearch : uint8_t { kCells, kDirect, kTrees };

// A pair with few screened triangles, at most `most` pairs of them, has all compared with all. Of a pair with so many that
// cells would be crowded, an eighth of all that two bodies have and more than a few thousand, trees are walked. Neither needs
// cells. 0: all pairs do.
inline PairSearch pair_search(const ContactInputs& in, const ScreenedTriangles& screened, uint32_t pair, uint64_t most) {
    constexpr uint64_t kMany = 1 << 14;  // triangles from which trees may gain more than hanging them costs
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
