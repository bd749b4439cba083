#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/contacts.hpp"
namespace trocar {

struct CandidateCellsScratch {
    std::vector<uint32_t> pair_first;  // per body: its first pair as a
    // one row per find, in cell order, then by (row of a, row of b), then by pair
    std::vector<std::array<uint32_t, 3>> found, by_row;  // ScreenedTriangles rows of a and b, pair
    std::vector<uint32_t> first;                         // counting sort
    std::vector<uint32_t> sweep_a, sweep_b;              // rows of a cell worth testing
};

// OHC instruction (thesis 3.3.2): for every candidate pair the triangle pairs whose enlarged boxes meet, read from the
// shared cells and the oversize list, ascending. Each pair of triangles is reported once: by the cell that holds the
// larger of their lower corners.
void find_candidate_triangles(const CandidatePairs& pairs, const ScreenedTriangles& screened,
                              const Occupancy& occupancy, CandidateCellsScratch& scratch,
                              CandidateTriangles& candidates);

}  // namespace trocar
