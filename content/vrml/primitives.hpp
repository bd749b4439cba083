#pragma once
#include "components/mesh.hpp"
#include "content/vrml/scene.hpp"
namespace trocar::vrml {

// Triangles a box, sphere, cone or cylinder node gives, all parts switched on.
uint64_t count_primitive_triangles(Role role);

// Appends a box, sphere, cone or cylinder in its own coordinates, closed unless the node switches parts off, outside
// counter-clockwise: 32 sides round, 16 from pole to pole. Sizes that are not finite and above zero give nothing.
void make_primitive(const Scene& scene, NodeId id, std::vector<Vec3d>& position, std::vector<Triangle>& triangle);

}  // namespace trocar::vrml
