#include "systems/haptics/contact/point_shell_solve.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "engine/geometry/four_points.hpp"
namespace trocar {

namespace {

double distance_after(const ShellPlane& plane, const ShellStep& step) {
    return plane.distance + plane.normal.dot(step.shift + step.turn.cross(plane.arm));
}

constexpr uint32_t kMostSteps = 40;
constexpr uint32_t kMostHalvings = 30;

using Vector6 = std::array<double, 6>;

// Row-major, two registers each; entries above the diagonal are not used.
struct Matrix6 {
    std::array<Vec4d, 12> half_index{};
    double at(int i, int j) const { return half_index[static_cast<size_t>(2 * i + j / 4)][j % 4]; }
    void set(int i, int j, double x) { half_index[static_cast<size_t>(2 * i + j / 4)][j % 4] = x; }
};

void add_outer(double k, const Vector6& v, Matrix6& m) {
    const Vec4d first{v[0], v[1], v[2], v[3]}, second{v[4], v[5], 0, 0};
    for (size_t i = 0; i < 6; ++i) {
        const Vec4d kv = all_lanes(k * v[i]);
        m.half_index[2 * i] += kv * first;
        m.half_index[2 * i + 1] += kv * second;
    }
}

// m x = b by Cholesky's method; m is positive definite: the coupling's springs are on its diagonal.
Vector6 solve(const Matrix6& matrix, Vector6 b) {
    std::array<Vector6, 6> root;
    const auto m = [&](int i, int j) -> double& { return root[static_cast<size_t>(i)][static_cast<size_t>(j)]; };
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j <= i; ++j) {
            double sum = matrix.at(i, j);
            for (int k = 0; k < j; ++k) sum -= m(i, k) * m(j, k);
            m(i, j) = i == j ? std::sqrt(std::max(sum, 1e-300)) : sum / m(j, j);
        }
    }
    for (int i = 0; i < 6; ++i) {
        for (int k = 0; k < i; ++k) b[static_cast<size_t>(i)] -= m(i, k) * b[static_cast<size_t>(k)];
        b[static_cast<size_t>(i)] /= m(i, i);
    }
    for (int i = 5; i >= 0; --i) {
        for (int k = i + 1; k < 6; ++k) b[static_cast<size_t>(i)] -= m(k, i) * b[static_cast<size_t>(k)];
        b[static_cast<size_t>(i)] /= m(i, i);
    }
    return b;
}

Vector6 moved_by(const Vec3d& direction, const Vec3d& arm) {
    const Vec3d moment = arm.cross(direction);
    return {direction.x(), direction.y(), direction.z(), moment.x(), moment.y(), moment.z()};
}

// Stretch of the friction spring along the plane after a step without slip.
Vec3d stretch_after(const ShellPlane& plane, const ShellStep& step) {
    const Vec3d displacement = plane.slip + step.shift + step.turn.cross(plane.arm) - plane.carried;
    return displacement - plane.normal.dot(displacement) * plane.normal;
}

// The data that decide whether a plane is active, four planes at a time: most are not.
struct FourPlanes {
    Vec4d distance = {};
    FourPoints normal, arm;
    Mask4 grips = {};  // they have friction
};
constexpr size_t kFours = 64;  // groups of four; further planes are evaluated one by one

struct SidePlanes {
    std::array<FourPlanes, kFours> four;
    uint32_t fours = 0;
};

void put_side_by_side(std::span<const ShellPlane> planes, SidePlanes& side) {
    side.fours = static_cast<uint32_t>(std::min(kFours, planes.size() / 4));
    for (uint32_t n = 0; n < side.fours; ++n) {
        const ShellPlane* p = &planes[4 * n];
        const auto four = [&](auto of) { return Vec4d{of(p[0]), of(p[1]), of(p[2]), of(p[3])}; };
        FourPlanes& to = side.four[n];
        to.distance = four([](const ShellPlane& q) { return q.distance; });
        to.normal = {four([](const ShellPlane& q) { return q.normal.x(); }), four([](const ShellPlane& q) { return q.normal.y(); }),
                     four([](const ShellPlane& q) { return q.normal.z(); })};
        to.arm = {four([](const ShellPlane& q) { return q.arm.x(); }), four([](const ShellPlane& q) { return q.arm.y(); }),
                  four([](const ShellPlane& q) { return q.arm.z(); })};
        to.grips = four([](const ShellPlane& q) { return q.held > 0 && q.friction > 0 ? 1.0 : 0.0; }) > Vec4d{};
    }
}

