#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/contacts.hpp"
#include "engine/closest_point.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// A part of a face, in the frame of the other body.
struct FacePart {
    std::array<Vec3d, 3> corner;
    double bound;  // m, nothing on it is deeper
};

struct FaceDepthScratch {
    struct Chunk {
        std::vector<FacePart> part;
        std::vector<double> depth;  // per vertex of the body at hand; NaN where it is not known
    };
    std::vector<Chunk> chunk;
    std::vector<uint32_t> queries;  // per overlapping pair: what it cost
};

// Searches the inside of faces of overlapping pairs for points deeper than their vertices and edges. Afterwards no
// point of either surface is deeper than penetrations.surface_depth + params.tolerance; that depth is attained, or, for
// a pair that would take more than a hundred thousand queries, a proven upper bound. Branch and bound: depth is
// 1-Lipschitz, and no more than the distance to any one triangle, which is convex over a face. A face far from the
// deepest point costs nothing; a uniform subdivision of equal promise has edges of sqrt(3) * tolerance.
void find_face_depths(const ContactParams& params, const Surfaces& surfaces, const CandidatePairs& pairs,
                      const ScreenedTriangles& screened, const NearVertices& near,
                      std::span<const std::unique_ptr<ClosestPointTree>> trees, FaceDepthScratch& scratch,
                      Penetrations& penetrations);

}  // namespace trocar
