#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Open spherical cap, 0.2 m across and 0.03 m deep, its lowest point at the origin, concave towards +z: rings of even triangles.
Mesh make_dish(uint32_t triangles);

}  // namespace trocar
