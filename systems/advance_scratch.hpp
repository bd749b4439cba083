#pragma once
#include <array>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Reused memory of advance_island, one per thread that may run it. Its content means nothing between calls.
struct AdvanceScratch {
    std::vector<Float4> offset_a, offset_b;  // the two buffers of a substep, bodies of the island one after the other
};

}  // namespace trocar
