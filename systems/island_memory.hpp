#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Which islands are worked on in memory of their own. The threads' scratches all come to hold the largest island that they
// share: with one heap of a thousand bodies among single ones that is a heap for every thread. So of the `threads` largest
// islands those that are more than twice as large as what is left for sharing get a scratch of their own: own[island] is its
// row, 0 for the largest island, kNone for what is shared. `size`: particles of each island. Small ones are shared always,
// and with one thread all are. `order` is reused memory.
void pick_large_islands(std::span<const uint32_t> size, uint32_t threads, std::vector<uint32_t>& order, std::vector<uint32_t>& own);

}  // namespace trocar
