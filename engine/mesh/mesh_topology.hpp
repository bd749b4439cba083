#pragma once
#include <span>

#include "components/mesh.hpp"
#include "components/springs.hpp"
namespace trocar {

// Appends a mesh (metres, body frame, welded, no face with a repeated vertex) as a prototype: edges,
// neighbours, incident triangles, pieces, measures. The caller decides the admission. Where more than two
// triangles share an edge, none of them is a neighbour there and edge_triangle holds the lowest two. An
// isolated vertex belongs to no piece (kNone). A mesh without material gets the default. Returns its index.
uint32_t add_prototype(Meshes& meshes, const Mesh& mesh, Admission admission);

// Measures a prototype anew after its positions were changed: box, radius, edges, area, volume.
void measure_prototype(Meshes& meshes, uint32_t prototype);

// Appends the SELL-16 spring adjacency and vertex areas of a prototype without springs; prototypes skipped
// get an empty element. Columns are counted over all prototypes: element 16 * slice_column[...] of neighbour.
// Within a vertex the columns ascend by neighbour. Padding lanes and columns hold the lane's own vertex.
void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype);
// The same for springs along `edge` (lower end first, ascending) between `node`, the vertices and the nodes
// after them. Under an embedded surface of that many vertices the nodes are not vertices; their areas are
// those of `boundary`, triangles between nodes.
struct EmbeddedSkin {
    uint32_t vertices = 0;
    std::span<const Triangle> boundary;
};
void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> node,
                 std::span<const std::array<uint32_t, 2>> edge, const EmbeddedSkin& skin = {});

// Packs the columns of a prototype with springs if they take more than `beyond` bytes, 8 per half-edge:
// quantises its rest lengths to 1/65535 of the longest (an error of at most 7.6e-6 of it, in rest_length too,
// so that both copies agree) and fills Springs::packed. Does nothing where a far end is more than 32,767
// elements from the slice of a vertex.
inline constexpr size_t kPackBeyond = size_t{1} << 20;
void pack_springs(Springs& springs, uint32_t prototype, size_t beyond = kPackBeyond);

// Reorders vertices (along a Hilbert curve) and triangles (by lowest, then highest vertex) so that neighbours in space
// are neighbours in memory. Geometry, corner order, texture coordinates and materials of a triangle are unchanged.
void order_for_locality(Mesh& mesh);

}  // namespace trocar
