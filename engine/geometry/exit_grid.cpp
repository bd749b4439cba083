#include "engine/geometry/exit_grid.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/geometry/point_triangle.hpp"
namespace trocar {

uint32_t ExitGrid::cell_of(double x, int axis) const {
    const double cell = std::floor((x - low_[axis]) / size_[axis]);
    return static_cast<uint32_t>(std::clamp(cell, 0.0, static_cast<double>(cells_ - 1)));
}

void ExitGrid::build(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& direction) {
    position_ = position;
    triangle_ = triangle;
    direction_ = direction;
    u_ = direction.unitOrthogonal();
    v_ = direction.cross(u_);
    std::array<double, 2> high;
    low_.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
    for (const Vec3d& p : position) {
        const auto at = across(p);
        for (int k = 0; k < 2; ++k) low_[k] = std::min(low_[k], at[k]), high[k] = std::max(high[k], at[k]);
    }
    // few enough cells that large triangles, which overlap all of them, stay cheap
    cells_ = std::clamp(static_cast<uint32_t>(std::sqrt(static_cast<double>(triangle.size()) / 2)), 1u, 32u);
    for (int k = 0; k < 2; ++k) size_[k] = std::max((high[k] - low_[k]) / cells_, std::numeric_limits<double>::min());

    // counting sort: counts first, then positions
    first_.assign(cells_ * cells_ + 2, 0);
    const auto each = [&](const auto& visit) {
        for (uint32_t t = 0; t < triangle.size(); ++t) {
            const Vec3d &a = position[triangle[t][0]], &b = position[triangle[t][1]], &c = position[triangle[t][2]];
            if (!(triangle_normal(a, b, c).dot(direction) > 0)) continue;
            const auto pa = across(a), pb = across(b), pc = across(c);
            std::array<uint32_t, 2> from, to;
            for (int k = 0; k < 2; ++k) {
                from[k] = cell_of(std::min({pa[k], pb[k], pc[k]}), k);
                to[k] = cell_of(std::max({pa[k], pb[k], pc[k]}), k);
            }
            for (uint32_t y = from[1]; y <= to[1]; ++y)
                for (uint32_t x = from[0]; x <= to[0]; ++x) visit(y * cells_ + x, t);
        }
    };
    each([&](uint32_t cell, uint32_t) { ++first_[cell + 2]; });
    for (size_t i = 2; i < first_.size(); ++i) first_[i] += first_[i - 1];
    entry_.resize(first_.back());
    each([&](uint32_t cell, uint32_t t) { entry_[first_[cell + 1]++] = t; });
}

ExitGrid::Exit ExitGrid::find(const Vec3d& p) const {
    Exit best;
    const auto at = across(p);
    const uint32_t cell = cell_of(at[1], 1) * cells_ + cell_of(at[0], 0);
    for (uint32_t i = first_[cell]; i < first_[cell + 1]; ++i) {
        const Triangle& t = triangle_[entry_[i]];
        const Vec3d &a = position_[t[0]], &b = position_[t[1]], &c = position_[t[2]];
        const Vec3d normal = triangle_normal(a, b, c);
        const double distance = normal.dot(a - p) / normal.dot(direction_);
        if (!(distance >= 0 && (best.triangle == kNone || distance < best.distance))) continue;
        const Vec3d q = p + distance * direction_;
        const double slack = -1e-12 * normal.squaredNorm();  // a line through an edge counts as crossing both its triangles
        if (normal.dot((b - a).cross(q - a)) < slack || normal.dot((c - b).cross(q - b)) < slack ||
            normal.dot((a - c).cross(q - c)) < slack)
            continue;
        best = {entry_[i], distance};
    }
    return best;
}

}  // namespace trocar
