#pragma once
#include <span>
namespace trocar {

// How a series drifts: the median slope between all pairs of points, and a 95 % interval of it (Theil 1950; Sen, "Estimates of
// the regression coefficient based on Kendall's tau", JASA 63, 1968, section 6). A few outliers do not move it.
struct Drift {
    double slope = 0, low = 0, high = 0;  // unit of y per unit of x
    bool known = false;                   // false with fewer than kLeastPoints points
};
inline constexpr size_t kLeastPoints = 8;

// x ascending; at most 400 evenly chosen points are looked at.
Drift theil_sen(std::span<const double> x, std::span<const double> y);

}  // namespace trocar
