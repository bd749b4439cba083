#pragma once
#include <numeric>

#include "components/mesh.hpp"
#include "engine/haptics/local_contact_model.hpp"
#include "systems/haptics/contact/local_contact_model.hpp"
namespace trocar::reference {

// A model of a whole surface at rest.
inline LocalContactModel make_patch(const Mesh& mesh, double half_thickness = 0) {
    LocalContactModel model;
    model.reach = 100;
    model.position = mesh.position;
    model.velocity.assign(mesh.position.size(), Vec3d::Zero());
    model.triangle = mesh.triangle;
    model.neighbour.assign(mesh.triangle.size(), {kNone, kNone, kNone});
    model.body.assign(mesh.triangle.size(), 0);
    model.source.resize(mesh.triangle.size());
    std::iota(model.source.begin(), model.source.end(), 0u);
    model.half_thickness.assign(mesh.triangle.size(), half_thickness);
    group_triangles(model);
    return model;
}

// n x n squares over [-half, half]^2, normals up, corners moved by `shape`.
template <typename Shape>  // Shape: Vec3d(const Vec3d&)
Mesh make_ground(uint32_t n, double half, const Shape& shape) {
    Mesh mesh;
    for (uint32_t y = 0; y <= n; ++y)
        for (uint32_t x = 0; x <= n; ++x) mesh.position.push_back(shape(Vec3d(half * (2.0 * x / n - 1), half * (2.0 * y / n - 1), 0)));
    for (uint32_t y = 0; y < n; ++y) {
        for (uint32_t x = 0; x < n; ++x) {
            const uint32_t a = y * (n + 1) + x;
            mesh.triangle.push_back({a, a + 1, a + n + 2});
            mesh.triangle.push_back({a, a + n + 2, a + n + 1});
        }
    }
    return mesh;
}
inline Mesh make_plane(uint32_t n = 10, double half = 0.05) {
    return make_ground(n, half, [](const Vec3d& p) { return p; });
}

}  // namespace trocar::reference
