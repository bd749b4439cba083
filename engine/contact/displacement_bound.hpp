#pragma once
#include <algorithm>

#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Bounds on the motion of bodies in a contact period. Boxes, pairs, triangles and constraints must use the
// same ones: no later stage finds what an earlier one has dropped as too far away.

// Drift bound: how far vertices may move in a period beyond their velocities by forces in the period, m.
inline double least_drift_bound(double mean_edge) { return 0.05 * mean_edge; }

// Speculative margin: bound on the displacement of a body in a period, m. The displacement of its fastest
// vertex, limited to the root mean square displacement plus half an edge, and to three edges. Without these
// limits one oscillating vertex, or a fine body that falls fast, would make everything near (190 ms and 5 s a
// pass); contacts of faster motion are found inside and removed by position correction.
inline double displacement_bound(double fastest_displacement, double mean_displacement, double mean_edge) {
    return std::min({fastest_displacement, mean_displacement + 0.5 * mean_edge, 3 * mean_edge}) + least_drift_bound(mean_edge);
}

// Displacement by gravity (m/s^2) in a period (s), beyond that by velocity, m.
inline double fall_in_period(const Vec3d& gravity, double period) { return 0.5 * gravity.norm() * period * period; }

// How near a body may come to another without moving towards it, m: the drift bound of a deformable body, and
// half the thickness of a sheet.
inline double reach_at_rest(const Surfaces& s, uint32_t body) {
    const double stray = is_deformable(s.bodies, body) ? least_drift_bound(s.meshes.info[s.bodies.mesh[body]].mean_edge) : 0.0;
    return stray + 0.5 * s.bodies.thickness[body];
}

}  // namespace trocar
