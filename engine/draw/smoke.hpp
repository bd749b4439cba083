#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "components/picture.hpp"
#include "engine/draw/gl_renderer.hpp"
namespace trocar {

// A corner of the grid through which smoke is drawn.
struct SmokeVertex {
    float x = 0, y = 0, z = 0;  // m, world axes, relative to the eye: where most of the smoke on its ray is
    float depth = 0;            // optical
};

// Optical depth of a puff along a ray from the eye: extinction / (2 pi spread^2) exp(-b^2 / 2 spread^2), b the distance at which the
// ray passes its centre, times the part of it that is before the eye. `centre`: relative to the eye, m; `along`: its coordinate on the
// ray, m.
double optical_depth(const PicturePuff& puff, double squared_distance, double along);

// Optical depths of all smoke over a picture, on a grid whose rays are evenly spaced: kSmokeColumns x kSmokeRows, from the lower left.
// `index`: triangles of the cells in which there is any. Light through several puffs is dimmed by each (Beer-Lambert), so depths add up.
inline constexpr uint32_t kSmokeColumns = 129, kSmokeRows = 97;
void find_smoke(const View& view, std::span<const PicturePuff> puffs, std::vector<SmokeVertex>& vertex, std::vector<uint32_t>& index);

}  // namespace trocar
