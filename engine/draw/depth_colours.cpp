#include "engine/draw/depth_colours.hpp"

#include <algorithm>
#include <cmath>

namespace trocar {

std::array<float, 3> depth_colour(double t) {
    t = t > 0 ? std::min(t, 1.0) : 0.0;
    // a path in Oklab: lightness falls evenly, hue goes from yellow to red and violet, chroma peaks in the
    // middle
    const double lightness = 0.92 - 0.57 * t;
    const double hue = (100.0 - 125.0 * t) * (3.14159265358979323846 / 180.0);
    const double chroma = 0.09 + 0.38 * t * (1.0 - t) + 0.02 * t;
    const double a = chroma * std::cos(hue), b = chroma * std::sin(hue);
    const double l = lightness + 0.3963377774 * a + 0.2158037573 * b;
    const double m = lightness - 0.1055613458 * a - 0.0638541728 * b;
    const double s = lightness - 0.0894841775 * a - 1.2914855480 * b;
    const double l3 = l * l * l, m3 = m * m * m, s3 = s * s * s;
    const auto channel = [](double x) { return static_cast<float>(std::clamp(x, 0.0, 1.0)); };
    return {channel(4.0767416621 * l3 - 3.3077115913 * m3 + 0.2309699292 * s3),
            channel(-1.2684380046 * l3 + 2.6097574011 * m3 - 0.3413193965 * s3),
            channel(-0.0041960863 * l3 - 0.7034186147 * m3 + 1.7076147010 * s3)};
}

unsigned char srgb_byte(double linear) {
    const double x = std::clamp(linear, 0.0, 1.0);
    const double encoded = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
    return static_cast<unsigned char>(std::lround(255 * encoded));
}

}  // namespace trocar
