#pragma once
#include <vector>

#include "engine/contact_inputs.hpp"
#include "engine/geometry/four_points.hpp"
namespace trocar {

// A triangle and its plane.
struct FlatTriangle {
    FourPoints corner;  // m; the fourth is the third
    Vec4d start = {};   // m, its first corner
    Vec4d normal = {};  // m^2, not of unit length
    double size2 = 0;   // m^4, product of the squares of the edges that make the normal
};

struct PartedTrianglesScratch {
    struct Chunk {
        std::vector<FlatTriangle> flat;  // of the second body of the pair at hand
        std::vector<uint32_t> row;       // per triangle of it: row of flat, or kNone
        std::vector<uint32_t> used;      // triangles that have one
    };
    std::vector<Chunk> chunk;  // per run of pairs
};

// Drops from candidates.triangle the pairs of which one triangle surely lies on one side of the other's plane: boxes of
// slanting triangles meet long before they do. Order is kept. Marks in candidates.beside those that both pass the line
// common to their planes, but surely beside each other: they do not cross, but are near, and their corners may yet meet.
void drop_parted_triangles(const ContactInputs& in, PartedTrianglesScratch& scratch, CandidateTriangles& candidates);

}  // namespace trocar
