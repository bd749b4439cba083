#pragma once
#include "components/mesh.hpp"
#include "components/springs.hpp"
namespace trocar {

// Appends a mesh (metres, body frame, welded, refused faces already dropped) as a prototype: edges, neighbours,
// incident triangles, pieces, measures. The admission is taken as judged by the caller. Returns its row.
uint32_t add_prototype(Meshes& meshes, const Mesh& mesh, Admission admission);

// Appends the SELL-16 spring adjacency and vertex areas of the newest prototype of meshes. springs.info grows by one
// row.
void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype);

// Reorders vertices and triangles so that neighbours in space are neighbours in memory. Geometry unchanged.
void order_for_locality(Mesh& mesh);

}  // namespace trocar
