#pragma once
#include <vector>

#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// A part of a face, in the frame of the other body.
struct FacePart {
    std::array<Vec3d, 3> corner;  // m
    std::array<Vec3d, 3> weight;  // barycentric weights of those corners in the face
    double bound;                 // m, upper bound of the depth on it
    uint32_t face;                // local triangle
    uint32_t hint;                // nearby triangle of the other body, or kNone
};

// The deepest point of one face, to be inserted into Contacts.
struct FaceContact {
    uint32_t face = kNone;
    float along = 0, across = 0;  // weights of its second and third corner
    Vec3d point = Vec3d::Zero();  // frame of the other body, m
    SurfacePoint answer;          // frame of the other body
};

struct FaceDepthScratch {
    struct Chunk {
        std::vector<FacePart> part;                 // heap, largest bound first
        std::vector<double> depth;                  // per vertex of the current body; NaN if unknown
        std::vector<Vec3d> position;                // m, its position in the frame of the other body
        std::vector<uint32_t> nearest;              // its nearest triangle of the other body
        std::vector<std::array<uint32_t, 2>> edge;  // of the current body, edges that have a contact, ascending
        std::vector<uint32_t> poked;
        std::vector<FaceContact> found;  // of all sides of the run
    };
    std::vector<Chunk> chunk;
    std::vector<Range> side;        // two per broad-phase pair: indices into found
    std::vector<uint32_t> queries;  // per broad-phase pair: queries made
};

// Searches faces for points deeper than their corners and edges and adds them to the contacts: the deepest
// point of every face that the other surface passes through while its corners and edges are outside (a small
// object pressed into a large face), and the deepest point of each pair if no vertex or edge point is that
// deep to params.tolerance. Then no point of either surface is deeper than the pair's contacts by more than
// the tolerance; a pair that would take more than most_queries leaves a proven bound in contacts.most. Sheets
// have no inside, so only their faces are searched. Branch and bound, largest bound first: depth is
// 1-Lipschitz, and at most the distance to any one triangle, which is convex over a face. A uniform
// subdivision with the same guarantee has edges of sqrt(3) * tolerance.
void find_face_contacts(const ContactInputs& in, uint32_t most_queries, const ScreenedTriangles& screened,
                        const CandidateTriangles& candidates, const NearVertices& near, FaceDepthScratch& scratch, Contacts& contacts);

}  // namespace trocar
