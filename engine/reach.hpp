#pragma once
#include <algorithm>
namespace trocar {

// How far vertices may stray in a period from what velocities say, m: forces of the period. Boxes, pairs and rows must agree on it:
// what one of them leaves out for being farther away nobody else finds.
inline double least_stray(double mean_edge) { return 0.05 * mean_edge; }

// How far a body reaches in a period, m: the way of its fastest vertex, but no more than the root mean square way and half
// an edge, nor than three edges. Without these bounds one vertex that trembles, or a fine body that falls fast, makes
// everything near (190 ms and 5 s a pass); what comes faster is found inside and pushed out.
inline double reach_in_period(double fastest_way, double mean_way, double mean_edge) {
    return std::min({fastest_way, mean_way + 0.5 * mean_edge, 3 * mean_edge}) + least_stray(mean_edge);
}

}  // namespace trocar
