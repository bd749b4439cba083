#pragma once
#include <vector>

#include "components/report.hpp"
#include "engine/contact_inputs.hpp"
namespace trocar {

// What is known of one side of one candidate pair.
struct OverlapSide {
    Range answers;      // rows of the chunk's vertex and answer
    uint32_t near = 0;  // of these, how many are nearer than the margin or inside
};

// Working arrays of a run of sides. Bit sets and per-vertex rows are of the body at hand.
struct OverlapChunk {
    std::vector<uint64_t> near_triangle, near_vertex, region_vertex;
    std::vector<uint64_t> beyond;   // vertices that a plane has on one side and all of the other body on the other
    std::vector<uint64_t> settled;  // per row of query_answer: the winding number was asked
    std::vector<uint32_t> hint;     // per vertex: a triangle of the other body close by
    std::vector<uint32_t> parent;   // per vertex: union-find over triangles that nothing crosses
    std::vector<uint8_t> piece;     // per root vertex: which side of the other surface it is on
    std::vector<double> along[2];   // per vertex of the pair's bodies: where it is on the way from the first to the second
    uint32_t projected = kNone;     // the pair that `along` is of
    std::vector<uint32_t> row;      // per vertex: row of answer
    // queries of the side at hand
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

// Memory of the overlap phase. `hint_*` is a cache: any content gives the same answers.
struct OverlapScratch {
    std::vector<OverlapChunk> chunk;
    std::vector<OverlapSide> side;        // two per candidate pair
    std::vector<uint32_t> vertex_first;   // per body: row of its first vertex in hint_*
    std::vector<uint32_t> hint_other;     // body that the vertex was near in the last pass
    std::vector<uint32_t> hint_triangle;  // local triangle of it that was nearest
    std::vector<uint32_t> contact_first;  // per side
};

// Overlap phase (thesis 4.1.1, FindOverlapReg): every vertex of a inside b or nearer to it than the margins of both
// together, and the reverse, at any depth and for any number of bodies; equal to testing every vertex but those that
// candidates leave out. Contacts ascend by pair, side and vertex.
// Signs: a solid's by pseudonormal, checked against the Lipschitz bound along every near edge of the mesh and settled
// by winding number where they disagree (counted).
void find_overlap(const ContactInputs& in, const ScreenedTriangles& screened, const CandidateTriangles& candidates, OverlapScratch& scratch,
                  Report& report, NearVertices& near, Contacts& contacts);

}  // namespace trocar
