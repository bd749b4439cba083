#pragma once
#include "components/contacts.hpp"
namespace trocar {

// Whether a candidate pair has so few screened triangles, at most `most` pairs of them, that all are compared with all:
// its bodies need no cells for each other.
inline bool is_direct(const CandidatePairs& pairs, const ScreenedTriangles& screened, uint32_t pair, uint64_t most) {
    return uint64_t{screened.body[pairs.a[pair]].count} * screened.body[pairs.b[pair]].count <= most;
}

}  // namespace trocar
