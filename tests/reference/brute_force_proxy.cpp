#include "tests/reference/brute_force_proxy.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
namespace trocar::reference {
namespace {

// closest point on segment ab
Vec3d on_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const double t = std::clamp((p - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
    return a + t * (b - a);
}
// closest point on a triangle: the projection if it is inside, otherwise the closest point on a side
Vec3d on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d n = (b - a).cross(c - a).normalized();
    const Vec3d foot = p - n.dot(p - a) * n;
    if (n.dot((b - a).cross(foot - a)) >= 0 && n.dot((c - b).cross(foot - b)) >= 0 && n.dot((a - c).cross(foot - c)) >= 0) return foot;
    Vec3d best = on_segment(p, a, b);
    for (const Vec3d& q : {on_segment(p, b, c), on_segment(p, c, a)})
        if ((q - p).norm() < (best - p).norm()) best = q;
    return best;
}

// moves the ball straight away from the closest triangle until it is clear
Vec3d pushed_out(std::span<const Vec3d> position, std::span<const Triangle> triangle, Vec3d p, double radius) {
    for (int push = 0; push < 500; ++push) {
        Vec3d nearest = Vec3d::Zero();
        double distance = 1e300;
        for (const Triangle& t : triangle) {
            const Vec3d q = on_triangle(p, position[t[0]], position[t[1]], position[t[2]]);
            if ((p - q).norm() < distance) distance = (p - q).norm(), nearest = q;
        }
        if (distance >= radius - 1e-12) break;
        p = nearest + (p - nearest) * (radius / distance);
    }
    return p;
}

}  // namespace

Vec3d brute_force_proxy(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& start, const Vec3d& goal,
                        double radius, double step) {
    Vec3d p = start;
    for (int k = 0; k < 20000; ++k) {
        const double before = (goal - p).norm();
        const Vec3d ahead = p + (goal - p) * std::min(1.0, step / std::max(before, 1e-300));
        const Vec3d next = pushed_out(position, triangle, ahead, radius);
        if ((goal - next).norm() > before - 1e-6 * step) break;
        p = next;
    }
    // random steps that shrink as long as none comes nearer
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (double length = step; length > 1e-4 * step;) {
        bool nearer = false;
        for (int k = 0; k < 60 && !nearer; ++k) {
            const Vec3d direction = Vec3d(normal(random), normal(random), normal(random)).normalized();
            const Vec3d next = pushed_out(position, triangle, p + length * direction, radius);
            if ((goal - next).norm() < (goal - p).norm()) p = next, nearer = true;
        }
        if (!nearer) length *= 0.5;
    }
    return p;
}

}  // namespace trocar::reference
