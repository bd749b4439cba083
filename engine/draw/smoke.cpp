#include "engine/draw/smoke.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar {
namespace {

// Less cannot be told in 8 bits.
constexpr float kLeastDepth = 2e-3f;
// Puffs are followed to this many standard deviations: what is cut off is 0.2 % of the depth in the middle.
constexpr double kReach = 3.5;

// Columns or rows of the grid between two places across the picture, -1..1.
std::array<int, 2> span_of(double low, double high, uint32_t count) {
    const double scale = 0.5 * (count - 1);
    const auto clamp = [&](double x) { return static_cast<int>(std::clamp(x, -1.0, static_cast<double>(count))); };
    return {std::max(clamp(std::ceil((low + 1) * scale)), 0), std::min(clamp(std::floor((high + 1) * scale)), static_cast<int>(count) - 1)};
}

void add_puff(const View& view, const PicturePuff& puff, std::vector<SmokeVertex>& vertex) {
    const Vec3d right = Vec3(view.right.data()).cast<double>(), up = Vec3(view.up.data()).cast<double>();
    const Vec3d forward = Vec3(view.forward.data()).cast<double>(), at = puff.position - view.eye;
    const double ahead = at.dot(forward), reach = kReach * puff.spread;
    if (!(ahead + reach > 0) || !(puff.extinction > 0)) return;
    // near the eye a puff may be anywhere in the picture
    const bool near = ahead < 2 * reach;
    const double x = at.dot(right) / ahead / view.tan_x, y = at.dot(up) / ahead / view.tan_y, wide = 1.5 * reach / ahead;
    const auto columns =
        near ? std::array{0, static_cast<int>(kSmokeColumns) - 1} : span_of(x - wide / view.tan_x, x + wide / view.tan_x, kSmokeColumns);
    const auto rows =
        near ? std::array{0, static_cast<int>(kSmokeRows) - 1} : span_of(y - wide / view.tan_y, y + wide / view.tan_y, kSmokeRows);
    for (int r = rows[0]; r <= rows[1]; ++r) {
        for (int c = columns[0]; c <= columns[1]; ++c) {
            const double px = 2.0 * c / (kSmokeColumns - 1) - 1, py = 2.0 * r / (kSmokeRows - 1) - 1;
            const Vec3d ray = (forward + px * view.tan_x * right + py * view.tan_y * up).normalized();
            const double along = at.dot(ray), b2 = at.squaredNorm() - along * along;
            if (b2 > reach * reach) continue;
            const float depth = static_cast<float>(optical_depth(puff, std::max(b2, 0.0), along));
            SmokeVertex& v = vertex[static_cast<size_t>(r) * kSmokeColumns + static_cast<size_t>(c)];
            // sums here; the near side of the puff, so that tissue in its middle does not cut it off
            v.z += depth * static_cast<float>(std::max(along - puff.spread, 0.0));
            v.depth += depth;
        }
    }
}

}  // namespace

double optical_depth(const PicturePuff& puff, double squared_distance, double along) {
    const double variance = puff.spread * puff.spread;
    const double before = along > 4 * puff.spread ? 1 : 0.5 * std::erfc(-along / (std::numbers::sqrt2 * puff.spread));
    return before * puff.extinction / (2 * std::numbers::pi * variance) * std::exp(-squared_distance / (2 * variance));
}

void find_smoke(const View& view, std::span<const PicturePuff> puffs, std::vector<SmokeVertex>& vertex, std::vector<uint32_t>& index) {
    index.clear();
    if (puffs.empty()) return;
    vertex.assign(size_t{kSmokeColumns} * kSmokeRows, SmokeVertex{});
    for (const PicturePuff& puff : puffs) add_puff(view, puff, vertex);
    const Vec3 right(view.right.data()), up(view.up.data()), forward(view.forward.data());
    for (uint32_t r = 0; r < kSmokeRows; ++r) {
        for (uint32_t c = 0; c < kSmokeColumns; ++c) {
            SmokeVertex& v = vertex[size_t{r} * kSmokeColumns + c];
            const float px = 2.0f * static_cast<float>(c) / (kSmokeColumns - 1) - 1,
                        py = 2.0f * static_cast<float>(r) / (kSmokeRows - 1) - 1;
            const Vec3 ray = (forward + px * view.tan_x * right + py * view.tan_y * up).normalized();
            const float distance = std::max(v.depth > 0 ? v.z / v.depth : 0.0f, 2 * view.near_plane / std::max(ray.dot(forward), 0.1f));
            v.x = distance * ray.x(), v.y = distance * ray.y(), v.z = distance * ray.z();
        }
    }
    for (uint32_t r = 0; r + 1 < kSmokeRows; ++r) {
        for (uint32_t c = 0; c + 1 < kSmokeColumns; ++c) {
            const uint32_t a = r * kSmokeColumns + c, b = a + kSmokeColumns;
            if (std::max({vertex[a].depth, vertex[a + 1].depth, vertex[b].depth, vertex[b + 1].depth}) < kLeastDepth) continue;
            for (const uint32_t v : {a, a + 1, b + 1, a, b + 1, b}) index.push_back(v);
        }
    }
}

}  // namespace trocar
