#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// The surface of a deformable body, or those of two side by side.
struct SideBySide {
    std::vector<Triangle> triangle;
    std::vector<Float4> position;          // m, from the origin of the first; w: inverse mass, 1/kg
    uint32_t vertices = 0, triangles = 0;  // of the first
};

inline std::span<const Float4> offsets_of(const Surfaces& surfaces, uint32_t body) {
    const Range range = surfaces.bodies.particles[body];
    return std::span<const Float4>(surfaces.particles.offset).subspan(range.first, range.count);
}

// offset, other_offset: m, of the particles of both bodies; twice the same if they are one.
inline void put_side_by_side(const Surfaces& surfaces, uint32_t body, uint32_t other, std::span<const Float4> offset,
                             std::span<const Float4> other_offset, SideBySide& both) {
    both.triangle.clear(), both.position.clear();
    const auto add = [&](uint32_t b, std::span<const Float4> from, const Vec3d& shift) {
        const MeshView mesh = mesh_view(surfaces.meshes, surfaces.bodies.mesh[b]);
        const auto first = static_cast<uint32_t>(both.position.size());
        for (const Triangle& t : mesh.triangle) both.triangle.push_back({first + t[0], first + t[1], first + t[2]});
        for (uint32_t v = 0; v < mesh.position.size(); ++v) {
            const Vec3d at = Vec3d(double{from[v].x}, double{from[v].y}, double{from[v].z}) + shift;
            both.position.push_back({static_cast<float>(at.x()), static_cast<float>(at.y()), static_cast<float>(at.z()), from[v].w});
        }
    };
    add(body, offset, Vec3d::Zero());
    both.vertices = static_cast<uint32_t>(both.position.size()), both.triangles = static_cast<uint32_t>(both.triangle.size());
    if (other != body) add(other, other_offset, surfaces.poses.origin[other] - surfaces.poses.origin[body]);
}

// Marks the vertices of the faces of crossing pairs (ring), and with them those of the faces around (beside). vertices: their number.
inline void mark_beside(std::span<const Triangle> triangle, std::span<const std::array<uint32_t, 2>> pairs, size_t vertices,
                        std::vector<uint8_t>& ring, std::vector<uint8_t>& beside) {
    ring.assign(vertices, 0);
    for (const auto& [t, u] : pairs)
        for (const uint32_t face : {t, u})
            for (const uint32_t v : triangle[face]) ring[v] = 1;
    beside = ring;
    for (const Triangle& t : triangle)
        if (ring[t[0]] || ring[t[1]] || ring[t[2]]) beside[t[0]] = beside[t[1]] = beside[t[2]] = 1;
}

}  // namespace trocar
