#pragma once
#include <span>
namespace trocar {

// Drift of a series: median slope over all pairs of points, with a 95 % interval (Theil 1950; Sen, "Estimates
// of the regression coefficient based on Kendall's tau", JASA 63, 1968, section 6). Robust against outliers.
struct Drift {
    double slope = 0, low = 0, high = 0;  // unit of y per unit of x
    bool known = false;                   // false with fewer than kLeastPoints points
};
inline constexpr size_t kLeastPoints = 8;

// x ascending; uses at most 400 evenly chosen points.
Drift theil_sen(std::span<const double> x, std::span<const double> y);

}  // namespace trocar
