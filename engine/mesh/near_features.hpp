#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "components/particles.hpp"
#include "engine/geometry/eight_points.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

struct FeatureBox {
    std::array<float, 4> low, high;  // m; three and a zero
};

// Features 8 i to 8 i + 7 of a surface, a lane each. Lanes without one are far from everything.
struct EightTriangles {
    std::array<EightPoints, 3> corner;
    EightPoints low, high;
    std::array<std::array<uint32_t, 8>, 3> vertex = {{}};
};
struct EightEdges {
    std::array<EightPoints, 2> end;
    std::array<std::array<uint32_t, 8>, 2> vertex = {{}};
};

// The triangles and edges of a surface where they are, each below a tree of boxes: of one leaf each, then of pairs, up to a
// single one.
struct FeatureTrees {
    std::vector<EightTriangles> triangles;
    std::vector<EightEdges> edges;
    std::vector<std::vector<FeatureBox>> triangle_level, edge_level;
    std::vector<FeatureBox> vertex_box;  // of eight vertices each
    float longest = 0;                   // m, edge
};

// Pairs of features of two surfaces, or of one with itself, ascending.
struct NearFeatures {
    std::vector<uint64_t> vertex_triangle;  // vertex of the first surface << 32 | triangle of the second
    std::vector<uint64_t> edge_edge;        // edge of the first << 32 | edge of the second, which is the later one of a surface itself
    std::vector<std::vector<uint64_t>> part, leaf;  // scratch: per chunk; of one of its leaves
};

// position: m, one element a vertex; those that are not finite are near nothing. Triangles with a corner twice and edges of no
// triangle, which were cut away, are left out.
void build_feature_trees(const MeshView& mesh, const Float4* position, FeatureTrees& trees);

// Finds all vertices of the first surface within `reach` (m) of a triangle of the second, and all edges within `reach` of each
// other; of one surface (itself): that share no vertex. Also finds some that are farther by up to 1/250 of the longest edge. Takes some
// 0.3 us a triangle of a smooth surface with neighbours at a distance, whose features should be ordered for locality. The same for any
// number of threads.
void find_near_features(const MeshView& mesh, const Float4* position, const FeatureTrees& trees, const FeatureTrees& other, bool itself,
                        float reach, NearFeatures& near);

// The same for the vertices of the first and the triangles of the second only; no edges.
void find_near_vertices(const MeshView& mesh, const Float4* position, const FeatureTrees& trees, const FeatureTrees& other, bool itself,
                        float reach, NearFeatures& near);

// Two surfaces, or twice the same, where they are. shift: m, added to the positions of the second.
struct FacingSurfaces {
    std::span<const Triangle> triangle;  // of the second
    std::span<const std::array<uint32_t, 2>> edge, other_edge;
    const Float4 *position, *other_position;  // m
    std::array<float, 3> shift;
    float longest;  // m, edge of both
};

// Pairs that a search found, by far the most of them parts of a smooth surface beside each other: of these eight or fewer (as in
// NearFeatures), the bits of those that may face each other within `reach` (m): the vertex is off the plane of the triangle by more than
// half its distance; the edges cross as seen along their common perpendicular, at an angle of 3 degrees or more. Takes some 6 ns a pair.
// Leaves out none that are so in exact arithmetic with positions that are wrong by 1e-3 of the longest edge.
uint32_t facing_vertices(const FacingSurfaces& surfaces, std::span<const uint64_t> pairs, float reach);
uint32_t facing_edges(const FacingSurfaces& surfaces, std::span<const uint64_t> pairs, float reach);

}  // namespace trocar
