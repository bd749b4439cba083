#pragma once
#include <cmath>

#include "components/math.hpp"
namespace trocar {

// Exact signs by expansion arithmetic, for all inputs. Slow: only where the filters below cannot decide.
int orient2d_exact(double ax, double ay, double bx, double by, double cx, double cy);
int orient3d_exact(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);

// Products below this may have lost bits to underflow (flush-to-zero is on), so the filters reject them.
inline constexpr double kUnderflowGuard = 0x1p-900;

// Orientation (-1, 0, 1) of a, b, c in the plane: 1 when counter-clockwise, 0 exactly when collinear. Exact
// for finite coordinates whose bits span less than 600 binary orders of magnitude. Shewchuk, "Adaptive
// precision floating-point arithmetic", DCG 18 (1997), section 4.2 (the filter).
inline int orient2d(double ax, double ay, double bx, double by, double cx, double cy) {
    const double left = (ax - cx) * (by - cy);
    const double right = (ay - cy) * (bx - cx);
    const double det = left - right;
    const double permanent = std::abs(left) + std::abs(right);
    if (permanent > kUnderflowGuard && std::abs(det) > (3.0 + 0x1p-49) * 0x1p-53 * permanent) return det > 0 ? 1 : -1;
    return orient2d_exact(ax, ay, bx, by, cx, cy);
}

// Side (-1, 0, 1) of d relative to the plane through a, b, c: 1 in the direction of (b - a) x (c - a), 0
// exactly when coplanar. Exact as orient2d. Shewchuk 1997, section 4.3 (the filter).
inline int orient3d(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    const double bx = b.x() - a.x(), by = b.y() - a.y(), bz = b.z() - a.z();
    const double cx = c.x() - a.x(), cy = c.y() - a.y(), cz = c.z() - a.z();
    const double dx = d.x() - a.x(), dy = d.y() - a.y(), dz = d.z() - a.z();
    const double by_cz = by * cz, bz_cy = bz * cy;
    const double bz_cx = bz * cx, bx_cz = bx * cz;
    const double bx_cy = bx * cy, by_cx = by * cx;
    const double det = dx * (by_cz - bz_cy) + dy * (bz_cx - bx_cz) + dz * (bx_cy - by_cx);
    const double permanent = std::abs(dx) * (std::abs(by_cz) + std::abs(bz_cy)) + std::abs(dy) * (std::abs(bz_cx) + std::abs(bx_cz)) +
                             std::abs(dz) * (std::abs(bx_cy) + std::abs(by_cx));
    if (permanent > kUnderflowGuard && std::abs(det) > (7.0 + 0x1p-46) * 0x1p-53 * permanent) return det > 0 ? 1 : -1;
    return orient3d_exact(a, b, c, d);
}

// Sign of the rotation from direction u -> v to direction s -> t in the plane. Exact as orient2d, without a
// filter: for ties.
int turn_exact(double ux, double uy, double vx, double vy, double sx, double sy, double tx, double ty);

// Simulation of simplicity for two bodies (Edelsbrunner, Muecke, ACM TOG 9(1), 1990, with one displacement of
// a body instead of one perturbation per point): the signs of orient3d when some of its points are displaced
// by the infinitesimal (e, e^2, e^3). They are 0 only where no displacement along the axes helps: a, b, c
// collinear; a-b parallel to c-d. d moves against a, b, c:
int orient3d_moving_point(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);
// c and d move against a and b:
int orient3d_moving_edge(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);

// True when a, b, c lie on one line (or coincide). Exact.
inline bool are_collinear(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    return orient2d(a.x(), a.y(), b.x(), b.y(), c.x(), c.y()) == 0 && orient2d(a.y(), a.z(), b.y(), b.z(), c.y(), c.z()) == 0 &&
           orient2d(a.z(), a.x(), b.z(), b.x(), c.z(), c.x()) == 0;
}

}  // namespace trocar
