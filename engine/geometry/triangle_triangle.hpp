#pragma once
#include <array>

#include "components/math.hpp"
namespace trocar {

// Intersection of two closed sets. Exact: no tolerance, no rounding.
enum class Meeting : uint8_t {
    kDisjoint,  // no common point
    kTouching,  // common points, but none interior to both (a corner on a face, two edges, a shared corner)
    kCrossing,  // a point interior to both: a proper crossing, or overlap in a common plane
};

using Corners = std::array<Vec3d, 3>;

// Intersection of two triangles. The result does not depend on the order of corners or of triangles.
// Triangles of zero area count as the segment or point that they are; "interior" is then the open segment, or
// the point. Devillers, Guigue, "Faster triangle-triangle intersection tests", INRIA RR-4488 (2002).
Meeting meet_triangles(const Corners& a, const Corners& b);

// Intersection of the segment p-q and a triangle, as above.
Meeting meet_segment_triangle(const Vec3d& p, const Vec3d& q, const Corners& triangle);

}  // namespace trocar
