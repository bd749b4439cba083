#include "engine/geometry/winding_number.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/predicates.hpp"
#include "engine/geometry/triangle_triangle.hpp"
namespace trocar {
namespace {

Vec3d corner(const Vec3d& v) { return v; }
Vec3d corner(const Float4& v) { return {v.x, v.y, v.z}; }

template <typename Position>
double sum_solid_angles(std::span<const Position> position, std::span<const Triangle> triangle, const Vec3d& p) {
    double half_angles = 0;
    for (const Triangle& t : triangle)
        half_angles += half_solid_angle(corner(position[t[0]]), corner(position[t[1]]), corner(position[t[2]]), p);
    return half_angles / (2.0 * std::numbers::pi);
}

double arc_between(const Vec3d& u, const Vec3d& v) { return std::atan2(triangle_normal(Vec3d::Zero(), u, v).norm(), u.dot(v)); }

}  // namespace

double half_solid_angle(const Vec3d& corner_a, const Vec3d& corner_b, const Vec3d& corner_c, const Vec3d& p) {
    const Vec3d a = corner_a - p, b = corner_b - p, c = corner_c - p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    // a . ((b - a) x (c - a)) = a . (b x c), with far less cancellation when p is far from the triangle
    const double volume = a.dot((b - a).cross(c - a)), size = la * lb * lc;
    const double scalar = size + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    constexpr double kCancelled = 1e-3;  // of size: below, rounding shows in needles
    if (scalar > kCancelled * size) return std::atan2(volume, scalar);
    const int side = -orient3d(corner_a, corner_b, corner_c, p);
    if (side == 0) return scalar > 0 ? 0 : std::numbers::pi;
    if (scalar < -kCancelled * size) return side * std::atan2(std::abs(volume), scalar);
    // l'Huilier's theorem from the sides of the spherical triangle
    const double x = arc_between(b, c), y = arc_between(c, a), z = arc_between(a, b), s = 0.5 * (x + y + z);
    const auto half_tangent = [](double angle) { return std::tan(0.5 * std::max(angle, 0.0)); };
    const double sides = half_tangent(s - x) * half_tangent(s - y) * half_tangent(s - z);
    return side * 2 * std::atan2(std::sqrt(sides), std::sqrt(half_tangent(std::numbers::pi - s)));
}

double winding_number(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p) {
    return sum_solid_angles(position, triangle, p);
}
double winding_number(std::span<const Float4> position, std::span<const Triangle> triangle, const Vec3d& p) {
    return sum_solid_angles(position, triangle, p);
}

bool count_winding(const Vec3d& corner_a, const Vec3d& corner_b, const Vec3d& corner_c, const Vec3d& point, int& windings) {
    const Vec3d* corner[3] = {&corner_a, &corner_b, &corner_c};
    const auto [low_y, high_y] = std::minmax({corner[0]->y(), corner[1]->y(), corner[2]->y()});
    const auto [low_z, high_z] = std::minmax({corner[0]->z(), corner[1]->z(), corner[2]->z()});
    if (point.y() < low_y || point.y() > high_y || point.z() < low_z || point.z() > high_z) return true;
    const int side = orient3d(*corner[0], *corner[1], *corner[2], point);
    if (side == 0 && meet_segment_triangle(point, point, {*corner[0], *corner[1], *corner[2]}) != Meeting::kDisjoint) return false;
    // the winding of the face's outline around the point, seen along x, edges half-open in y: neighbours
    // agree on their common edge
    int around = 0;
    for (int k = 0; k < 3; ++k) {
        const Vec3d &a = *corner[k], &b = *corner[(k + 1) % 3];
        if ((a.y() <= point.y()) == (b.y() <= point.y())) continue;
        const int turn = orient2d(a.y(), a.z(), b.y(), b.z(), point.y(), point.z());
        if (a.y() <= point.y() && turn > 0) ++around;
        if (a.y() > point.y() && turn < 0) --around;
    }
    if (around * side < 0) windings += around;
    return true;
}

bool count_windings(std::span<const Vec3d> position, std::span<const Triangle> triangle, std::span<const uint32_t> faces,
                    const Vec3d& point, int& windings) {
    windings = 0;
    return std::all_of(faces.begin(), faces.end(), [&](uint32_t t) {
        const Triangle& v = triangle[t];
        return count_winding(position[v[0]], position[v[1]], position[v[2]], point, windings);
    });
}

}  // namespace trocar
