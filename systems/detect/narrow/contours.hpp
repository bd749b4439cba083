#pragma once
#include <vector>

#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Point where an edge of one body passes through a triangle of the other.
struct ContourHit {
    uint64_t key = 0;  // bit 63: edge of b; 31 bits edge, 32 bits triangle
    double along = 0;  // from the edge's lower vertex
    bool outward = false;
};

// Intersection segment of two triangles, from hit[0] to hit[1].
struct ContourPiece {
    std::array<uint32_t, 2> triangle{};
    std::array<ContourHit, 2> hit;
};

// One end of a piece, used to match pieces that share a point.
struct ContourEnd {
    uint64_t key;
    uint32_t piece;
    uint32_t which;  // 0 start, 1 end
};

// Working arrays and results of a run of pairs; indices of a pair count from its first.
struct ContourChunk {
    std::vector<ContourPiece> piece;  // of the current pair
    std::vector<ContourEnd> end;
    std::vector<uint32_t> next, before;             // per piece: its successor and its predecessor
    std::vector<std::array<uint32_t, 2>> point_of;  // per piece: points of its two ends
    std::vector<uint8_t> done;
    Contours found;                       // of all pairs of the run
    std::vector<Range> points, segments;  // per pair of the run
};

struct ContoursScratch {
    std::vector<ContourChunk> chunk;
};

// Intersection stage: exact crossings of the candidate triangles of every pair, chained into curves (see
// Contours). Exact signs on vertices in doubles relative to a's origin decide which edge passes through which
// triangle; point positions are rounded to doubles. Bit-identical for any number of threads.
void find_contours(const ContactInputs& in, const CandidateTriangles& candidates, ContoursScratch& scratch, Contours& contours);

}  // namespace trocar
