#pragma once
#include <span>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// The elements of a flat array in a range.
template <typename Rows>  // Rows: a vector or a span, const or not
auto subspan(Rows& all, Range rows) {
    return std::span(all).subspan(rows.first, rows.count);
}

// The elements of group i, where first[i] is the first of each and the last entry is the end of all.
inline Range range_at(const std::vector<uint32_t>& first, uint32_t i) { return {first[i], first[i + 1] - first[i]}; }

}  // namespace trocar
