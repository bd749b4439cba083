#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Shapes of exact size, in metres, closed but for the sheet, with texture coordinates and no material; see shape_library.hpp.
Mesh make_box(uint32_t triangles);
Mesh make_table(uint32_t triangles);
Mesh make_sphere(uint32_t triangles);
Mesh make_sheet(uint32_t triangles);  // open
Mesh make_probe(uint32_t triangles);

}  // namespace trocar