// One bit per plane with a force after a step: distance_after below zero, bitwise, or friction.
uint32_t planes_at_work(const FourPlanes& p, const FourPoints& shift, const FourPoints& turn) {
    const FourPoints displacement = shift + cross(turn, p.arm);
    const Vec4d gap = p.distance + (p.normal.x * displacement.x + (p.normal.y * displacement.y + p.normal.z * displacement.z));
    return mask_bits((gap < Vec4d{}) | p.grips);
}

struct Slope {
    double energy = 0;   // J
    Vector6 downhill{};  // N, N m
    Matrix6 stiffness;
};

// Energy, gradient and Hessian after a step.
Slope slope_at(const ShellSprings& springs, std::span<const ShellPlane> planes, const SidePlanes& side, const ShellStep& step) {
    Slope s;
    const Vec3d left = springs.to_device.shift - step.shift, turn = springs.to_device.turn - step.turn;
    s.energy = 0.5 * springs.stiffness * left.squaredNorm() + 0.5 * springs.turn_stiffness * turn.squaredNorm();
    Vec3d force = springs.stiffness * left, torque = springs.turn_stiffness * turn;
    for (int i = 0; i < 3; ++i) s.stiffness.set(i, i, springs.stiffness), s.stiffness.set(i + 3, i + 3, springs.turn_stiffness);
    const double k = springs.surface_stiffness;
    const auto add = [&](const ShellPlane& plane) {
        const double gap = distance_after(plane, step);
        Vec3d push = Vec3d::Zero();
        if (gap < 0) {
            push = -k * gap * plane.normal;
            s.energy += 0.5 * k * gap * gap;
            add_outer(k, moved_by(plane.normal, plane.arm), s.stiffness);
        }
        if (plane.held > 0 && plane.friction > 0) {
            const Vec3d stretch = stretch_after(plane, step);
            const double length = stretch.norm(), most = plane.friction * plane.held;
            const bool yields = k * length > most;
            push -= (yields ? most / length : k) * stretch;
            s.energy += yields ? most * (length - 0.5 * most / k) : 0.5 * k * length * length;
            const Vec3d u = plane.normal.unitOrthogonal(), v = plane.normal.cross(u);
            const Vec3d along = yields ? Vec3d(stretch / length) : u;
            const Vec3d across = yields ? Vec3d(plane.normal.cross(along)) : v;
            add_outer(yields ? most / length : k, moved_by(across, plane.arm), s.stiffness);
            if (!yields) add_outer(k, moved_by(along, plane.arm), s.stiffness);
        }
        force += push;
        torque += plane.arm.cross(push);
    };
    const FourPoints shift = in_all_lanes(step.shift), turned = in_all_lanes(step.turn);
    for (uint32_t n = 0; n < side.fours; ++n)
        for (uint32_t work = planes_at_work(side.four[n], shift, turned); work != 0; work &= work - 1)
            add(planes[4 * n + static_cast<uint32_t>(std::countr_zero(work))]);
    for (const ShellPlane& plane : planes.subspan(4 * side.fours)) add(plane);
    s.downhill = {force.x(), force.y(), force.z(), torque.x(), torque.y(), torque.z()};
    return s;
}

ShellStep moved(const ShellStep& from, const Vector6& displacement, double share) {
    return {from.shift + share * Vec3d(displacement[0], displacement[1], displacement[2]),
            from.turn + share * Vec3d(displacement[3], displacement[4], displacement[5])};
}

}  // namespace

double separation_after(const ShellPlane& plane, const ShellStep& step) { return distance_after(plane, step); }

ShellForce shell_force(const ShellSprings& springs, const ShellPlane& plane, const ShellStep& step) {
    ShellForce f;
    f.normal = springs.surface_stiffness * std::max(0.0, -separation_after(plane, step));
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
    SidePlanes side;
    put_side_by_side(planes, side);
    ShellStep step = start;
    Slope s = slope_at(springs, planes, side, step);
    double first = 0;  // predicted by Newton's first step, J
    for (uint32_t k = 0; k < kMostSteps; ++k) {
        const Vector6 displacement = solve(s.stiffness, s.downhill);
        double promise = 0;
        for (size_t i = 0; i < 6; ++i) promise += displacement[i] * s.downhill[i];
        first = std::max(first, promise);
        if (!(promise > 1e-24 * first)) break;
        // below the energies' resolution: the active planes are known; this step ends at their balance
        if (promise < 1e-12 * s.energy) return moved(step, displacement, 1);
        double share = 1;
        Slope next = slope_at(springs, planes, side, moved(step, displacement, share));
        for (uint32_t half = 0; half < kMostHalvings && !(next.energy <= s.energy - 1e-4 * share * promise + 1e-15 * s.energy); ++half) {
            share *= 0.5;
            next = slope_at(springs, planes, side, moved(step, displacement, share));
        }
        step = moved(step, displacement, share);
        s = next;
    }
    return step;
}

}  // namespace trocar
