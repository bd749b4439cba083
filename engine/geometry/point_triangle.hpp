#pragma once
#include "components/math.hpp"
namespace trocar {

// Part of a triangle that a closest point lies on. Edge k runs from corner k to corner k+1.
enum class Feature : uint8_t { kVertex0, kVertex1, kVertex2, kEdge0, kEdge1, kEdge2, kFace };

// Closest point of a triangle, relative to the query point.
struct TrianglePoint {
    Vec3d offset = Vec3d::Zero();                                       // closest point - query point, m
    double squared_distance = std::numeric_limits<double>::infinity();  // m^2
    double height = 0;                                                  // m, > 0 on the side of the normal; faces only
    double border = 0;                                                  // least barycentric coordinate; faces only
    Feature feature = Feature::kFace;
};

// (b - a) x (c - a) with each product difference rounded once by Kahan's method (Jeannerod, Louvet & Muller,
// Math. Comp. 82, 2013): accurate for slivers too, where the plain product is noise. Zero if the corners are
// collinear to 1e-15.
Vec3d triangle_normal(const Vec3d& a, const Vec3d& b, const Vec3d& c);

// Closest point of triangle abc to p, for any shape of triangle down to a single point. It is on the face if
// p projects strictly inside its three edge planes, else the nearest of three clamped segments; ties go to
// the lowest edge. Error of the distance: a few rounding units of (distance + longest edge).
TrianglePoint closest_point_on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c);

}  // namespace trocar
