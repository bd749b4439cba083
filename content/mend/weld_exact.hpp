#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Merges vertices at identical positions and drops those without a triangle. Keeps the order of the others;
// triangles, texture coordinates and materials change only in vertex indices. Returns the number merged.
uint32_t weld_exact(Mesh& mesh);

}  // namespace trocar
