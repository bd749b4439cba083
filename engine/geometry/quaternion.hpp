#pragma once
#include <Eigen/Geometry>
#include <cmath>

#include "components/math.hpp"
namespace trocar {

// v rotated by q. Scalars, because Eigen's expressions compiled to calls, a twentieth of the time of a scene
// with much contact on static bodies.
inline Vec3d rotate(const Quat& q, const Vec3d& v) {
    const double tx = 2 * (q.y * v.z() - q.z * v.y()), ty = 2 * (q.z * v.x() - q.x * v.z()), tz = 2 * (q.x * v.y() - q.y * v.x());
    return {v.x() + q.w * tx + (q.y * tz - q.z * ty), v.y() + q.w * ty + (q.z * tx - q.x * tz), v.z() + q.w * tz + (q.x * ty - q.y * tx)};
}
inline Quat conjugate(const Quat& q) { return {q.w, -q.x, -q.y, -q.z}; }
inline Vec3d rotate_back(const Quat& q, const Vec3d& v) { return rotate(conjugate(q), v); }

// Product a b: rotation by b, then by a.
inline Quat multiply(const Quat& a, const Quat& b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}
inline Quat normalized(const Quat& q) {
    const double n = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    return n > 0 ? Quat{q.w / n, q.x / n, q.y / n, q.z / n} : Quat{};
}
// Rotation by |v| radians about v.
inline Quat from_rotation_vector(const Vec3d& v) {
    const double angle = v.norm();
    if (angle < 1e-300) return {};
    const double s = std::sin(0.5 * angle) / angle;
    return {std::cos(0.5 * angle), v.x() * s, v.y() * s, v.z() * s};
}
// Rotation vector (rad, world axes) of the shortest rotation from `from` to `to`.
inline Vec3d rotation_vector(const Quat& from, const Quat& to) {
    Quat d = multiply(to, conjugate(from));
    if (d.w < 0) d = {-d.w, -d.x, -d.y, -d.z};
    const Vec3d axis(d.x, d.y, d.z);
    const double sine = axis.norm();
    if (sine < 1e-300) return Vec3d::Zero();
    return axis * (2 * std::atan2(sine, d.w) / sine);
}

}  // namespace trocar
