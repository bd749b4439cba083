#pragma once
#include <cmath>

#include "content/shapes/tube.hpp"
namespace trocar::reference {

// Volume of a straight or bent tube with circular sections: pi * the integral of the squared radius (Pappus).
inline double profile_volume(const RadiusProfile& profile) {
    double sum = 0;
    for (size_t i = 0; i + 1 < profile.key.size(); ++i) {
        const RadiusKey &a = profile.key[i], &b = profile.key[i + 1];
        const double h = b.s - a.s;
        sum += h * (a.radius * a.radius + b.radius * b.radius) / 2 + h * h * (profile.slope[i] - profile.slope[i + 1]) / 12;
    }
    return M_PI * sum;
}

}  // namespace trocar::reference
