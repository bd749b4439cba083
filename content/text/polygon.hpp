#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Working memory of triangulate_polygon, kept between calls. `tests` counts point-in-ear tests over all
// calls; beyond kPolygonTestLimit non-convex polygons become fans, so that a malicious file cannot stall the
// reader.
struct PolygonScratch {
    std::vector<std::array<double, 2>> point;
    std::vector<uint32_t> next, previous, reflex;
    std::vector<uint8_t> is_reflex;
    uint64_t tests = 0;
};

inline constexpr uint64_t kPolygonTestLimit = 1'000'000'000;

// Splits a polygon of n >= 3 corners into n - 2 triangles of corner indices with the polygon's orientation,
// appended to `triangle`. Clips ears in the coordinate plane most nearly perpendicular to its normal
// (Newell). Every corner is used, also on straight edges. Returns false if that fails (self-intersection, no
// area); a fan is appended instead.
bool triangulate_polygon(std::span<const Vec3d> corner, PolygonScratch& scratch, std::vector<Triangle>& triangle);

}  // namespace trocar
