#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

struct EdgeRowsScratch {
    std::vector<uint32_t> edge[2];  // sharp edges near the other body, of each side of a pair, ascending
};

// Adds a row for every two sharp edges that pass over each other nearer than the pair's margins, for pairs of rigid
// bodies one of which is free: where boxes cross, neither has a corner on the other. Sharp: faces that turn by more than
// 20 degrees, outward. The normal is across both edges and in the normal cones of both (the edge-edge case of Mirtich
// 1998, "V-Clip"); edges that are nearly parallel are left to their corners. The row is one of the pair's first body,
// a point of its edge against a triangle at the second's. Pairs in order, then edges of the first, then of the second.
void add_edge_rows(const Surfaces& surfaces, const BodyBoxes& boxes, const CandidatePairs& pairs, const CandidateTriangles& candidates,
                   EdgeRowsScratch& scratch, ContactRows& rows);

}  // namespace trocar
