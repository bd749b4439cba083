#include "tests/reference/brute_force_proxy.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
namespace trocar::reference {
namespace {

// nearest point of segment ab
Vec3d on_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const double t = std::clamp((p - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
    return a + t * (b - a);
}
// nearest point of a triangle: the foot of the perpendicular if it lies inside, else on the nearest side
Vec3d on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d n = (b - a).cross(c - a).normalized();
    const Vec3d foot = p - n.dot(p - a) * n;
    if (n.dot((b - a).cross(foot - a)) >= 0 && n.dot((c - b).cross(foot - b)) >= 0 &&
        n.dot((a - c).cross(foot - c)) >= 0)
        return foot;
    Vec3d best = on_segment(p, a, b);
    for (const Vec3d& q : {on_segment(p, b, c), on_segment(p, c, a)})
        if ((q - p).norm() < (best - p).norm()) best = q;
    return best;
}

}  // namespace

Vec3d brute_force_proxy(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& start,
                        const Vec3d& goal, double radius, double step) {
    Vec3d p = start;
    // the step shrinks once the distance to the goal stops falling, so that the end is sharp
    for (double length = step; length > 1e-2 * step; length *= 0.25) {
        for (int k = 0; k < 20000; ++k) {
            const double before = (goal - p).norm();
            Vec3d next = p + (goal - p) * std::min(1.0, length / std::max(before, 1e-300));
            for (int push = 0; push < 200; ++push) {
                Vec3d nearest = Vec3d::Zero();
                double distance = 1e300;
                for (const Triangle& t : triangle) {
                    const Vec3d q = on_triangle(next, position[t[0]], position[t[1]], position[t[2]]);
                    if ((next - q).norm() < distance) distance = (next - q).norm(), nearest = q;
                }
                if (distance >= radius - 1e-12) break;
                next = nearest + (next - nearest) * (radius / distance);
            }
            const double after = (goal - next).norm();
            if (after > before - 1e-8 * length) break;
            p = next;
        }
    }
    return p;
}

}  // namespace trocar::reference
