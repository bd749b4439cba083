#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/external_displacement.hpp"
#include "engine/contact/contact_inputs.hpp"
#include "engine/contact/direct_pairs.hpp"
#include "engine/distance/triangle_tree.hpp"
namespace trocar {

// Selects the pairs that are compared without cells, and holds the extra input of that comparison.
struct DirectPairs {
    uint64_t most = 0;                                 // see pair_search; 0: all pairs need cells
    std::span<const ExternalDisplacement> external{};  // per body: external displacement bound in the period; may be empty
};

// Lower and negated upper ends of boxes, axis by axis, padded to a multiple of eight.
using BoxSides = std::array<std::vector<float>, 6>;

// Results of a run of directly compared pairs, pair after pair, as local triangles.
struct DirectChunk {
    std::vector<std::array<uint32_t, 2>> crossing, near;
    std::vector<uint8_t> near_corners;  // one per entry of near
    std::vector<double> along[2];       // m, of the current pair: how far vertices may get towards the other body
    std::vector<uint32_t> indices[2];   // triangles that overlap the hull of the other body
    std::vector<uint8_t> corners[2];    // per entry of indices: bits of the corners that may reach the other body, or all
    BoxSides sides, tight_sides;        // of indices[1]: enlarged boxes, and boxes without margin
    BoxSides hulls;                     // of the enlarged boxes, eight at a time
    std::vector<uint8_t> met;           // per eight of indices[1]: bits of those near a triangle of the other body
    std::vector<uint32_t> across;       // per entry of indices[1] that is near: that triangle
};
// Where a pair's results are in its chunk.
struct DirectFinds {
    Range crossing;
    std::array<Range, 2> near;
};

// Results of a run of cells, in cell order, or of a run of pairs with triangles too large for cells.
struct CellChunk {
    std::vector<std::array<uint32_t, 3>> crossing, near;  // indices into ScreenedTriangles of a and b, pair; near: own, across, side
    std::vector<uint32_t> near_a, near_b;                 // of a cell: those that overlap the hull of the
                                                          // other body's; or large ones, others
    std::vector<uint32_t> sweep_a, sweep_b;               // of these, those whose boxes without margin overlap it too
    BoxSides sides, hulls;                                // of near_b, for the test of large triangles
    std::vector<MeetingTriangles> meeting;                // below a pair of nodes
};
// One thread's record of which triangles the current run of cells has found near.
struct NearSides {
    std::vector<uint32_t> last;  // per entry of ScreenedTriangles: run and side it was last found near
    uint64_t search = 0;         // search that `last` belongs to
};

// Where the walk of two trees begins.
struct TreeSeed {
    uint32_t pair;
    NodePair from;
};

struct CandidateCellsScratch {
    std::vector<uint32_t> pair_first;               // per body: its first pair as a
    std::vector<CellChunk> cells;                   // per run of cells, then per run of pairs
    std::vector<NearSides> near_sides;              // per thread
    uint64_t search = 0;                            // number of searches made
    std::vector<std::array<uint32_t, 3>> by_index;  // results by (index of a, index of b), then by pair
    std::vector<uint32_t> first;                    // counting sort
    std::vector<DirectChunk> chunk;                 // per chunk of pairs
    std::vector<PairSearch> search_of;              // per pair
    std::vector<DirectFinds> direct;                // per direct pair
    std::vector<TriangleTree> tree;                 // per body in a pair of trees
    std::vector<uint32_t> tree_body;                // bodies that are
    std::vector<TreeSeed> seed;                     // of all pairs of trees
    std::vector<NodePair> open, opened;             // of the current pair
    std::vector<uint8_t> paired;                    // per body: deformable and in a pair
    std::vector<Vec3d> drift;                       // m/s, mean velocity of the paired bodies
};

// OHC instruction (thesis 3.3.2): finds for every broad-phase pair the triangles near the other body and the
// triangle pairs that may cross, ascending, from the shared cells and the oversize list. A crossing pair is
// reported once, by the cell with the larger of the lower corners; a near triangle once, with one of the
// triangles it is near. Pairs with so many near triangles that cells would be crowded use Embree's trees
// instead. Direct pairs (both: engine/contact/direct_pairs.hpp) have all triangles compared, eight at a time;
// between deformable and static bodies, corners that cannot reach the other body in the period T, and
// triangles left without corners, are omitted. Along the unit direction w (between the centres, or the face
// normal of a static body's box with least overlap) a vertex gets to
//   s(x) = x.w + |(v - u).w| T                 u the mean velocity of both bodies, 0 beside a static one
// and a corner of a stays if s(x) >= -max over b of s, taken on -w, less the slack
//   0.5 g T^2 + both external displacement bounds + 0.05 mean edge of each deformable body
//   + both half thicknesses.
void find_candidate_triangles(const ContactInputs& in, const DirectPairs& direct, const ScreenedTriangles& screened,
                              const Occupancy& occupancy, CandidateCellsScratch& scratch, CandidateTriangles& candidates);

}  // namespace trocar
