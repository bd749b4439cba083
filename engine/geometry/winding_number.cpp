#include "engine/geometry/winding_number.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
namespace trocar {
namespace {

Vec3d corner(const Vec3d& v) { return v; }
Vec3d corner(const Float4& v) { return {v.x, v.y, v.z}; }

template <typename Position>
double sum_solid_angles(std::span<const Position> position, std::span<const Triangle> triangle, const Vec3d& p) {
    double half_angles = 0;
    for (const Triangle& t : triangle) {
        const Vec3d a = corner(position[t[0]]) - p, b = corner(position[t[1]]) - p, c = corner(position[t[2]]) - p;
        const double la = a.norm(), lb = b.norm(), lc = c.norm();
        // a . ((b - a) x (c - a)) = a . (b x c), with far less cancellation when p is far from the triangle
        const double volume = a.dot((b - a).cross(c - a));
        half_angles += std::atan2(volume, la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    }
    return half_angles / (2.0 * std::numbers::pi);
}

}  // namespace

double winding_number(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p) {
    return sum_solid_angles(position, triangle, p);
}
double winding_number(std::span<const Float4> position, std::span<const Triangle> triangle, const Vec3d& p) {
    return sum_solid_angles(position, triangle, p);
}

}  // namespace trocar
