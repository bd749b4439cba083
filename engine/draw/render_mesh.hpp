#pragma once
#include <vector>

#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// An element of a vertex buffer.
struct RenderVertex {
    float position[3];  // m
    float normal[3];    // unit; (0, 0, 0) if undefined
};
inline RenderVertex make_vertex(const Vec3& p, const Vec3& n) { return {{p.x(), p.y(), p.z()}, {n.x(), n.y(), n.z()}}; }

// Triangles of one material, consecutive in RenderMesh::index.
struct RenderGroup {
    uint32_t material = 0;  // of the prototype
    uint32_t first = 0;     // first element of index
    uint32_t count = 0;     // indices, three per triangle
};

// A prototype with one element per distinct combination of vertex, texture coordinate and (rigid bodies)
// normal, as graphics hardware requires. Elements are in the order of first use.
struct RenderMesh {
    std::vector<uint32_t> source;  // local vertex of an element
    std::vector<Vec2> uv;          // v flipped: 0 is the first row of the image
    std::vector<Vec3> normal;      // unit or zero, body frame; only with creases
    std::vector<uint32_t> index;   // three per triangle, grouped by material, ascending inside a group
    std::vector<RenderGroup> groups;
    std::vector<uint32_t> line;    // two per mesh edge
    std::vector<uint32_t> inside;  // one per vertex, without creases: its element for faces exposed later
};

// Splits the vertices of a prototype. With creases, a corner's normal is the area-weighted sum over the
// triangles around its vertex whose normals are within 40 degrees of its own, so that hard edges of
// instruments stay hard; without, normals are supplied per vertex and picture. Vertices without triangles
// mean that faces may be exposed later: then every vertex gets one more element, with the x and y of its rest
// position as texture coordinates.
RenderMesh split_vertices(const MeshView& mesh, bool creases);

}  // namespace trocar
