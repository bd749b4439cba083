#pragma once
#include <vector>

#include "engine/contact/contact_inputs.hpp"
#include "engine/geometry/four_points.hpp"
namespace trocar {

// A triangle and its plane.
struct FlatTriangle {
    FourPoints corner;  // m; the fourth is the third
    Vec4d start = {};   // m, its first corner
    Vec4d normal = {};  // m^2, not of unit length
    double size2 = 0;   // m^4, product of the squared lengths of the edges that span the normal
};

struct SeparatingAxisScratch {
    struct Chunk {
        std::vector<FlatTriangle> flat;    // of the current pair's second body
        std::vector<uint32_t> flat_index;  // per triangle of it: index into flat, or kNone
        std::vector<uint32_t> used;        // triangles that have one
    };
    std::vector<Chunk> chunk;  // per run of pairs
};

// Separating-axis culling: drops triangle pairs of which one surely lies on one side of the other's plane
// (boxes of slanted triangles overlap early). Keeps the order. Marks in candidates.beside pairs that cross
// their planes' common line in surely disjoint intervals: not crossing, but near, so corners are queried.
void cull_by_separating_axis(const ContactInputs& in, SeparatingAxisScratch& scratch, CandidateTriangles& candidates);

}  // namespace trocar
