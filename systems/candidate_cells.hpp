#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/contacts.hpp"
namespace trocar {

struct CandidateCellsScratch {
    std::vector<uint32_t> pair_first;  // per body: its first pair as a
    // one row per find, in cell order, then by (row of a, row of b), then by pair
    std::vector<std::array<uint32_t, 3>> crossing, near;  // ScreenedTriangles rows of a and b, pair; near: own, across, side
    std::vector<std::array<uint32_t, 3>> by_row;
    std::vector<uint32_t> near_side;                     // per row of ScreenedTriangles: last side it was found near
    std::vector<uint32_t> first;                         // counting sort
    std::vector<uint32_t> near_a, near_b;                // rows of a cell that meet the hull of the other body's
    std::vector<uint32_t> sweep_a, sweep_b;              // those whose own boxes do
};

// OHC instruction (thesis 3.3.2): for every candidate pair the triangles that are near the other body and the triangle
// pairs that may cross, read from the shared cells and the oversize list, ascending. A pair that may cross is reported
// once, by the cell that holds the larger of the lower corners; a near triangle by the first cell that shows it.
void find_candidate_triangles(const CandidatePairs& pairs, const ScreenedTriangles& screened,
                              const Occupancy& occupancy, CandidateCellsScratch& scratch,
                              CandidateTriangles& candidates);

}  // namespace trocar
