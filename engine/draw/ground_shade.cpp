#include "engine/draw/ground_shade.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar {
namespace {

constexpr float kReach = 2.5f;  // deviations
constexpr float kCellsPerHalfAxis = 6;
constexpr float kMostCells = 384;

bool has_shape(const GroundShadow& s) {
    const float area = s.xx * s.yy - s.xy * s.xy;
    return std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(area) && area > 0 && s.xx > 0 && s.darkness > 0;
}

// Half extents of the axis-aligned rectangle around a shadow, m.
float reach_x(const GroundShadow& s) { return kReach * std::sqrt(s.yy / (s.xx * s.yy - s.xy * s.xy)); }
float reach_y(const GroundShadow& s) { return kReach * std::sqrt(s.xx / (s.xx * s.yy - s.xy * s.xy)); }

float shorter_half_axis(const GroundShadow& s) {
    const float middle = 0.5f * (s.xx + s.yy), half = 0.5f * (s.xx - s.yy);
    return kReach / std::sqrt(middle + std::sqrt(half * half + s.xy * s.xy));
}

// Sets up the grid of cells: everything within the floor that a shadow reaches.
void lay_cells(std::span<const GroundShadow> shadows, float radius, GroundShade& out) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    float low_x = kFar, high_x = -kFar, low_y = kFar, high_y = -kFar, narrowest = kFar;
    for (const GroundShadow& s : shadows) {
        if (!has_shape(s)) continue;
        low_x = std::min(low_x, s.x - reach_x(s));
        high_x = std::max(high_x, s.x + reach_x(s));
        low_y = std::min(low_y, s.y - reach_y(s));
        high_y = std::max(high_y, s.y + reach_y(s));
        narrowest = std::min(narrowest, shorter_half_axis(s));
    }
    out = {std::max(low_x, -radius), std::max(low_y, -radius), 0, 0, 0, std::move(out.darkness)};
    const float width = std::min(high_x, radius) - out.x, height = std::min(high_y, radius) - out.y;
    if (!(width > 0) || !(height > 0)) return;
    out.cell = std::max(narrowest / kCellsPerHalfAxis, std::max(width, height) / kMostCells);
    out.columns = static_cast<uint32_t>(std::ceil(width / out.cell));
    out.rows = static_cast<uint32_t>(std::ceil(height / out.cell));
}

// First and past-the-last cell whose centre is less than `reach` from `at`, m from the first cell's lower
// side.
struct Cells {
    Eigen::Index first, end;
};
Cells cells_within(float at, float reach, float cell, uint32_t count) {
    const auto bound = [&](float x) {
        return static_cast<Eigen::Index>(std::ceil(std::clamp(x / cell - 0.5f, 0.0f, static_cast<float>(count))));
    };
    return {bound(at - reach), bound(at + reach)};
}

}  // namespace

void make_ground_shade(std::span<const GroundShadow> shadows, float radius, GroundShade& out) {
    lay_cells(shadows, radius, out);
    using Row = Eigen::Map<Eigen::ArrayXf>;
    out.darkness.assign(size_t{out.columns} * out.rows, 1.0f);  // holds the transmitted light first
    const Eigen::ArrayXf middles = (Eigen::ArrayXf::LinSpaced(out.columns, 0, static_cast<float>(out.columns) - 1) + 0.5f) * out.cell;
    for (const GroundShadow& s : shadows) {
        if (!has_shape(s) || out.columns == 0) continue;
        const float x = s.x - out.x, y = s.y - out.y, share = std::min(s.darkness / kDarkest, 1.0f);
        const Cells across = cells_within(x, reach_x(s), out.cell, out.columns), along = cells_within(y, reach_y(s), out.cell, out.rows);
        if (across.end <= across.first) continue;
        const auto dx = middles.segment(across.first, across.end - across.first) - x;
        for (Eigen::Index row = along.first; row < along.end; ++row) {
            const float dy = (static_cast<float>(row) + 0.5f) * out.cell - y;
            const auto q = (s.xx * dx + 2 * s.xy * dy) * dx + s.yy * dy * dy;
            const auto t = (1 - q / (kReach * kReach)).max(0.0f);
            Row(out.darkness.data() + row * out.columns + across.first, dx.size()) *= 1 - share * t.cube();
        }
    }
    Row all(out.darkness.data(), static_cast<Eigen::Index>(out.darkness.size()));
    all = kDarkest * (1 - all);
}

}  // namespace trocar
