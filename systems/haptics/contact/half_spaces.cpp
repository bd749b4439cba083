#include "systems/haptics/contact/half_spaces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
namespace trocar {
namespace {

constexpr double kTiny = 1e-14;      // m, a half-space violated by less counts as satisfied
constexpr double kParallel = 1e-20;  // squared sine of the angle between two normals
constexpr double kInfinity = std::numeric_limits<double>::infinity();

bool broken(const HalfSpace& h, const Vec3d& x) { return h.normal.dot(x) < h.bound - kTiny; }

// nearest point to the goal on the line where planes i and j meet, inside half-spaces 0 .. j - 1
Projection on_line(const Vec3d& goal, const HalfSpaces& planes, uint32_t i, uint32_t j) {
    const HalfSpace &a = planes.half_space[i], &b = planes.half_space[j];
    const Vec3d along = a.normal.cross(b.normal);
    const double sine2 = along.squaredNorm(), cosine = a.normal.dot(b.normal);
    const double miss_a = a.bound - a.normal.dot(goal), miss_b = b.bound - b.normal.dot(goal);
    const Vec3d closest = goal + ((miss_a - cosine * miss_b) / sine2) * a.normal + ((miss_b - cosine * miss_a) / sine2) * b.normal;
    double low = -kInfinity, high = kInfinity;
    uint32_t low_row = kNone, high_row = kNone;
    for (uint32_t k = 0; k < j; ++k) {
        const double slope = planes.half_space[k].normal.dot(along);
        const double miss = planes.half_space[k].bound - planes.half_space[k].normal.dot(closest);
        if (slope * slope < kParallel * sine2) {
            if (miss > kTiny) return {closest, {}, 0, false};
        } else if (slope > 0) {
            if (miss / slope > low) low = miss / slope, low_row = k;
        } else {
            if (miss / slope < high) high = miss / slope, high_row = k;
        }
    }
    if (low > high) return {closest, {}, 0, false};
    if (low > 0) return {closest + low * along, {i, j, low_row}, 3, true};
    if (high < 0) return {closest + high * along, {i, j, high_row}, 3, true};
    return {closest, {i, j, 0}, 2, true};
}

// nearest point to the goal on plane i, inside half-spaces 0 .. i - 1
Projection on_plane(const Vec3d& goal, const HalfSpaces& planes, uint32_t i) {
    const HalfSpace& a = planes.half_space[i];
    Projection best{goal + (a.bound - a.normal.dot(goal)) * a.normal, {i, 0, 0}, 1, true};
    for (uint32_t j = 0; j < i; ++j) {
        const HalfSpace& b = planes.half_space[j];
        if (!broken(b, best.point)) continue;
        if (a.normal.cross(b.normal).squaredNorm() < kParallel) {
            // parallel normals: one half-space implies the other up to rounding
            if (a.normal.dot(b.normal) > 0) continue;
            return {best.point, {}, 0, false};
        }
        best = on_line(goal, planes, i, j);
        if (!best.feasible) return best;
    }
    return best;
}

}  // namespace

bool HalfSpaces::add(const HalfSpace& plane) {
    for (uint32_t k = 0; k < count; ++k)
        if ((half_space[k].normal - plane.normal).squaredNorm() < 1e-24 && std::abs(half_space[k].bound - plane.bound) < kTiny) return true;
    if (count == kCapacity) return false;
    half_space[count++] = plane;
    return true;
}

Projection project_on_half_spaces(const Vec3d& goal, const HalfSpaces& planes) {
    Projection best{goal, {}, 0, true};
    for (uint32_t i = 0; i < planes.count; ++i) {
        if (!broken(planes.half_space[i], best.point)) continue;
        best = on_plane(goal, planes, i);
        if (!best.feasible) return best;
    }
    return best;
}

}  // namespace trocar
