#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/report.hpp"
#include "engine/closest_point.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// Working arrays of one side of one candidate pair.
struct OverlapSide {
    std::vector<uint32_t> near;    // near triangles of body, ascending
    std::vector<uint32_t> mark;    // per vertex of body, clean between passes
    std::vector<uint32_t> vertex;  // vertices to query, ascending
    std::vector<uint32_t> hint;
    std::vector<Vec3d> point;  // in the frame of other, m
    std::vector<double> radius;
    std::vector<SurfacePoint> answer;
    std::vector<uint32_t> root, piece, piece_vertex, members;
    uint64_t sign_disagreements = 0;
    QueryCounters counters;
};

// Memory of the overlap phase. `hint_*` is a cache: any content gives the same answers.
struct OverlapScratch {
    std::vector<OverlapSide> side;        // two per candidate pair
    std::vector<uint32_t> vertex_first;   // per body: row of its first vertex in hint_*
    std::vector<uint32_t> hint_other;     // body that the vertex was near in the last pass
    std::vector<uint32_t> hint_triangle;  // local triangle of it that was nearest
    std::vector<uint32_t> contact_first;  // per side
};

// Overlap phase (thesis 4.1.1, FindOverlapReg): every vertex of a inside b or nearer to it than the margins of both
// together, and the reverse, at any depth and for any number of bodies; equal to testing every vertex. Contacts ascend
// by pair, side and vertex. trees[bodies.tree[i]] is the tree of body i, refitted.
// Signs: a solid's by pseudonormal, checked against the Lipschitz bound along every near edge of the mesh and settled
// by winding number where they disagree (counted).
void find_overlap(const Surfaces& surfaces, const BodyBoxes& boxes, const CandidatePairs& pairs,
                  const ScreenedTriangles& screened, const CandidateTriangles& candidates,
                  std::span<const std::unique_ptr<ClosestPointTree>> trees, OverlapScratch& scratch, Report& report,
                  NearVertices& near, Contacts& contacts);

}  // namespace trocar
