#pragma once
#include "components/contacts.hpp"
namespace trocar {

// One side of a candidate pair: points of `body` against the surface of `other`. Side 2 * pair is that of the pair's a, side
// 2 * pair + 1 that of its b.
struct PairSide {
    uint32_t pair, body, other;
    bool reversed;  // body is the pair's b
};
inline PairSide pair_side(const CandidatePairs& pairs, uint32_t side) {
    const uint32_t pair = side / 2, a = pairs.a[pair], b = pairs.b[pair];
    const bool reversed = side % 2 != 0;
    return {pair, reversed ? b : a, reversed ? a : b, reversed};
}

}  // namespace trocar
