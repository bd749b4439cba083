#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar {

// Whether a surface encloses an inside.
inline bool has_inside(Admission admission) { return admission == Admission::kSolid || admission == Admission::kWinding; }

// One prototype's slices of Meshes. All indices are local to the prototype.
struct MeshView {
    const MeshInfo* info = nullptr;
    std::span<const Vec3d> position;
    std::span<const uint32_t> component;
    std::span<const Triangle> triangle;
    std::span<const std::array<uint32_t, 3>> neighbour;
    std::span<const std::array<uint32_t, 3>> triangle_edge;
    std::span<const std::array<uint32_t, 2>> edge;
    std::span<const std::array<uint32_t, 2>> edge_triangle;
    std::span<const uint32_t> incident_first;  // vertex -> range of incident, position.size() + 1
    std::span<const uint32_t> incident;
    std::span<const std::array<Vec2, 3>> uv;
    std::span<const uint16_t> triangle_material;
};

inline MeshView mesh_view(const Meshes& meshes, uint32_t prototype) {
    const MeshInfo& info = meshes.info[prototype];
    const auto cut = [](const auto& rows, uint32_t first, uint32_t count) { return std::span(rows).subspan(first, count); };
    return {&info,
            cut(meshes.position, info.vertices.first, info.vertices.count),
            cut(meshes.component, info.vertices.first, info.vertices.count),
            cut(meshes.triangle, info.triangles.first, info.triangles.count),
            cut(meshes.neighbour, info.triangles.first, info.triangles.count),
            cut(meshes.triangle_edge, info.triangles.first, info.triangles.count),
            cut(meshes.edge, info.edges.first, info.edges.count),
            cut(meshes.edge_triangle, info.edges.first, info.edges.count),
            cut(meshes.incident_first, info.vertices.first + prototype, info.vertices.count + 1),
            cut(meshes.incident, info.incident.first, info.incident.count),
            cut(meshes.uv, info.triangles.first, info.triangles.count),
            cut(meshes.triangle_material, info.triangles.first, info.triangles.count)};
}

}  // namespace trocar
