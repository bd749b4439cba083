#pragma once
#include <span>

#include "components/mesh.hpp"
#include "components/springs.hpp"
namespace trocar {

// Appends a mesh (metres, body frame, welded, no face that names a vertex twice) as a prototype: edges, neighbours,
// incident triangles, pieces, measures. The admission is taken as judged by the caller. Where more than two triangles
// share an edge, none of them is a neighbour there and edge_triangle names the lowest two. An isolated vertex belongs
// to no piece (kNone). A mesh without a material gets the default one. Returns its row.
uint32_t add_prototype(Meshes& meshes, const Mesh& mesh, Admission admission);

// Appends the SELL-16 spring adjacency and vertex areas of a prototype whose springs are not made yet; prototypes
// passed over get an empty row. Columns are counted over all prototypes: row 16 * slice_column[...] of neighbour.
// Within a vertex the columns ascend by neighbour. Padding lanes and columns name the lane's own vertex.
void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype);
// The same for springs along `edge` (lower end first, ascending) between `node`, the vertices and what follows them.
// Under a skin of so many vertices the nodes are no vertices and their areas are those of `boundary`, triangles between nodes.
struct CarriedSkin {
    uint32_t vertices = 0;
    std::span<const Triangle> boundary;
};
void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> node,
                 std::span<const std::array<uint32_t, 2>> edge, const CarriedSkin& skin = {});

// Packs the columns of a prototype whose springs are there and take more than `beyond` bytes, 8 a half-edge: quantises its rest
// lengths to 1/65535 of the longest (at most 7.6e-6 of that each, in rest_length too: whatever reads either sees the same) and
// fills Springs::packed. Does nothing where a far end lies more than 32,767 rows from the slice of a vertex.
inline constexpr size_t kPackBeyond = size_t{1} << 20;
void pack_springs(Springs& springs, uint32_t prototype, size_t beyond = kPackBeyond);

// Reorders vertices (along a Hilbert curve) and triangles (by lowest, then highest vertex) so that neighbours in space
// are neighbours in memory. Geometry, corner order, texture coordinates and materials of a triangle are unchanged.
void order_for_locality(Mesh& mesh);

}  // namespace trocar
