#pragma once
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// The present surface of a body in the world (m), with the vertices and triangles of its mesh.
inline Mesh surface_mesh(const Surfaces& s, uint32_t body) {
    const MeshView view = mesh_view(s.meshes, s.bodies.mesh[body]);
    Mesh mesh;
    mesh.name = s.bodies.name[body];
    mesh.triangle.assign(view.triangle.begin(), view.triangle.end());
    mesh.position.reserve(view.position.size());
    for (uint32_t v = 0; v < view.position.size(); ++v) mesh.position.push_back(vertex_position(s, body, v));
    return mesh;
}

}  // namespace trocar
