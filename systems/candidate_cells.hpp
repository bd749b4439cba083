#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/body_jolt.hpp"
#include "engine/contact_inputs.hpp"
#include "engine/direct_pairs.hpp"
#include "engine/triangle_tree.hpp"
namespace trocar {

// Which pairs are compared without cells, and what that needs beside what all stages do.
struct DirectPairs {
    uint64_t most = 0;                 // see pair_search; 0: all pairs need cells
    std::span<const BodyJolt> jolt{};  // per body: what others may do to it in the period; may be empty
};

// Lower and negated upper ends of boxes, axis by axis; eights are full.
using BoxSides = std::array<std::vector<float>, 6>;

// What a run of directly compared pairs found, pair after pair, as local triangles.
struct DirectChunk {
    std::vector<std::array<uint32_t, 2>> crossing, near;
    std::vector<uint8_t> near_corners;  // per row of near
    std::vector<double> along[2];       // m, of the pair at hand: how far vertices may get on the way to the other body
    std::vector<uint32_t> rows[2];      // what meets the hull of the other body
    std::vector<uint8_t> corners[2];    // per row of those: bits of the corners that may get to the other body, or all
    BoxSides sides, tight_sides;        // of the enlarged boxes of rows[1] and of their own
    BoxSides hulls;                     // of the enlarged boxes, each of eight rows
    std::vector<uint8_t> met;           // per eight rows of rows[1]: bits of those near a triangle of the other body
    std::vector<uint32_t> across;       // per row of rows[1] that is: which
};
// Where a pair's finds are in its chunk.
struct DirectFinds {
    Range crossing;
    std::array<Range, 2> near;
};

// What a run of cells found, in cell order, or a run of pairs by their triangles too large for cells.
struct CellChunk {
    std::vector<std::array<uint32_t, 3>> crossing, near;  // ScreenedTriangles rows of a and b, pair; near: own, across, side
    std::vector<uint32_t> near_a, near_b;                 // rows of a cell that meet the hull of the other body's; large ones, others
    std::vector<uint32_t> sweep_a, sweep_b;               // those whose own boxes do
    BoxSides sides, hulls;                                // of near_b beside large ones
    std::vector<MeetingTriangles> meeting;                // below a pair of nodes
};
// What a thread remembers of the run of cells at hand.
struct NearSides {
    std::vector<uint32_t> last;  // per row of ScreenedTriangles: run and side it was last found near
    uint64_t search = 0;         // the search it is of
};

// Where the walk of two trees begins.
struct TreeSeed {
    uint32_t pair;
    NodePair from;
};

struct CandidateCellsScratch {
    std::vector<uint32_t> pair_first;             // per body: its first pair as a
    std::vector<CellChunk> cells;                 // per run of cells, then per run of pairs
    std::vector<NearSides> near_sides;            // per thread
    uint64_t search = 0;                          // searches there were
    std::vector<std::array<uint32_t, 3>> by_row;  // finds by (row of a, row of b), then by pair
    std::vector<uint32_t> first;                  // counting sort
    std::vector<DirectChunk> chunk;               // per chunk of pairs
    std::vector<PairSearch> search_of;            // per pair
    std::vector<DirectFinds> direct;              // per pair that is
    std::vector<TriangleTree> tree;               // per body in a pair of trees
    std::vector<uint32_t> tree_body;              // bodies that are
    std::vector<TreeSeed> seed;                   // of all pairs of trees
    std::vector<NodePair> open, opened;           // of the pair at hand
    std::vector<uint8_t> paired;                  // per body: deformable and in a pair
    std::vector<Vec3d> drift;                     // m/s, mean velocity of those
};

// OHC instruction (thesis 3.3.2): for every candidate pair the triangles that are near the other body and the triangle
// pairs that may cross, read from the shared cells and the oversize list, ascending. A pair that may cross is reported
// once, by the cell that holds the larger of the lower corners; a near triangle once, with one of the triangles it is near. Pairs
// with so many near triangles that cells would be crowded have Embree's trees walked instead. Pairs
// that are direct (both: engine/direct_pairs.hpp) have all their triangles compared, eight at a time; where each body is deformable or
// static those corners are left out, and triangles without a corner left, that cannot meet the other body in the period T. On the way w
// (unit; from one body's middle to the other's, or across the side where a static one's box is passed least) a vertex gets to
//   s(x) = x.w + |(v - u).w| T                 u the mean velocity of both bodies, none beside a static one
// and a corner of a stays when s(x) >= -max over b of s, taken on -w, less the slack
//   0.5 g T^2 + what others may do to both (jolt) + sum of 0.05 mean edge (of what deforms) + half the thickness of each.
void find_candidate_triangles(const ContactInputs& in, const DirectPairs& direct, const ScreenedTriangles& screened,
                              const Occupancy& occupancy, CandidateCellsScratch& scratch, CandidateTriangles& candidates);

}  // namespace trocar
