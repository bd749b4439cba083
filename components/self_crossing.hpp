#pragma once
#include <cstdint>
#include <vector>

#include "components/fields.hpp"
namespace trocar {

// Pairs of faces of one body that cross, as found at the end of the displayed frame, one element per body; 0 for rigid ones,
// whose surfaces are judged when they are read.
struct SelfCrossingCounts {
    std::vector<uint64_t> pairs;
    TROCAR_FIELDS(pairs);
};

}  // namespace trocar
