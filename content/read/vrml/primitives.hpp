#pragma once
#include "components/mesh.hpp"
#include "content/read/vrml/scene.hpp"
namespace trocar::vrml {

// Triangle count of a box, sphere, cone or cylinder node with all parts present.
uint64_t count_primitive_triangles(Role role);

// Appends a box, sphere, cone or cylinder in its own coordinates, closed unless the node disables parts,
// counter-clockwise outside: 32 segments around, 16 from pole to pole. Invalid sizes give nothing.
void make_primitive(const Scene& scene, NodeId id, std::vector<Vec3d>& position, std::vector<Triangle>& triangle);

}  // namespace trocar::vrml
