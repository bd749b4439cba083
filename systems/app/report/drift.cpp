#include "systems/app/report/drift.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/base/check.hpp"
namespace trocar {
namespace {

constexpr size_t kMostPoints = 400;
constexpr double kNormal975 = 1.959964;  // 97.5 % quantile of the standard normal distribution

}  // namespace

Drift theil_sen(std::span<const double> x, std::span<const double> y) {
    TROCAR_ASSERT(x.size() == y.size());
    if (x.size() < kLeastPoints) return {};
    const size_t n = std::min(x.size(), kMostPoints);
    const auto chosen = [&](size_t i) { return i * (x.size() - 1) / (n - 1); };
    std::vector<double> slopes;
    slopes.reserve(n * (n - 1) / 2);
    for (size_t i = 0; i < n; ++i)
        for (size_t j = i + 1; j < n; ++j)
            if (const size_t a = chosen(i), b = chosen(j); x[b] > x[a]) slopes.push_back((y[b] - y[a]) / (x[b] - x[a]));
    if (slopes.empty()) return {};
    std::sort(slopes.begin(), slopes.end());
    const double count = static_cast<double>(slopes.size()), points = static_cast<double>(n);
    const double spread = kNormal975 * std::sqrt(points * (points - 1) * (2 * points + 5) / 18);
    const auto at = [&](double rank) { return slopes[static_cast<size_t>(std::clamp(rank, 0.0, count - 1))]; };
    Drift drift;
    drift.slope = slopes.size() % 2 ? slopes[slopes.size() / 2] : 0.5 * (slopes[slopes.size() / 2 - 1] + slopes[slopes.size() / 2]);
    drift.low = at(std::floor((count - spread) / 2) - 1);
    drift.high = at(std::ceil((count + spread) / 2));
    drift.known = true;
    return drift;
}

}  // namespace trocar
