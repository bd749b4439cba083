#pragma once
#include <cstdint>
#include <span>
#include <vector>
namespace trocar {

// Soft elliptic shadow on the floor: darkness * (1 - q / 6.25)^3 with q = d' S d < 6.25 at the offset d from
// its centre, nearly a Gaussian but ending at two and a half standard deviations.
struct GroundShadow {
    float x = 0, y = 0;            // m, from the floor's centre along its two axes
    float xx = 0, xy = 0, yy = 0;  // 1/m^2, S: inverse covariance
    float darkness = 0;            // 0..kDarkest
};

constexpr float kDarkest = 0.8f;  // some light reaches every point of the floor

// Combined shade of many shadows on a rectangle of the floor: the fraction of light missing at the centres of
// its cells, rows along x.
struct GroundShade {
    float x = 0, y = 0;              // m, lower corner, from the floor's centre along its two axes
    float cell = 0;                  // m, edge
    uint32_t columns = 0, rows = 0;  // 0: no shadow
    std::vector<float> darkness;     // columns * rows, 0..kDarkest
};

// Combines shadows: transmitted light is the product over all shadows, plus the ambient part, so that a
// single shadow is as dark as specified. Cells are a sixth of the narrowest shadow's shorter half axis, but
// the rectangle has at most 384 of them along a side. Empty or non-finite shadows are ignored, as are points
// beyond `radius` (m, from the centre along either axis). The time is proportional to the cells that shadows
// cover, whatever the picture's size.
void make_ground_shade(std::span<const GroundShadow> shadows, float radius, GroundShade& out);

}  // namespace trocar
