#pragma once
#include <array>

#include "systems/haptics/contact/near_surface.hpp"
namespace trocar {

// Corners of a triangle relative to a point (m), and their displacement (m) relative to that of the point, both linear in time.
struct PassingTriangle {
    std::array<Vec3d, 3> corner, displacement;
};
// When a triangle passes over the point.
struct PassingTime {
    double time = 1;               // fraction of the motion
    Vec3d weight = Vec3d::Zero();  // barycentric
    double side = 0;               // on which the point was: 1 = that of the triangle's normal, or -1; 0: it does not pass
};
// The first passage before the fraction `before`, from the front of the triangle or, if `from_behind`, from either side: roots
// of the volume between them, which is cubic in time.
PassingTime first_passing(const PassingTriangle& triangle, bool from_behind, double before);

// Passage of a moving surface over a moving point.
struct SurfaceCrossing {
    uint32_t index = kNone;        // of NearSurface::triangle; kNone: the point stayed on its side of every surface
    double time = 1;               // fraction of the motion
    Vec3d weight = Vec3d::Zero();  // barycentric
    double side = 1;               // on which the point was: 1 = that of the triangle's normal, or -1
};

// The first triangle that passes over a point, which moves along a straight line to `to` while the surface moves from
// `before` to the time of `near`: continuous collision detection of a point and linearly moving triangles (Provot,
// "Collision and self-collision handling in cloth model dedicated to design garments", 1997). `travel`: m, bound on
// the displacement of the surface. A closed body is entered through the front of its triangles, a sheet from both sides.
SurfaceCrossing first_crossing(const SurfaceTime& before, const Vec3d& from, const Vec3d& to, double travel, NearSurface& near);

// A point just above the surface at a crossing, at the time of `near`, on the side on which the point was.
Vec3d above_crossing(const SurfaceCrossing& crossing, NearSurface& near);

}  // namespace trocar
