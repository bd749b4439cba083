#pragma once
#include <array>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// Two edges about to cross, before they become a row.
struct EdgeAhead {
    uint32_t body = kNone, other = kNone;
    std::array<uint32_t, 2> vertex{};  // local, ends of body's edge
    float along = 0;
    Triangle triangle{};               // one of other at its edge
    std::array<float, 3> weight{};     // of the point of that edge
    Vec3d normal = Vec3d::Zero();      // unit, world, from other to body
    double distance = 0;               // m
};

// A vertex near the other body, relative to that one's origin, world axes.
struct EdgeAheadEnd {
    Vec4d place, velocity;  // m, m/s
    double distance;        // m, to the other surface
    uint32_t triangle;      // of the other body, nearest
};

// Working arrays of a run of pairs.
struct EdgesAheadChunk {
    std::vector<uint64_t> near_vertex, edge;  // sets of the body at hand
    std::vector<EdgeAheadEnd> end;            // per vertex of near_vertex
    std::vector<EdgeAhead> found;
};

struct EdgesAheadScratch {
    std::vector<EdgesAheadChunk> chunk;
    std::vector<uint32_t> contact_first;  // per pair: its first row of Contacts, and the end
};

// Adds a row for every two edges of closed bodies that come near enough in `period` (s) to cross and do not cross yet: where
// they meet no vertex is on a face, so that they would be found only once they have passed each other (the edge-edge case of
// Bridson, Fedkiw, Anderson 2002, "Robust treatment of collisions, contact and friction for cloth animation", section 4).
// Nearest points and normal are of now; places at the end of the period are those of uniform motion, with `fall` (m) more.
// For pairs of deformable bodies, and of theirs with static or scripted ones: heavy boxes that such rows hold sink into the
// folds of a crushed shell, and so do tools. Of each pair the edges of the body with the shorter ones
// are asked, against the edges of the triangles nearest to their ends. Rows come last, in the order of pairs, edge and edge
// of the other; they name no contact.
void add_edges_ahead(double period, double fall, const Surfaces& surfaces, const BodyBoxes& boxes, const CandidatePairs& pairs,
                     const CandidateTriangles& candidates, const NearVertices& near, const Contacts& contacts,
                     EdgesAheadScratch& scratch, ContactRows& rows);

}  // namespace trocar
