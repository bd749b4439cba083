#include "systems/detect/narrow/common_points.hpp"

#include <algorithm>

#include "engine/geometry/triangle_triangle.hpp"
namespace trocar {

bool share_a_point(const Surfaces& s, uint32_t a, uint32_t b, std::span<const std::array<uint32_t, 2>> candidates, double depth) {
    const auto corners = [&](uint32_t body, uint32_t triangle) {
        const Triangle& t = mesh_view(s.meshes, s.bodies.mesh[body]).triangle[triangle];
        return Corners{vertex_position(s, body, t[0]), vertex_position(s, body, t[1]), vertex_position(s, body, t[2])};
    };
    const auto meet = [&](const std::array<uint32_t, 2>& t) {
        return meet_triangles(corners(a, t[0]), corners(b, t[1])) != Meeting::kDisjoint;
    };
    const double size = std::max(s.meshes.info[s.bodies.mesh[a]].radius, s.meshes.info[s.bodies.mesh[b]].radius);
    return depth > 1e-12 * size || std::ranges::any_of(candidates, meet);
}

}  // namespace trocar
