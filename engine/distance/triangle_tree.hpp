#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/contacts.hpp"
#include "engine/distance/closest_point.hpp"
namespace trocar {

// Lower and negated upper ends of eight boxes; an absent box has infinite ends and meets nothing.
struct alignas(32) EightBoxes {
    float side[6][8];
};

// The enlarged boxes of a body's screened triangles in the hierarchy that Embree built over groups of 16 triangles.
struct TriangleTree {
    const BoxTree* hierarchy = nullptr;
    const ScreenedTriangles* screened = nullptr;
    std::vector<EightBoxes> child;                    // per node: hulls of its children
    std::vector<PackedBox> hull;                      // per group
    std::vector<uint16_t> present;                    // per group: mask of its screened triangles; the next three refer to these
    std::vector<std::array<uint32_t, 16>> row;        // per group: indices into ScreenedTriangles
    std::vector<std::array<EightBoxes, 2>> box, own;  // per group: enlarged boxes, and of the triangles alone
};

void hang_triangles(const ClosestPointTree& tree, const ScreenedTriangles& screened, uint32_t body, TriangleTree& out);

// Nodes, or kBoxLeaf | group, of the trees of two bodies whose hulls meet.
using NodePair = std::array<uint32_t, 2>;

// Descends two trees level by level until there are `enough` pairs of nodes, or all pairs are of leaves.
void open_node_pairs(const TriangleTree& a, const TriangleTree& b, size_t enough, std::vector<NodePair>& pairs,
                     std::vector<NodePair>& scratch);

// Two triangles whose enlarged boxes meet.
struct MeetingTriangles {
    uint32_t a, b;   // indices into ScreenedTriangles
    bool may_cross;  // their own boxes meet
};
// All such triangles below a pair of nodes, in the order of the trees.
void find_meeting_triangles(const TriangleTree& a, const TriangleTree& b, NodePair from, std::vector<MeetingTriangles>& found);

}  // namespace trocar
