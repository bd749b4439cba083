#include "tests/reference/brute_force_contact.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "tests/reference/brute_force_distance.hpp"
namespace trocar::reference {
namespace {

double squared_to_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const Vec3d d = b - a;
    const double length = d.squaredNorm();
    const double t = length > 0 ? std::clamp((p - a).dot(d) / length, 0.0, 1.0) : 0.0;
    return (a + t * d - p).squaredNorm();
}

// The plane's distance if the projection is inside the triangle, otherwise the distance to the nearest of
// three segments.
double squared_to_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d n = (b - a).cross(c - a);
    const double nn = n.squaredNorm();
    if (nn > 0) {
        const bool inside = (b - a).cross(p - a).dot(n) >= 0 && (c - b).cross(p - b).dot(n) >= 0 && (a - c).cross(p - c).dot(n) >= 0;
        if (inside) {
            const double height = (p - a).dot(n);
            return height * height / nn;
        }
    }
    return std::min({squared_to_segment(p, a, b), squared_to_segment(p, b, c), squared_to_segment(p, c, a)});
}

}  // namespace

Surface::Surface(const Surfaces& surfaces, uint32_t body) {
    const MeshView mesh = mesh_view(surfaces.meshes, surfaces.bodies.mesh[body]);
    triangle.assign(mesh.triangle.begin(), mesh.triangle.end());
    for (uint32_t v = 0; v < mesh.position.size(); ++v) position.push_back(vertex_position(surfaces, body, v));
}

double Surface::winding_number(const Vec3d& p) const { return brute_force_winding(position, triangle, p); }

double Surface::unsigned_distance(const Vec3d& p) const {
    double best = std::numeric_limits<double>::infinity();
    for (const Triangle& t : triangle) {
        best = std::min(best, squared_to_triangle(p, position[t[0]], position[t[1]], position[t[2]]));
    }
    return std::sqrt(best);
}

double Surface::signed_distance(const Vec3d& p) const { return winding_number(p) > 0.5 ? -unsigned_distance(p) : unsigned_distance(p); }

std::vector<NearVertex> near_vertices(const Surfaces& surfaces, uint32_t a, uint32_t b, double margin) {
    std::vector<NearVertex> found;
    const Surface of_a(surfaces, a), of_b(surfaces, b);
    const auto search = [&](const Surface& own, const Surface& other, uint32_t body, uint32_t other_body) {
        Vec3d low = other.position[0], high = low;
        for (const Vec3d& p : other.position) {
            low = low.cwiseMin(p);
            high = high.cwiseMax(p);
        }
        for (uint32_t v = 0; v < own.position.size(); ++v) {
            const Vec3d& p = own.position[v];
            // outside the box by more than the margin: neither inside nor near
            if ((p - low).minCoeff() < -margin || (high - p).minCoeff() < -margin) continue;
            const double d = other.signed_distance(p);
            if (d < margin) found.push_back({body, other_body, v, d});
        }
    };
    search(of_a, of_b, a, b);
    search(of_b, of_a, b, a);
    return found;
}

std::vector<std::array<uint32_t, 2>> meeting_triangles(const Surface& a, const Surface& b, double reach_a, double reach_b) {
    const auto boxes = [](const Surface& s, double reach) {
        std::vector<Box> out;
        for (const Triangle& t : s.triangle) {
            Box box;
            for (const uint32_t v : t) {
                box.min = box.min.cwiseMin(s.position[v]);
                box.max = box.max.cwiseMax(s.position[v]);
            }
            out.push_back({box.min - Vec3d::Constant(reach), box.max + Vec3d::Constant(reach)});
        }
        return out;
    };
    const std::vector<Box> box_a = boxes(a, reach_a), box_b = boxes(b, reach_b);
    std::vector<std::array<uint32_t, 2>> found;
    for (uint32_t i = 0; i < box_a.size(); ++i) {
        for (uint32_t j = 0; j < box_b.size(); ++j) {
            const Box &x = box_a[i], &y = box_b[j];
            bool meet = true;
            for (int k = 0; k < 3; ++k) meet = meet && x.min[k] <= y.max[k] && y.min[k] <= x.max[k];
            if (meet) found.push_back({i, j});
        }
    }
    return found;
}

double deepest_on_edge(const Surface& surface, const Vec3d& p, const Vec3d& q, uint32_t samples) {
    double deepest = -std::numeric_limits<double>::infinity();
    for (uint32_t i = 0; i <= samples; ++i) {
        deepest = std::max(deepest, -surface.signed_distance(p + (double(i) / samples) * (q - p)));
    }
    return deepest;
}

bool surely_crosses(const Surface& surface, const Vec3d& p, const Vec3d& q, double slack) {
    for (const Triangle& t : surface.triangle) {
        const Vec3d a = surface.position[t[0]], b = surface.position[t[1]], c = surface.position[t[2]];
        const Vec3d n = (b - a).cross(c - a).normalized();
        const double above = n.dot(p - a), below = n.dot(q - a);
        if (above * below >= 0 || std::min(std::abs(above), std::abs(below)) < slack) continue;
        const Vec3d x = p + above / (above - below) * (q - p);
        const auto within = [&](const Vec3d& u, const Vec3d& v) { return n.dot((v - u).cross(x - u)) / (v - u).norm() > slack; };
        if (within(a, b) && within(b, c) && within(c, a)) return true;
    }
    return false;
}

}  // namespace trocar::reference
