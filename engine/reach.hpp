#pragma once
#include <algorithm>

#include "engine/surfaces.hpp"
namespace trocar {

// How far bodies get in a contact period. Boxes, pairs, triangles and rows must agree on it: what one of them leaves out for being
// farther away is found by no later one.

// How far vertices may stray in a period from what velocities say, m: forces of the period.
inline double least_stray(double mean_edge) { return 0.05 * mean_edge; }

// How far a body reaches in a period, m: the way of its fastest vertex, but no more than the root mean square way and half
// an edge, nor than three edges. Without these bounds one vertex that trembles, or a fine body that falls fast, makes
// everything near (190 ms and 5 s a pass); what comes faster is found inside and pushed out.
inline double reach_in_period(double fastest_way, double mean_way, double mean_edge) {
    return std::min({fastest_way, mean_way + 0.5 * mean_edge, 3 * mean_edge}) + least_stray(mean_edge);
}

// How far gravity (m/s^2) takes a body in a period (s) beyond its velocity, m.
inline double fall_in_period(const Vec3d& gravity, double period) { return 0.5 * gravity.norm() * period * period; }

// How near a body may come to what it does not move towards, m: what vertices of one that deforms stray, and half the thickness
// of a sheet.
inline double reach_at_rest(const Surfaces& s, uint32_t body) {
    const double stray = is_deformable(s.bodies, body) ? least_stray(s.meshes.info[s.bodies.mesh[body]].mean_edge) : 0.0;
    return stray + 0.5 * s.bodies.thickness[body];
}

}  // namespace trocar
