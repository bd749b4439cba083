#pragma once
#include <array>
#include <memory>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/report.hpp"
#include "engine/closest_point.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// The deepest point of one edge, before it becomes a row of Contacts.
struct EdgeContact {
    uint32_t edge = 0;  // local edge of body
    double along = 0;
    SurfacePoint answer;  // in the frame of other
};

// Working arrays of one side of one candidate pair.
struct EdgeSide {
    std::vector<uint32_t> near_row;                  // per vertex of body: row of NearVertices; valid where marked
    std::vector<uint32_t> edge;                      // edges to look at, ascending
    std::vector<uint64_t> seen;                      // one bit per edge of body, clean between passes
    std::vector<uint32_t> opposite_first, opposite;  // candidate triangles of other, per near triangle of body
    std::vector<EdgeContact> found;
    QueryCounters counters;
};

struct EdgePassScratch {
    std::vector<EdgeSide> side;  // two per candidate pair
    Contacts merged;
};

// Deepest inside point of edges that cross the other surface, to params.tolerance (m): every edge with both ends
// outside; an edge with an end inside only when some point of it can be deeper than its ends by more than the
// tolerance. Inserts edge rows into contacts, keeping the order pair, side, vertex before edge, index. Surfaces of
// sheets have no inside and get none.
void find_edge_contacts(const ContactParams& params, const Surfaces& surfaces, const CandidatePairs& pairs,
                        const CandidateTriangles& candidates, const NearVertices& near,
                        std::span<const std::unique_ptr<ClosestPointTree>> trees, EdgePassScratch& scratch,
                        Report& report, Contacts& contacts);

}  // namespace trocar
