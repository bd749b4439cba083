#pragma once
#include <array>
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

// One triangle in one cell.
struct CellReference {
    uint32_t slot = 0;  // of the table; in pass 2 the row of the shared cell
    uint32_t row = 0;   // of ScreenedTriangles
    uint32_t body = 0;
};

// What the screening of one body found.
struct BodyScreen {
    std::vector<uint8_t> outcode;  // per vertex: sides of the region it lies beyond
    std::vector<uint32_t> triangle;
    std::vector<PackedBox> box, tight;
    double edge_sum = 0;  // m
};

struct RasteriseScratch {
    std::vector<Box> region;                      // overlap box of each candidate pair, world
    std::vector<uint32_t> region_first;           // per body: rows of region_pair
    std::vector<uint32_t> region_pair;            // pairs of a body
    std::vector<PackedBox> packed_region;         // in that order
    std::vector<uint32_t> body;                   // bodies in a pair, ascending
    std::vector<BodyScreen> screen;               // per row of body
    std::vector<CountedCell> table;               // open addressing, a power of two
    std::vector<uint32_t> used_slot;              // to clear the table
    uint32_t factor = 0;                          // which one the table is hashed with; any gives the same layers
    std::vector<CellReference> reference;         // one per (triangle, cell) of pass 1, then of the shared cells
    uint32_t references = 0;                      // rows of it in use
    std::vector<std::array<uint64_t, 2>> shared;  // key, row in order of discovery
    std::vector<uint32_t> rank;                   // of a shared cell by key
    std::vector<uint32_t> cell_first, next, cell_body;
};

// OHC construction (thesis 3.3.1): rasterises the triangles that lie in the overlap of two enlarged body boxes into a
// grid of half-open cells. Pass 1 counts the bodies of each cell, pass 2 fills only cells of two or more. Layers ascend
// by cell key, body and triangle, whatever the table holds. Triangles of more than 64 cells go to the oversize list.
void rasterise(const ContactParams& params, const Surfaces& surfaces, const BodyBoxes& boxes,
               const CandidatePairs& pairs, RasteriseScratch& scratch, Report& report, ScreenedTriangles& screened,
               Occupancy& occupancy);

}  // namespace trocar
