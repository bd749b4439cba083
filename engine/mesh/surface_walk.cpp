#include "engine/mesh/surface_walk.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
namespace trocar {
namespace {

constexpr double kFlat = 1e-3, kSmooth = 0.2;  // sines: above what rounding leaves of a flat surface; of a bend
constexpr int kMostCrossed = 512;              // a walk over needles need not end

// Sine of the angle at which a triangle rises from or falls below a plane through its neighbour's corner.
double bend_of(const MeshView& mesh, uint32_t triangle, const Vec3d& corner, const Vec3d& normal) {
    double bend = 0;
    for (const uint32_t v : mesh.triangle[triangle]) {
        const Vec3d to = mesh.position[v] - corner;
        bend = std::max(bend, std::abs(normal.dot(to)) / std::max(to.norm(), 1e-300));
    }
    return bend;
}

Vec3d face_normal(const MeshView& mesh, uint32_t triangle) {
    const auto [a, b, c] = mesh.triangle[triangle];
    return (mesh.position[b] - mesh.position[a]).cross(mesh.position[c] - mesh.position[a]).normalized();
}

}  // namespace

SurfacePlane walk_surface(const MeshView& mesh, const Triangle& start, const Vec3d& normal, const Vec3d& point) {
    const uint32_t first = mesh.incident_first[start[0]], end = mesh.incident_first[start[0] + 1];
    const auto around = mesh.incident.subspan(first, end - first);
    SurfacePlane at{*std::ranges::find_if(around, [&](uint32_t t) { return mesh.triangle[t] == start; }), normal};
    if (bend_of(mesh, at.triangle, mesh.position[start[0]], normal) > kFlat) return {};
    const double side = face_normal(mesh, at.triangle).dot(normal) < 0 ? -1 : 1;  // of a sheet, either
    for (int crossed = 0; crossed < kMostCrossed; ++crossed) {
        const Triangle& t = mesh.triangle[at.triangle];
        double farthest = 0;
        uint32_t across = at.triangle;
        for (uint32_t k = 0; k < 3; ++k) {
            const Vec3d& a = mesh.position[t[k]];
            const Vec3d edge = mesh.position[t[(k + 1) % 3]] - a;
            const double beyond = side * edge.cross(at.normal).dot(point - a) / std::max(edge.norm(), 1e-300);
            if (beyond > farthest) farthest = beyond, across = mesh.neighbour[at.triangle][k];
        }
        if (across == at.triangle) return at;
        if (across == kNone) return {};
        const double bend = bend_of(mesh, across, mesh.position[t[0]], at.normal);
        if (bend > kSmooth) return {};
        if (bend > kFlat) at.normal = side * face_normal(mesh, across);
        at.triangle = across;
    }
    return {};
}

}  // namespace trocar
