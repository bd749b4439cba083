#pragma once
#include <algorithm>
#include <cstdint>
#include <vector>

namespace trocar {

// Disjoint sets of the rows 0, 1, 2...: parent[row] leads towards the root of a row's set, which is its smallest row.
inline uint32_t find_root(std::vector<uint32_t>& parent, uint32_t row) {
    while (parent[row] != row) row = parent[row] = parent[parent[row]];
    return row;
}
inline void join_sets(std::vector<uint32_t>& parent, uint32_t a, uint32_t b) {
    a = find_root(parent, a);
    b = find_root(parent, b);
    parent[std::max(a, b)] = std::min(a, b);
}

}  // namespace trocar
