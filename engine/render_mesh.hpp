#pragma once
#include <vector>

#include "engine/mesh_view.hpp"
namespace trocar {

// A row of a vertex buffer.
struct RenderVertex {
    float position[3];  // m
    float normal[3];    // unit; (0, 0, 0) where there is none
};
inline RenderVertex make_vertex(const Vec3& p, const Vec3& n) { return {{p.x(), p.y(), p.z()}, {n.x(), n.y(), n.z()}}; }

// Triangles of one material, consecutive in RenderMesh::index.
struct RenderGroup {
    uint32_t material = 0;  // of the prototype
    uint32_t first = 0;     // row of index
    uint32_t count = 0;     // indices, three per triangle
};

// A prototype with one row per distinct combination of vertex, texture coordinate and (rigid bodies) normal, as
// graphics hardware wants it. Rows ascend by first use.
struct RenderMesh {
    std::vector<uint32_t> source;  // local vertex of a row
    std::vector<Vec2> uv;          // v turned over: 0 is the first row of the image
    std::vector<Vec3> normal;      // unit or zero, body frame; only with creases
    std::vector<uint32_t> index;   // three per triangle, grouped by material, ascending inside a group
    std::vector<RenderGroup> groups;
    std::vector<uint32_t> line;    // two per mesh edge
    std::vector<uint32_t> inside;  // one per vertex, without creases: its row in faces that are laid open later
};

// Splits the vertices of a prototype. With creases, a corner's normal is the area-weighted sum over the triangles around
// its vertex that lie within 40 degrees of its own, so hard edges of instruments stay hard; without, normals are left to
// be supplied per vertex and picture. Where vertices have no triangle, faces may be laid open later: then every vertex gets
// one more row, its texture coordinates the x and y of its rest place.
RenderMesh split_vertices(const MeshView& mesh, bool creases);

}  // namespace trocar
