#pragma once
#include <vector>

#include "components/report.hpp"
#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Result for one side of one broad-phase pair.
struct OverlapSide {
    Range answers;      // indices into the chunk's vertex and answer
    uint32_t near = 0;  // number of these nearer than the margin or inside
};

// Working arrays of a run of sides. Bit sets and per-vertex arrays are of the current body.
struct OverlapChunk {
    std::vector<uint64_t> near_triangle, near_vertex, region_vertex;
    std::vector<uint64_t> beyond;            // vertices separated from the whole other body by a plane
    std::vector<uint64_t> decided;           // per query: the winding number was evaluated
    std::vector<uint32_t> hint;              // per vertex: a nearby triangle of the other body
    std::vector<uint32_t> parent;            // per vertex: union-find over uncrossed triangles
    std::vector<uint8_t> piece;              // per root vertex: which side of the other surface it is on
    std::vector<double> along[2];            // per vertex of the pair's bodies: position along the direction from the first to the second
    uint32_t projected = kNone;              // the pair that `along` belongs to
    std::vector<uint32_t> answer_of_vertex;  // per vertex: index of its answer
    // queries of the current side
    std::vector<uint32_t> query_vertex, query_hint;
    std::vector<Vec3d> query_point;  // frame of the other body, m
    std::vector<double> query_radius;
    std::vector<SurfacePoint> query_answer;
    std::vector<QueryCounters> query_counters;
    // results of all sides of the run
    std::vector<uint32_t> vertex;  // ascending within a side
    std::vector<Vec3d> point;      // frame of the other body, m
    std::vector<SurfacePoint> answer;
    QueryCounters counters;
};

// State of the overlap phase kept between passes. `hint_*` is a cache: any content gives the same answers.
struct OverlapScratch {
    std::vector<OverlapChunk> chunk;
    std::vector<OverlapSide> side;        // two per broad-phase pair
    std::vector<uint32_t> vertex_first;   // per body: index of its first vertex in hint_*
    std::vector<uint32_t> hint_other;     // body that the vertex was near in the last pass
    std::vector<uint32_t> hint_triangle;  // its local triangle that was nearest
    std::vector<uint32_t> contact_first;  // per side
};

// Overlap phase (thesis 4.1.1, FindOverlapReg): finds every vertex of a inside b or nearer to it than the sum
// of both margins, and the reverse, at any depth and for any number of bodies; equals testing every vertex
// except those that the candidates exclude. Contacts ascend by pair, side and vertex. Signs come from
// pseudonormals for solids, checked against the Lipschitz bound along every near mesh edge; where they
// disagree the winding number decides (counted).
void find_overlap(const ContactInputs& in, const ScreenedTriangles& screened, const CandidateTriangles& candidates, OverlapScratch& scratch,
                  Report& report, NearVertices& near, Contacts& contacts);

}  // namespace trocar
