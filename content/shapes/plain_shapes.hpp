#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Shapes of exact size, in metres, closed but for the sheet, with texture coordinates and no material; see shape_library.hpp.
Mesh make_box(uint32_t triangles);
Mesh make_table(uint32_t triangles);
Mesh make_sphere(uint32_t triangles);
Mesh make_sheet(uint32_t triangles);  // open
Mesh make_probe(uint32_t triangles);
Mesh make_capsule(uint32_t triangles);  // 1 m long, 0.5 m thick, along z, centred
// A sphere under a projective map that depends on the seed: a convex stone that fits a cube of 1 m, centred.
Mesh make_hull(uint32_t triangles, uint64_t seed);

}  // namespace trocar
