#pragma once
#include "components/mesh.hpp"
#include "engine/geometry/triangle_triangle.hpp"
namespace trocar {

// How two faces of one mesh meet away from the corners and the edge they share. Corners are shared if they are the same vertex.
// Exact: no tolerance, no rounding. a, b: positions of the corners of t and u.
Meeting meet_faces(const Triangle& t, const Corners& a, const Triangle& u, const Corners& b);

}  // namespace trocar
