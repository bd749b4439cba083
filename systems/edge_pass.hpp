#pragma once
#include <array>
#include <vector>

#include "components/report.hpp"
#include "engine/contact_inputs.hpp"
#include "engine/geometry/vec4.hpp"
namespace trocar {

// The deepest point of one edge, before it becomes a row of Contacts.
struct EdgeContact {
    std::array<uint32_t, 2> vertex{};  // of body
    float along = 0;
    Vec3d point = Vec3d::Zero();  // frame of the other body, m
    SurfacePoint answer;          // frame of the other body
};

// Set of row numbers that tells how many members lie before one of them.
struct RankedBits {
    std::vector<uint64_t> word;
    std::vector<uint32_t> before;  // members in the words before
};

// What is known of a vertex, in the frame of the other body.
struct EdgeEnd {
    Vec4d place;        // m
    double depth;       // m
    uint32_t triangle;  // of the other body, nearest
};

// Working arrays of a run of pairs; sets are of the body at hand.
struct EdgeChunk {
    std::vector<std::array<uint32_t, 2>> crossing;  // of the pair at hand: triangles of a and of b that may cross
    RankedBits near_triangle;
    std::vector<uint64_t> near_vertex, near_edge;
    std::vector<EdgeEnd> end;              // per vertex of near_vertex
    std::vector<uint32_t> opposite_first;  // per near triangle by rank: rows of opposite
    std::vector<uint32_t> opposite;        // triangles of the other body that may cross it
    std::vector<EdgeContact> found;        // of all sides of the run
    QueryCounters counters;
};

struct EdgePassScratch {
    std::vector<EdgeChunk> chunk;
    std::vector<Range> side;       // two per candidate pair: rows of the chunk's found
    std::vector<uint32_t> before;  // per row found: the contact that it comes before
    std::vector<uint32_t> first;   // per side: row of Contacts of the first found
};

// Deepest inside point of edges that cross the other surface, to params.tolerance (m), or the deepest that 48 queries of an
// edge find: every edge with both ends outside; an edge with an end inside only when some point of it can be deeper than its
// ends by more than the tolerance. Inserts edge rows into contacts, keeping the order pair, side, vertex before edge, index.
// Surfaces of sheets have no inside and get none.
void find_edge_contacts(const ContactInputs& in, const CandidateTriangles& candidates, const NearVertices& near, EdgePassScratch& scratch,
                        Report& report, Contacts& contacts);

}  // namespace trocar
