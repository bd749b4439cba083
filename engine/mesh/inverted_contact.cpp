#include "engine/mesh/inverted_contact.hpp"

#include "engine/geometry/point_triangle.hpp"
namespace trocar {

bool leaves_inverted(const Surfaces& s, const Contacts& contacts, uint32_t contact) {
    constexpr double kLevel = 1e-9;  // a face parallel to the separation direction counts for neither side
    if (!(contacts.distance[contact] < 0)) return false;
    const uint32_t body = contacts.body[contact];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto [v, w] = contacts.vertex[contact];
    const uint32_t third = contacts.third[contact];
    bool looks_along = false;
    for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k) {
        const Triangle& t = mesh.triangle[mesh.incident[k]];
        const auto has = [&](uint32_t corner) { return t[0] == corner || t[1] == corner || t[2] == corner; };
        if (!has(w) || (third != kNone && !has(third))) continue;
        const Vec3d a = vertex_position(s, body, t[0]), b = vertex_position(s, body, t[1]), c = vertex_position(s, body, t[2]);
        const Vec3d normal = triangle_normal(a, b, c);
        if (!(normal.squaredNorm() > 0)) continue;
        const double rise = normal.normalized().dot(contacts.normal[contact]);
        if (rise < -kLevel) return false;
        looks_along = looks_along || rise > kLevel;
    }
    return looks_along;
}

}  // namespace trocar
