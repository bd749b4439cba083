#pragma once
#include <array>
#include <vector>

#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// A sharp edge in world axes.
struct SharpEdge {
    std::array<uint32_t, 2> vertex;  // local, ends
    Vec3d a, b;                      // m, their positions
    Vec3d into[2];                   // unit, from the edge's start to the far corners of its two faces
    uint32_t triangle;               // the first of its two
};

struct EdgeConstraintsScratch {
    std::vector<uint32_t> edge;       // edges of a body's triangles near another body, ascending
    std::vector<SharpEdge> sharp[2];  // the sharp ones, per side of a pair
};

// Adds an edge-edge constraint for every two sharp edges that cross within the pair's margins, for rigid
// pairs with a free body: where boxes cross, neither has a corner on the other. Sharp: convex, with face
// normals more than 20 degrees apart. The normal is perpendicular to both edges and in both normal cones
// (edge-edge case of Mirtich 1998, "V-Clip"), or beside them by no more than the bodies may turn in the period, and then is the
// nearest normal of a cone: a tilted box slams down on another's edge. Nearly parallel edges are left to vertex contacts. The point is
// on the first body's edge, the triangle at the second's. None for saturated pairs. Ordered by pair, then the edges of the first, then
// of the second.
void add_edge_constraints(const ContactInputs& in, const CandidateTriangles& candidates, const Penetrations& penetrations,
                          EdgeConstraintsScratch& scratch, ContactConstraints& constraints);

}  // namespace trocar
