#pragma once
#include <span>

#include "components/math.hpp"
namespace trocar {

// The rows of a flat array that a range names.
template <typename Rows>  // Rows: a vector or a span, const or not
auto subspan(Rows& all, Range rows) {
    return std::span(all).subspan(rows.first, rows.count);
}

}  // namespace trocar
