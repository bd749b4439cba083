#include "systems/haptics/contact/surface_crossing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
namespace trocar {
namespace {

constexpr double kOnTriangle = 1e-8;  // m, a point this close to a triangle is on it: none slips through between two
constexpr double kAbove = 1e-8;       // m, from the surface, and ...
constexpr double kInset = 1e-3;       // ... fraction of the distance to the middle of the triangle: clear of its neighbours, too

using Cubic = std::array<double, 4>;  // coefficients, constant first
double value_of(const Cubic& c, double t) { return ((c[3] * t + c[2]) * t + c[1]) * t + c[0]; }

// Calls visit(root, whether the values there fall) for the changes of sign in 0..1, ascending, until it returns true.
template <typename Visit>
void for_roots(const Cubic& c, const Visit& visit) {
    std::array<double, 4> end{0, 1, 1, 1};  // between two of them the values rise or fall
    const double a = 3 * c[3], b = c[2], d = b * b - a * c[1];
    if (d > 0) {
        const double q = -b - std::copysign(std::sqrt(d), b), one = a != 0 ? q / a : 1, other = q != 0 ? c[1] / q : 1;
        end = {0, std::clamp(std::min(one, other), 0.0, 1.0), std::clamp(std::max(one, other), 0.0, 1.0), 1};
    }
    for (size_t k = 0; k + 1 < end.size(); ++k) {
        double low = end[k], high = end[k + 1];
        const bool falls = value_of(c, low) > 0;
        if (falls ? value_of(c, high) > 0 : value_of(c, high) <= 0) continue;
        for (int n = 0; n < 60 && low < high; ++n) {
            const double middle = 0.5 * (low + high);
            ((value_of(c, middle) > 0) == falls ? low : high) = middle;
        }
        if (visit(high, falls)) return;
    }
}

// Six times the volume between the point and the triangle, positive in front of it, over the motion.
Cubic volume_over_time(const PassingTriangle& p) {
    const Vec3d q = -p.corner[0], dq = -p.displacement[0], u = p.corner[1] - p.corner[0], du = p.displacement[1] - p.displacement[0],
                v = p.corner[2] - p.corner[0], dv = p.displacement[2] - p.displacement[0];
    const Vec3d n = u.cross(v), dn = u.cross(dv) + du.cross(v), ddn = du.cross(dv);
    return {q.dot(n), q.dot(dn) + dq.dot(n), q.dot(ddn) + dq.dot(dn), dq.dot(ddn)};
}

}  // namespace

PassingTime first_passing(const PassingTriangle& p, bool from_behind, double before) {
    PassingTime first;
    for_roots(volume_over_time(p), [&](double time, bool falls) {
        if (time >= before || !(falls || from_behind)) return time >= before;
        const std::array<Vec3d, 3> corner{p.corner[0] + time * p.displacement[0], p.corner[1] + time * p.displacement[1],
                                          p.corner[2] + time * p.displacement[2]};
        const TrianglePoint q = closest_point_on_triangle(Vec3d::Zero(), corner[0], corner[1], corner[2]);
        if (q.squared_distance > kOnTriangle * kOnTriangle) return false;
        first = {time, weights_at(corner, q.offset), falls ? 1.0 : -1.0};
        return true;
    });
    return first;
}

SurfaceCrossing first_crossing(const SurfaceTime& before, const Vec3d& from, const Vec3d& to, double travel, NearSurface& near) {
    go_to(to, near);
    // only triangles this near to its end can have passed over the point
    find_within(travel + (to - from).norm() + kOnTriangle - near.tip_radius, near);
    SurfaceCrossing first;
    const LocalContactModel& model = *near.model;
    for (const TriangleAhead& one : near.ahead) {
        const uint32_t index = ask_for(near, one.triangle);
        const NearTriangle& triangle = near.triangle[index];
        PassingTriangle p;
        for (size_t k = 0; k < 3; ++k) {
            Vec3d went = (near.time.age - before.age) * model.velocity[vertices_of(near, index)[k]];
            if (triangle.body == model.compliance.body) went += near.time.follow - before.follow;
            p.corner[k] = triangle.corner[k] - went - from;
            p.displacement[k] = went - (to - from);
        }
        const PassingTime at = first_passing(p, triangle.sheet, first.time);
        if (at.side != 0) first = {index, at.time, at.weight, at.side};
    }
    return first;
}

Vec3d above_crossing(const SurfaceCrossing& crossing, NearSurface& near) {
    const std::array<Vec3d, 3>& corner = near.triangle[crossing.index].corner;
    const Vec3d w = crossing.weight + kInset * (Vec3d::Constant(1.0 / 3) - crossing.weight);
    return w[0] * corner[0] + w[1] * corner[1] + w[2] * corner[2] + crossing.side * kAbove * normal_of(near, crossing.index);
}

}  // namespace trocar
