#pragma once
#include <vector>

#include "components/contacts.hpp"
namespace trocar {

// One side of a broad-phase pair: points of `body` against the surface of `other`. Side 2 * pair is that of
// the pair's a, side 2 * pair + 1 that of its b.
struct PairSide {
    uint32_t pair, body, other;
    bool reversed;  // body is the pair's b
};
inline PairSide pair_side(const BroadPhasePairs& pairs, uint32_t side) {
    const uint32_t pair = side / 2, a = pairs.a[pair], b = pairs.b[pair];
    const bool reversed = side % 2 != 0;
    return {pair, reversed ? b : a, reversed ? a : b, reversed};
}

// Finds the first contact of each pair, see range_at.
inline void find_first_contacts(const Contacts& contacts, size_t pairs, std::vector<uint32_t>& first) {
    first.assign(pairs + 1, 0);
    for (const uint32_t pair : contacts.pair) ++first[pair + 1];
    for (size_t pair = 0; pair < pairs; ++pair) first[pair + 1] += first[pair];
}

}  // namespace trocar
