#pragma once
#include <array>

#include "components/mesh.hpp"
namespace trocar {

// Pairs of faces of one mesh that meet away from the corners and edges they share.
struct SelfCrossings {
    uint32_t crossing = 0;                              // common interior point: intersections, folds,
                                                        // duplicates
    uint32_t touching = 0;                              // touching pairs: a corner on a face, edges
    std::array<uint32_t, 2> lowest_pair{kNone, kNone};  // of the pairs seen, the first by face index
    uint64_t tested = 0;                                // pairs of faces tested exactly
};

// Counting stops here: a thousand copies of a thousand faces at one position have 5e11 such pairs.
inline constexpr uint32_t kSelfCrossingLimit = 1'000'000;

// Counts the pairs exactly (no tolerance), up to about kSelfCrossingLimit. Ignores zero-area faces. Corners
// are shared if they are the same vertex, so weld first. Expects finite coordinates.
SelfCrossings count_self_crossings(const Mesh& mesh);

// Per face: 1 = it belongs to such a pair.
std::vector<uint8_t> mark_self_crossings(const Mesh& mesh);

}  // namespace trocar
