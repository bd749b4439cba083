#include "engine/geometry/best_fit_rotation.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
namespace trocar {

std::array<Vec3d, 3> rotation_rows(const Quat& q) {
    const double xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z, xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z, wx = q.w * q.x,
                 wy = q.w * q.y, wz = q.w * q.z;
    return {Vec3d(1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)), Vec3d(2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)),
            Vec3d(2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy))};
}

bool solve_symmetric(const std::array<double, 6>& m, const Vec3d& b, Vec3d& x) {
    // L D L^T; a pivot lost to rounding counts as zero
    const double scale = 1e-12 * (m[0] + m[1] + m[2]);
    const double d0 = m[0];
    if (!(d0 > scale)) return false;
    const double l10 = m[3] / d0, l20 = m[4] / d0;
    const double d1 = m[1] - l10 * m[3];
    if (!(d1 > scale)) return false;
    const double l21 = (m[5] - l20 * m[3]) / d1;
    const double d2 = m[2] - l20 * m[4] - l21 * l21 * d1;
    if (!(d2 > scale)) return false;
    const double y0 = b.x(), y1 = b.y() - l10 * y0, y2 = b.z() - l20 * y0 - l21 * y1;
    const double z = y2 / d2, y = y1 / d1 - l21 * z;
    x = {y0 / d0 - l10 * y - l20 * z, y, z};
    return true;
}

namespace {

// The fit of a rotation: its value trace(R^T A), and that value's gradient and Hessian (negated) in the rotation
// vector.
struct Fit {
    double value = 0;
    Vec3d torque = Vec3d::Zero();
    std::array<double, 6> hessian{};
};

Fit evaluate(const std::array<Vec3d, 3>& a, const Quat& q) {
    // S = A R^T in world axes: trace(exp(-w) S) is the value after a rotation by w
    const std::array<Vec3d, 3> r = rotation_rows(q);
    double s[3][3];
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) s[i][j] = a[i].dot(r[j]);
    }
    const double trace = s[0][0] + s[1][1] + s[2][2];
    return {trace,
            Vec3d(s[2][1] - s[1][2], s[0][2] - s[2][0], s[1][0] - s[0][1]),
            {trace - s[0][0], trace - s[1][1], trace - s[2][2], -0.5 * (s[0][1] + s[1][0]), -0.5 * (s[0][2] + s[2][0]),
             -0.5 * (s[1][2] + s[2][1])}};
}

}  // namespace

Quat best_fit_rotation(const std::array<Vec3d, 3>& a, const Quat& start) {
    constexpr int kMostSteps = 200;
    constexpr double kConverged = 1e-9;  // rad, of the last step: the error of Newton's next step is its square
    const double size = a[0].norm() + a[1].norm() + a[2].norm();
    if (!(size > 0) || !std::isfinite(size)) return start;
    Quat q = start;
    Fit fit = evaluate(a, q);
    double shift = 0;  // makes the Hessian positive definite and the step short enough to increase the value
    for (int step = 0; step < kMostSteps; ++step) {
        std::array<double, 6> hessian = fit.hessian;
        for (int i = 0; i < 3; ++i) hessian[i] += shift;
        Vec3d turn;
        if (solve_symmetric(hessian, fit.torque, turn)) {
            const double angle = turn.norm();
            const Quat next = normalized(multiply(from_rotation_vector(turn), q));
            const Fit next_fit = evaluate(a, next);
            if (angle < kConverged) return next;
            if (angle < 2 && next_fit.value > fit.value - 1e-15 * size) {
                q = next;
                fit = next_fit;
                shift = shift < 1e-2 * size ? 0 : 0.25 * shift;
                continue;
            }
        }
        shift = std::max(4 * shift, 1e-2 * size);
    }
    return q;
}

}  // namespace trocar
