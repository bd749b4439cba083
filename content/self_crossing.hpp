#pragma once
#include <array>

#include "components/mesh.hpp"
namespace trocar {

// Pairs of faces of one mesh that meet elsewhere than at the corners and edges they share.
struct SelfCrossings {
    uint32_t crossing = 0;                              // pairs with a common inner point: cuts, folds in a plane, doubled faces
    uint32_t touching = 0;                              // pairs that only touch: a corner on a face, an edge on an edge
    std::array<uint32_t, 2> lowest_pair{kNone, kNone};  // of those seen, first by (lower, higher) face
};

// Counting stops here: a thousand copies of a thousand faces at one place have 5e11 such pairs.
inline constexpr uint32_t kSelfCrossingLimit = 1'000'000;

// Counts them exactly (no tolerance), up to about kSelfCrossingLimit. Faces without area are left out. Corners are shared when they are the
// same vertex, so weld first. Expects finite coordinates.
SelfCrossings count_self_crossings(const Mesh& mesh);

// Per face: 1 = it is one of such a pair.
std::vector<uint8_t> mark_self_crossings(const Mesh& mesh);

}  // namespace trocar
