#pragma once
#include <vector>

#include "engine/contact_inputs.hpp"
namespace trocar {

// A place where an edge of one body passes a triangle of the other.
struct ContourHit {
    uint64_t key = 0;  // bit 63: edge of b; 31 bits edge, 32 bits triangle
    double along = 0;  // from the edge's lower vertex
    bool outward = false;
};

// One pair of triangles that cross: the segment runs from hit[0] to hit[1].
struct ContourPiece {
    std::array<uint32_t, 2> triangle{};
    std::array<ContourHit, 2> hit;
};

// One end of a piece, for finding the pieces that share a point.
struct ContourEnd {
    uint64_t key;
    uint32_t piece;
    uint32_t which;  // 0 start, 1 end
};

// Working arrays and results of a run of pairs; rows of a pair count from its first.
struct ContourChunk {
    std::vector<ContourPiece> piece;  // of the pair at hand
    std::vector<ContourEnd> end;
    std::vector<uint32_t> next, before;             // per piece: the one that goes on at its end; that leads to it
    std::vector<std::array<uint32_t, 2>> point_of;  // per piece: points of its two ends
    std::vector<uint8_t> done;
    Contours found;                       // of all pairs of the run
    std::vector<Range> points, segments;  // per pair of the run
};

struct ContoursScratch {
    std::vector<ContourChunk> chunk;
};

// Intersection stage: exact crossings of the candidate triangles of every pair, chained into curves (see Contours).
// Which edge passes which triangle is decided by exact signs on vertices in doubles relative to a's origin; places are
// rounded to doubles. For any number of threads the same bits.
void find_contours(const ContactInputs& in, const CandidateTriangles& candidates, ContoursScratch& scratch, Contours& contours);

}  // namespace trocar
