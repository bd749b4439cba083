#pragma once
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "components/mesh.hpp"
namespace trocar::reference {

// Convex hull of points in general position: every triple with all others on one side, O(n^4).
inline Mesh hull_of(const std::vector<Vec3d>& points) {
    Mesh mesh;
    std::vector<uint32_t> number(points.size(), kNone);
    const uint32_t n = static_cast<uint32_t>(points.size());
    const auto corner = [&](uint32_t i) {
        if (number[i] == kNone) number[i] = static_cast<uint32_t>(mesh.position.size()), mesh.position.push_back(points[i]);
        return number[i];
    };
    for (uint32_t i = 0; i < n; ++i) {
        for (uint32_t j = i + 1; j < n; ++j) {
            for (uint32_t k = j + 1; k < n; ++k) {
                const Vec3d normal = (points[j] - points[i]).cross(points[k] - points[i]);
                int above = 0, below = 0;
                for (uint32_t l = 0; l < n; ++l)
                    if (l != i && l != j && l != k) ++(normal.dot(points[l] - points[i]) > 0 ? above : below);
                if (above > 0 && below > 0) continue;
                if (above == 0)
                    mesh.triangle.push_back({corner(i), corner(j), corner(k)});
                else
                    mesh.triangle.push_back({corner(i), corner(k), corner(j)});
            }
        }
    }
    return mesh;
}

// Length of the shortest translation that separates b, moved by `at`, from a, both convex: the least support of their
// Minkowski difference over the normals that its faces can have: those of a, of b, and of pairs of edges.
inline double hull_depth(const Mesh& a, const Mesh& b, const Vec3d& at) {
    std::vector<Vec3d> directions, edges[2];
    for (const Mesh* mesh : {&a, &b}) {
        for (const Triangle& t : mesh->triangle) {
            const Vec3d &p = mesh->position[t[0]], &q = mesh->position[t[1]], &r = mesh->position[t[2]];
            directions.push_back((q - p).cross(r - p));
            for (const Vec3d& e : {Vec3d(q - p), Vec3d(r - q), Vec3d(p - r)}) edges[mesh == &b].push_back(e);
        }
    }
    for (const Vec3d& e : edges[0])
        for (const Vec3d& f : edges[1]) directions.push_back(e.cross(f));
    double least = INFINITY;
    for (Vec3d d : directions) {
        if (!(d.norm() > 1e-12)) continue;
        d.normalize();
        double top[2] = {-INFINITY, -INFINITY}, bottom[2] = {INFINITY, INFINITY};
        for (int body = 0; body < 2; ++body) {
            for (const Vec3d& p : (body ? b : a).position) {
                const double x = d.dot(body ? Vec3d(p + at) : p);
                top[body] = std::max(top[body], x), bottom[body] = std::min(bottom[body], x);
            }
        }
        least = std::min({least, top[0] - bottom[1], top[1] - bottom[0]});
    }
    return least;
}

}  // namespace trocar::reference
