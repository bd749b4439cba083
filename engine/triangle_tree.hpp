#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/contacts.hpp"
#include "engine/closest_point.hpp"
namespace trocar {

// Lower and negated upper ends of eight boxes; where there is none they are infinite: it meets nothing.
struct alignas(32) EightBoxes {
    float side[6][8];
};

// The enlarged boxes of a body's screened triangles, hung on the hierarchy that Embree built over groups of 16 triangles.
struct TriangleTree {
    const BoxTree* hierarchy = nullptr;
    const ScreenedTriangles* screened = nullptr;
    std::vector<EightBoxes> child;                    // per node: hulls of its children
    std::vector<PackedBox> hull;                      // per group
    std::vector<uint16_t> present;                    // per group: which of its triangles are screened; the rest is of those
    std::vector<std::array<uint32_t, 16>> row;        // per group: rows of ScreenedTriangles
    std::vector<std::array<EightBoxes, 2>> box, own;  // per group: enlarged boxes, and of the triangles alone
};

void hang_triangles(const ClosestPointTree& tree, const ScreenedTriangles& screened, uint32_t body, TriangleTree& out);

// Nodes, or kBoxLeaf | group, of the trees of two bodies whose hulls meet.
using NodePair = std::array<uint32_t, 2>;

// Goes down two trees level by level until there are `enough` pairs of nodes, or no more than these.
void open_node_pairs(const TriangleTree& a, const TriangleTree& b, size_t enough, std::vector<NodePair>& pairs,
                     std::vector<NodePair>& scratch);

// Two triangles whose enlarged boxes meet.
struct MeetingTriangles {
    uint32_t a, b;   // rows of ScreenedTriangles
    bool may_cross;  // their own boxes meet
};
// All of them below a pair of nodes, in the order of the trees.
void find_meeting_triangles(const TriangleTree& a, const TriangleTree& b, NodePair from, std::vector<MeetingTriangles>& found);

}  // namespace trocar
