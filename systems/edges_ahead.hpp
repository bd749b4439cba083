#pragma once
#include <vector>

#include "engine/contact_inputs.hpp"
#include "engine/edge_meeting.hpp"
#include "engine/geometry/vec4.hpp"
namespace trocar {

// A vertex near the other body, relative to that one's origin, world axes.
struct EdgeAheadEnd {
    Vec4d place, velocity;  // m, m/s
    double distance;        // m, to the other surface
    uint32_t triangle;      // of the other body, nearest
};

// Working arrays of a run of pairs.
struct EdgesAheadChunk {
    std::vector<uint64_t> near_vertex, edge;  // sets of the finer body of the pair at hand
    std::vector<EdgeAheadEnd> end;            // per vertex of near_vertex
    std::vector<EdgeMeeting> found;
};

struct EdgesAheadScratch {
    std::vector<EdgesAheadChunk> chunk;
    std::vector<uint32_t> contact_first;  // per pair: its first row of Contacts, and the end
};

// Adds a row for every two edges of closed bodies that come near enough in the period to cross and do not cross yet: where
// they meet no vertex is on a face, so that they would be found only once they have passed each other (the edge-edge case of
// Bridson, Fedkiw, Anderson 2002, "Robust treatment of collisions, contact and friction for cloth animation", section 4).
// Nearest points and normal are of now; places at the end of the period are those of uniform motion, with in.fall more.
// For pairs of deformable bodies, and of theirs with static or scripted ones: heavy boxes that such rows hold sink into the
// folds of a crushed shell, and so do tools. Of each pair the edges of the body with the shorter ones are asked, against the
// edges of the triangles nearest to their ends. Rows come last, by pair and edge.
void add_edges_ahead(const ContactInputs& in, const CandidateTriangles& candidates, const NearVertices& near, const Contacts& contacts,
                     EdgesAheadScratch& scratch, ContactRows& rows);

}  // namespace trocar
