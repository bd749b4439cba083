#pragma once
#include <array>
#include <vector>

#include "components/report.hpp"
#include "engine/contact/contact_inputs.hpp"
#include "engine/geometry/vec4.hpp"
namespace trocar {

// The deepest point of one edge, to be inserted into Contacts.
struct EdgeContact {
    std::array<uint32_t, 2> vertex{};  // of body
    float along = 0;
    Vec3d point = Vec3d::Zero();  // frame of the other body, m
    SurfacePoint answer;          // frame of the other body
};

// Set of indices that counts the members below a given one.
struct RankedBits {
    std::vector<uint64_t> word;
    std::vector<uint32_t> before;  // members in the preceding words
};

// Known position and depth of a vertex, in the frame of the other body.
struct EdgeEnd {
    Vec4d position;     // m
    double depth;       // m
    uint32_t triangle;  // of the other body, nearest
};

// Working arrays of a run of pairs; sets are of the current body.
struct EdgeChunk {
    std::vector<std::array<uint32_t, 2>> crossing;  // of the current pair: triangles of a and of b that may cross
    RankedBits near_triangle;
    std::vector<uint64_t> near_vertex, near_edge;
    std::vector<EdgeEnd> end;              // per vertex of near_vertex
    std::vector<uint32_t> opposite_first;  // per near triangle by rank: first index into opposite
    std::vector<uint32_t> opposite;        // triangles of the other body that may cross it
    std::vector<EdgeContact> found;        // of all sides of the run
    QueryCounters counters;
};

struct EdgePassScratch {
    std::vector<EdgeChunk> chunk;
    std::vector<Range> side;       // two per broad-phase pair: indices into found
    std::vector<uint32_t> before;  // per entry of found: the contact that it precedes
    std::vector<uint32_t> first;   // per side: index in Contacts of its first entry
};

// Finds the deepest inside point of edges that cross the other surface, to params.tolerance (m) or as good as
// 48 queries per edge allow: every edge with both ends outside; an edge with an end inside only if some point
// of it can be deeper than its ends by more than the tolerance. Inserts the contacts in the order pair, side,
// vertex before edge, index. Sheets have no inside, so their surfaces get none.
void find_edge_contacts(const ContactInputs& in, const CandidateTriangles& candidates, const NearVertices& near, EdgePassScratch& scratch,
                        Report& report, Contacts& contacts);

}  // namespace trocar
