#pragma once
#include <array>

#include "components/math.hpp"
namespace trocar {

// How two closed sets meet. Exact: no tolerance, no rounding.
enum class Meeting : uint8_t {
    kDisjoint,  // no common point
    kTouching,  // common points, but none that is inside both (a corner on a face, two edges, a shared corner)
    kCrossing,  // a point inside both: a proper cut, or overlap in a common plane
};

using Corners = std::array<Vec3d, 3>;

// How two triangles meet. The answer does not depend on the order of corners or of triangles. Triangles without area
// are the segment or point that they are; "inside" is then the segment without its ends, or the point.
// Devillers, Guigue, "Faster triangle-triangle intersection tests", INRIA RR-4488 (2002), for the proper case.
Meeting meet_triangles(const Corners& a, const Corners& b);

// How the segment p-q and a triangle meet, as above.
Meeting meet_segment_triangle(const Vec3d& p, const Vec3d& q, const Corners& triangle);

}  // namespace trocar
