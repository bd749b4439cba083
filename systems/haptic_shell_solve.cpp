#include "systems/haptic_shell_solve.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace trocar {

namespace {

double distance_after(const ShellPlane& plane, const ShellStep& step) {
    return plane.distance + plane.normal.dot(step.shift + step.turn.cross(plane.arm));
}

constexpr uint32_t kMostSteps = 40;
constexpr uint32_t kMostHalvings = 30;

using Vector6 = std::array<double, 6>;

// Lower triangle, row by row.
struct Matrix6 {
    std::array<double, 21> entry{};
    double& at(int i, int j) { return entry[static_cast<size_t>(i * (i + 1) / 2 + j)]; }
};

void add_outer(double k, const Vector6& v, Matrix6& m) {
    for (int i = 0; i < 6; ++i) {
        const double kv = k * v[static_cast<size_t>(i)];
        for (int j = 0; j <= i; ++j) m.at(i, j) += kv * v[static_cast<size_t>(j)];
    }
}

// m x = b by Cholesky's method; m is positive definite: the coupling's springs are on its diagonal.
Vector6 solve(Matrix6 m, Vector6 b) {
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j <= i; ++j) {
            double sum = m.at(i, j);
            for (int k = 0; k < j; ++k) sum -= m.at(i, k) * m.at(j, k);
            m.at(i, j) = i == j ? std::sqrt(std::max(sum, 1e-300)) : sum / m.at(j, j);
        }
    }
    for (int i = 0; i < 6; ++i) {
        for (int k = 0; k < i; ++k) b[static_cast<size_t>(i)] -= m.at(i, k) * b[static_cast<size_t>(k)];
        b[static_cast<size_t>(i)] /= m.at(i, i);
    }
    for (int i = 5; i >= 0; --i) {
        for (int k = i + 1; k < 6; ++k) b[static_cast<size_t>(i)] -= m.at(k, i) * b[static_cast<size_t>(k)];
        b[static_cast<size_t>(i)] /= m.at(i, i);
    }
    return b;
}

Vector6 moved_by(const Vec3d& direction, const Vec3d& arm) {
    const Vec3d moment = arm.cross(direction);
    return {direction.x(), direction.y(), direction.z(), moment.x(), moment.y(), moment.z()};
}

// How far friction would be stretched along the plane if it held.
Vec3d stretch_after(const ShellPlane& plane, const ShellStep& step) {
    const Vec3d way = plane.slip + step.shift + step.turn.cross(plane.arm) - plane.carried;
    return way - plane.normal.dot(way) * plane.normal;
}

struct Slope {
    double energy = 0;    // J
    Vector6 downhill{};   // N, N m
    Matrix6 stiffness;
};

// Energy, force and stiffness of everything after a step; the last only where it is asked for.
template <bool with_stiffness>
Slope slope_at(const ShellSprings& springs, std::span<const ShellPlane> planes, const ShellStep& step) {
    Slope s;
    const Vec3d left = springs.way.shift - step.shift, turn = springs.way.turn - step.turn;
    s.energy = 0.5 * springs.stiffness * left.squaredNorm() + 0.5 * springs.turn_stiffness * turn.squaredNorm();
    Vec3d force = springs.stiffness * left, torque = springs.turn_stiffness * turn;
    if (with_stiffness)
        for (int i = 0; i < 3; ++i) s.stiffness.at(i, i) = springs.stiffness, s.stiffness.at(i + 3, i + 3) = springs.turn_stiffness;
    const double k = springs.surface_stiffness;
    for (const ShellPlane& plane : planes) {
        const double gap = distance_after(plane, step);
        Vec3d push = Vec3d::Zero();
        if (gap < 0) {
            push = -k * gap * plane.normal;
            s.energy += 0.5 * k * gap * gap;
            if (with_stiffness) add_outer(k, moved_by(plane.normal, plane.arm), s.stiffness);
        }
        if (plane.held > 0 && plane.friction > 0) {
            const Vec3d stretch = stretch_after(plane, step);
            const double length = stretch.norm(), most = plane.friction * plane.held;
            const bool yields = k * length > most;
            push -= (yields ? most / length : k) * stretch;
            s.energy += yields ? most * (length - 0.5 * most / k) : 0.5 * k * length * length;
            if (with_stiffness) {
                const Vec3d u = plane.normal.unitOrthogonal(), v = plane.normal.cross(u);
                const Vec3d along = yields ? Vec3d(stretch / length) : u;
                const Vec3d across = yields ? Vec3d(plane.normal.cross(along)) : v;
                add_outer(yields ? most / length : k, moved_by(across, plane.arm), s.stiffness);
                if (!yields) add_outer(k, moved_by(along, plane.arm), s.stiffness);
            }
        }
        force += push;
        torque += plane.arm.cross(push);
    }
    s.downhill = {force.x(), force.y(), force.z(), torque.x(), torque.y(), torque.z()};
    return s;
}

ShellStep moved(const ShellStep& from, const Vector6& way, double share) {
    return {from.shift + share * Vec3d(way[0], way[1], way[2]), from.turn + share * Vec3d(way[3], way[4], way[5])};
}

}  // namespace

double gap_after(const ShellPlane& plane, const ShellStep& step) { return distance_after(plane, step); }

ShellForce shell_force(const ShellSprings& springs, const ShellPlane& plane, const ShellStep& step) {
    ShellForce f;
    f.normal = springs.surface_stiffness * std::max(0.0, -gap_after(plane, step));
    f.force = f.normal * plane.normal;
    if (plane.friction <= 0 || f.normal <= 0) return f;
    f.slip = stretch_after(plane, step);
    const double most = plane.friction * f.normal / springs.surface_stiffness, length = f.slip.norm();
    f.yields = length > most;
    if (f.yields) f.slip *= most / length;
    f.force -= springs.surface_stiffness * f.slip;
    return f;
}

ShellStep solve_shell(const ShellSprings& springs, std::span<const ShellPlane> planes, const ShellStep& start) {
    ShellStep step = start;
    Slope s = slope_at<true>(springs, planes, step);
    double first = 0;  // what Newton's first step promised, J
    for (uint32_t k = 0; k < kMostSteps; ++k) {
        const Vector6 way = solve(s.stiffness, s.downhill);
        double promise = 0;
        for (size_t i = 0; i < 6; ++i) promise += way[i] * s.downhill[i];
        first = std::max(first, promise);
        if (!(promise > 1e-24 * first)) break;
        // too little for energies to tell: the planes that hold are found, and this step ends on their balance
        if (promise < 1e-12 * s.energy) return moved(step, way, 1);
        double share = 1;
        Slope next = slope_at<true>(springs, planes, moved(step, way, share));
        for (uint32_t half = 0; half < kMostHalvings && !(next.energy <= s.energy - 1e-4 * share * promise + 1e-15 * s.energy); ++half) {
            share *= 0.5;
            next = slope_at<true>(springs, planes, moved(step, way, share));
        }
        step = moved(step, way, share);
        s = next;
    }
    return step;
}

double stiffest_coupling(double damping, double dt, double delay) { return damping / (0.5 * dt + delay); }

}  // namespace trocar
