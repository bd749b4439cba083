#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar {

// Half the signed solid angle of triangle abc seen from p (van Oosterom & Strackee, IEEE TBME 30(2), 1983), in (-pi, pi];
// accurate for needles, too.
double half_solid_angle(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& p);

// Generalised winding number of a triangle mesh about p (Jacobson, Kavan & Sorkine-Hornung, SIGGRAPH 2013):
// the sum of the triangles' signed solid angles over 4 pi. 1 inside a closed surface whose corners run
// counter-clockwise seen from outside, 0 outside, in between if it has holes. Summed in index order.
double winding_number(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p);
double winding_number(std::span<const Float4> position, std::span<const Triangle> triangle, const Vec3d& p);

// The same number for closed faces (indices into `triangle`), exact and without a sum: signed crossings of
// the ray towards +x, a ray through an edge or corner counted once. False if the point is on a face.
bool count_windings(std::span<const Vec3d> position, std::span<const Triangle> triangle, std::span<const uint32_t> faces,
                    const Vec3d& point, int& windings);

// Adds one face's share of that number to `windings`. False if the point is on the face.
bool count_winding(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& point, int& windings);

}  // namespace trocar
