#pragma once
#include <vector>

#include "components/report.hpp"
#include "engine/contact/cell_bits.hpp"
#include "engine/contact/contact_inputs.hpp"
#include "engine/mesh/triangle_runs.hpp"
namespace trocar {

// One triangle in one cell.
struct CellReference {
    uint32_t cell = 0;   // index of the shared cell
    uint32_t index = 0;  // index into ScreenedTriangles
    uint32_t body = 0;
};

// The same before it is known which cells are shared.
struct KeyedReference {
    uint64_t key = 0;
    uint32_t index = 0;  // index into ScreenedTriangles
    uint32_t body = 0;
};

// Screening results of a few bodies, one after the other.
struct ScreenChunk {
    std::vector<uint8_t> outcode;     // per vertex of the current body: sides of the region beyond which it lies
    std::vector<uint8_t> block_code;  // per block of vertices: sides beyond which all of them lie
    std::vector<uint32_t> triangle;   // may be longer than the used part, as may the boxes
    std::vector<PackedBox> box, tight;
    uint32_t used = 0;  // in use
};

struct RasteriseScratch {
    std::vector<Box> region;               // overlap box of each broad-phase pair, world
    std::vector<uint32_t> region_first;    // per body: first index into region_pair
    std::vector<uint8_t> by_triangles;     // per pair: it has a region
    std::vector<uint32_t> region_pair;     // pairs of a body
    std::vector<PackedBox> packed_region;  // in the order of region_pair
    std::vector<uint32_t> body;            // bodies in a pair, ascending
    std::vector<TriangleRuns> runs;        // per prototype
    std::vector<ScreenChunk> screen;       // per chunk of `body`
    std::vector<uint32_t> kept;            // per entry of `body`: triangles
    std::vector<double> edge_sum;          // per entry of `body`, m
    std::vector<uint8_t> in_cells;         // per body: it has a pair that is not compared directly
    std::vector<CellReference> reference;  // one per (triangle, shared cell); may be longer than the used part
    std::vector<uint32_t> cell_first, next, cell_body;
    CellBits bits;
    std::vector<CellRange> cells;                    // with bits: per triangle of body, in order
    std::vector<KeyedReference> keyed, keyed_spare;  // instead of bits
    uint32_t most_words = 1 << 20;                   // of bits, 8 MB a layer; with more cells, references are sorted
};

// OHC construction (thesis 3.3.1): rasterises the triangles in the overlap of two enlarged body boxes into a
// grid of half-open cells. Pass 1 counts the bodies of each cell, pass 2 fills only cells of two or more.
// Layers ascend by cell key, body and triangle. Triangles of more than 64 cells go to the oversize list.
// Cells are counted by one bit each if the grid is small enough; else references are sorted by key, into the
// same layers. Bodies none of whose pairs needs cells (pair_search of engine/contact/direct_pairs.hpp, with
// most_direct) are omitted; 0: none is.
void rasterise(const ContactInputs& in, uint64_t most_direct, RasteriseScratch& scratch, Report& report, ScreenedTriangles& screened,
               Occupancy& occupancy);

}  // namespace trocar
