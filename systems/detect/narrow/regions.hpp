#pragma once
#include <vector>

#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// The part of an edge that is inside the other body; 0 and 1 are its lower and its other vertex.
struct InsideSpan {
    uint32_t node;    // of its start
    double from, to;  // fractions of the edge from the lower vertex
};

// Sums over one region before it is written out.
struct RegionSum {
    uint32_t vertices_a = 0, vertices_b = 0, curves = 0, witness = kNone;
    double contour = 0, area = 0, volume = 0, depth = 0;  // m, m^2, m^3, m
    Box box;
};

// Working arrays and results of a run of pairs. Nodes: vertices of a, vertices of b, contour points.
struct RegionsChunk {
    std::vector<uint32_t> parent;        // per node: union-find
    std::vector<uint32_t> region;        // per root
    std::vector<uint8_t> inside;         // per vertex node
    std::vector<double> certain;         // per vertex node: m, proven distance from the other surface
    std::vector<int32_t> winding;        // per vertex node, relative to its parent; for doubtful pairs
    std::vector<uint32_t> order;         // points of the pair by body, edge and position on it
    std::vector<uint32_t> hit_edge[2];   // per body: crossed edges, ascending
    std::vector<uint32_t> hit_first[2];  // indices into order, one more
    std::vector<InsideSpan> span;        // of the current edge
    std::vector<RegionSum> sum;
    OverlapRegions found;  // of all pairs of the run
};

struct RegionsScratch {
    std::vector<RegionsChunk> chunk;
    std::vector<uint32_t> contact_first;  // per pair, one more
};

// Groups overlaps into connected regions: inside vertices and inside parts of edges, joined over each mesh's
// edges and across the contour. Area and volume come from Green's and Gauss' theorem over the clipped
// surfaces, so they are exact for the meshes to rounding. A void (a patch that encloses a negative volume)
// belongs to the region around it; a spot where bodies only touch is no region; a body on its own copy is a
// region without a witness. Both bodies must be closed; pairs with a sheet have no regions.
void find_regions(const ContactInputs& in, const ScreenedTriangles& screened, const NearVertices& near, const Contacts& contacts,
                  const Contours& contours, RegionsScratch& scratch, OverlapRegions& regions);

}  // namespace trocar
