#pragma once
#include <vector>

#include "engine/contact_inputs.hpp"
namespace trocar {

// A part of a face, in the frame of the other body.
struct FacePart {
    std::array<Vec3d, 3> corner;  // m
    std::array<Vec3d, 3> weight;  // the same corners as weights of those of the face
    double bound;                 // m, nothing on it is deeper
    uint32_t face;                // local triangle
    uint32_t hint;                // triangle of the other body that is close by, or kNone
};

// The deepest point of one face, before it becomes a row of Contacts.
struct FaceContact {
    uint32_t face = kNone;
    float along = 0, across = 0;  // weights of its second and third corner
    Vec3d point = Vec3d::Zero();  // frame of the other body, m
    SurfacePoint answer;          // frame of the other body
};

struct FaceDepthScratch {
    struct Chunk {
        std::vector<FacePart> part;                 // heap, largest bound first
        std::vector<double> depth;                  // per vertex of the body at hand; NaN where it is not known
        std::vector<Vec3d> place;                   // and where it is, frame of the other body, m
        std::vector<uint32_t> nearest;              // and the triangle of the other body that is nearest to it
        std::vector<std::array<uint32_t, 2>> edge;  // of the body at hand that have a contact, ascending
        std::vector<uint32_t> poked;
        std::vector<FaceContact> found;  // of all sides of the run
    };
    std::vector<Chunk> chunk;
    std::vector<Range> side;        // two per candidate pair: rows of the chunk's found
    std::vector<uint32_t> queries;  // per candidate pair: what it cost
};

// Searches the inside of faces for points deeper than their corners and edges, and adds those found to the contacts: the
// deepest point of every face that the other surface passes while its corners and edges are outside (a large face that
// something small is pressed into), and of each pair the deepest point of all, where no vertex or edge point is as deep
// to params.tolerance. Afterwards no point of either surface is deeper than the pair's contacts by more than that; a pair
// that would take more than most_queries leaves a proven bound in contacts.most. Surfaces of sheets have no
// inside, so nothing is looked for in them, but their faces are searched.
// Branch and bound, largest bound first: depth is 1-Lipschitz, and no more than the distance to any one triangle, which
// is convex over a face. A uniform subdivision of equal promise has edges of sqrt(3) * tolerance.
void find_face_contacts(const ContactInputs& in, uint32_t most_queries, const ScreenedTriangles& screened,
                        const CandidateTriangles& candidates, const NearVertices& near, FaceDepthScratch& scratch, Contacts& contacts);

}  // namespace trocar
