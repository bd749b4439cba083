#pragma once
#include <functional>
#include <vector>

#include "content/shapes/loft.hpp"
namespace trocar {

// A curve in space by arc length, with rotation-minimizing axes across it.
struct CentreLine {
    std::vector<Vec3d> point;    // m, evenly spaced
    std::vector<Vec3d> tangent;  // unit
    std::vector<Vec3d> across;   // unit, perpendicular to tangent
    double length = 0;           // m
    // Position at arc length s from the start, and the axes there.
    Vec3d at(double s, Vec3d& along, Vec3d& x, Vec3d& y) const;
};

// Samples curve(t), t in [0, 1]. Rotation-minimizing axes: Wang, Juettler, Zheng and Liu, "Computation of
// rotation minimizing frames" (2008), section 4 (double reflection).
CentreLine measure_curve(const std::function<Vec3d(double t)>& curve);

// A smooth curve through points: cubic Hermite with Catmull-Rom slopes, t from 0 to 1 over all of them.
std::function<Vec3d(double t)> curve_through(std::vector<Vec3d> points);

// Radius of a tube along its centre line. The square of the radius is interpolated (cubic Hermite, slopes
// limited against overshoot), so that an end with zero radius is round; the first and last radius are 0.
struct RadiusKey {
    double s = 0;       // m along the centre line
    double radius = 0;  // m
};
struct RadiusProfile {
    std::vector<RadiusKey> key;
    std::vector<double> slope;  // of the squared radius, m
    bool pointed = false;       // the last end is a cone, not round
    double radius(double s) const;
};
RadiusProfile make_profile(std::vector<RadiusKey> keys, bool pointed = false);

// The tube around a centre line. `swell(u, s)` multiplies the radius; empty = 1.
Loft tube_loft(const CentreLine& line, const RadiusProfile& profile, std::function<double(double u, double s)> swell = {});

}  // namespace trocar
