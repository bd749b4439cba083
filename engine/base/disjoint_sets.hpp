#pragma once
#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace trocar {

// Disjoint sets over 0..count-1 in one array, each identified by its lowest member.
inline std::vector<uint32_t> make_sets(uint32_t count) {
    std::vector<uint32_t> sets(count);
    std::iota(sets.begin(), sets.end(), 0u);
    return sets;
}
inline uint32_t find_set(std::vector<uint32_t>& sets, uint32_t i) {
    while (sets[i] != i) i = sets[i] = sets[sets[i]];
    return i;
}
inline void join_sets(std::vector<uint32_t>& sets, uint32_t i, uint32_t j) {
    i = find_set(sets, i);
    j = find_set(sets, j);
    sets[std::max(i, j)] = std::min(i, j);
}

}  // namespace trocar
