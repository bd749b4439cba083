#pragma once
#include <span>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Band limit of motion: hands move voluntarily below 10 Hz.
inline constexpr double kMotionBand = 10;  // Hz

// Samples and derivatives of one smoothed column.
struct SmoothColumn {
    std::vector<double> value, first, third;  // unit, unit/s, unit/s^3
};

// Each column (one value per time) as the polynomial of degree 5 that fits the samples around each time best (Savitzky and Golay
// 1964), and its first and third derivative. The window makes the filter's -3 dB point `band` (Hz; Schafer 2011, for wide windows). A
// minimum-jerk stroke, which is of degree 5, passes unchanged. Nearer to an end than half a window, where a fit is least certain, the
// window is twice as long. `time`: s, ascending, in any intervals.
std::vector<SmoothColumn> smooth_columns(std::span<const double> time, std::span<const std::vector<double>> columns,
                                         double band = kMotionBand);

// Motion of one tool: what the metrics of motion read.
struct SmoothPath {
    std::vector<double> time;   // s
    std::vector<double> speed;  // m/s
    std::vector<double> jerk;   // m/s^3
    std::vector<Vec3d> place;   // m
    std::vector<double> turn;   // rad, since the sample before
};
SmoothPath smooth_path(std::span<const double> time, std::span<const Vec3d> place, std::span<const Quat> turn);

// Integral over time by the trapezoidal rule.
double integral(std::span<const double> time, std::span<const double> values);

// Spectral arc length of a speed profile (Balasubramanian, Melendez-Calderon, Roby-Brami, Burdet 2015): minus the length of the curve of
// the amplitude spectrum, normalised by its largest value, over frequency normalised to 1, up to the last frequency of at most 10 Hz at
// which the amplitude is at least 5 %. Their zero-padding (16 times). 0 without motion. `rate`: Hz.
double spectral_arc_length(std::span<const double> speed, double rate);

// The same of a smoothed path, resampled in even intervals, at most 100 a second.
double spectral_arc_length(const SmoothPath& path);

// Log dimensionless jerk (Balasubramanian, Melendez-Calderon, Burdet 2012): -ln(T^3 / v^2 * integral of jerk^2), T the duration, v the
// highest speed. A minimum-jerk stroke has -ln 204.8 = -5.322. 0 without motion.
double log_dimensionless_jerk(const SmoothPath& path);

}  // namespace trocar
