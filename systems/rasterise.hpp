#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/report.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// One slot of the object counting table (thesis, figure 3.7 b).
struct CountedCell {
    uint64_t key = 0;     // packed cell, compared on every lookup
    uint32_t object = 0;  // last body that touched the cell
    uint32_t shared = 0;  // 0 while only one body did, then 1 + row of the shared cell
};

struct RasteriseScratch {
    std::vector<Box> region;               // overlap box of each candidate pair
    std::vector<uint32_t> region_first;    // per body: rows of region_pair
    std::vector<uint32_t> region_pair;     // pairs of a body, ascending
    std::vector<uint8_t> outcode;          // per vertex of one body
    std::vector<Vec3d> position;           // of one body, world
    std::vector<CountedCell> table;        // open addressing, a power of two
    std::vector<uint32_t> reference_slot;  // one per (triangle, cell) of pass 1
    std::vector<uint32_t> reference_row;   // ScreenedTriangles row of the same
    std::vector<uint32_t> used_slot;       // to clear the table
    std::vector<uint64_t> shared_key;
    std::vector<uint32_t> shared_slot, order, order_next, cell_first, row_body, cell_row;
};

// OHC construction (thesis 3.3.1): rasterises the triangles that lie in the overlap of two enlarged body boxes into a
// grid of half-open cells. Pass 1 counts the bodies of each cell, pass 2 fills only cells of two or more. Layers ascend
// by cell key, body and triangle, whatever the table holds. Triangles of more than 64 cells go to the oversize list.
void rasterise(const ContactParams& params, const Surfaces& surfaces, const BodyBoxes& boxes,
               const CandidatePairs& pairs, RasteriseScratch& scratch, Report& report, ScreenedTriangles& screened,
               Occupancy& occupancy);

}  // namespace trocar
