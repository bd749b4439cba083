#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Joins vertices at exactly the same place and drops those no triangle uses. The rest keep their order; triangles,
// texture coordinates and materials are untouched but for the numbers of their corners. Returns how many were joined.
uint32_t weld_exact(Mesh& mesh);

}  // namespace trocar
