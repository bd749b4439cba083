#pragma once
#include <array>
#include <vector>

#include "engine/contact_inputs.hpp"
namespace trocar {

// A sharp edge in world axes.
struct SharpEdge {
    std::array<uint32_t, 2> vertex;  // local, ends
    Vec3d a, b;                      // m, the same
    Vec3d into[2];                   // unit, from the edge's start into its two faces: to their far corners
    uint32_t triangle;               // the first of its two
};

struct EdgeRowsScratch {
    std::vector<uint32_t> edge;       // of the triangles of a body that are near another one, ascending
    std::vector<SharpEdge> sharp[2];  // the sharp ones among them, of each side of a pair
};

// Adds a row for every two sharp edges that pass over each other nearer than the pair's margins, for pairs of rigid
// bodies one of which is free: where boxes cross, neither has a corner on the other. Sharp: faces that turn by more than
// 20 degrees, outward. The normal is across both edges and in the normal cones of both (the edge-edge case of Mirtich
// 1998, "V-Clip"); edges that are nearly parallel are left to their corners. The row is one of the pair's first body,
// a point of its edge against a triangle at the second's. Pairs in order, then edges of the first, then of the second.
void add_edge_rows(const ContactInputs& in, const CandidateTriangles& candidates, EdgeRowsScratch& scratch, ContactRows& rows);

}  // namespace trocar
