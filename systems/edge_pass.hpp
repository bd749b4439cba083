#pragma once
#include <array>
#include <memory>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/report.hpp"
#include "engine/closest_point.hpp"
#include "engine/geometry/four_points.hpp"
#include "engine/surfaces.hpp"
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

// A triangle and its plane.
struct FlatTriangle {
    FourPoints corner;  // m; the fourth is the third
    Vec4d start = {};   // m, its first corner
    Vec4d normal = {};  // m^2, not of unit length
    double size2 = 0;   // m^4, product of the squares of the edges that make the normal
};

// Working arrays of a run of pairs; sets are of the body at hand.
struct EdgeChunk {
    std::vector<FlatTriangle> flat;                    // of the second body of the pair at hand
    std::vector<uint32_t> flat_row;                    // per triangle of it: row of flat, or kNone
    std::vector<std::array<uint32_t, 2>> crossing;     // candidates of the pair that may cross
    RankedBits near_triangle, near_vertex;
    std::vector<uint64_t> near_edge;
    std::vector<uint32_t> opposite_first;  // per near triangle by rank: rows of opposite
    std::vector<uint32_t> opposite;        // triangles of the other body that may cross it
    std::vector<EdgeContact> found;        // of all sides of the run
    QueryCounters counters;
};

struct EdgePassScratch {
    std::vector<EdgeChunk> chunk;
    std::vector<Range> side;  // two per candidate pair: rows of the chunk's found
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
