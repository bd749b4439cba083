#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Work space of triangulate_polygon, kept between calls. `tests` counts point-in-ear tests over all calls: once they
// exceed kPolygonTestLimit polygons that are not convex are fanned, so that a hostile file cannot hold the reader.
struct PolygonScratch {
    std::vector<std::array<double, 2>> point;
    std::vector<uint32_t> next, previous, reflex;
    std::vector<uint8_t> is_reflex;
    uint64_t tests = 0;
};

inline constexpr uint64_t kPolygonTestLimit = 1'000'000'000;

// Splits a polygon of n >= 3 corners into n - 2 triangles of corner numbers, appended to `triangle`, with its own sense
// of turning. Ears are clipped in the plane its normal (Newell) is most nearly square to; every corner stays used, also
// on straight edges. Returns false when that fails (crossing itself, no area) and a fan was appended instead.
bool triangulate_polygon(std::span<const Vec3d> corner, PolygonScratch& scratch, std::vector<Triangle>& triangle);

}  // namespace trocar
