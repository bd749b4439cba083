#pragma once
#include "bench/table.hpp"

// The parts of the contact suite, one per file.
namespace trocar::bench {

// Every stage of the contact pass on one core: [passes] [first word of one scene] [cell edges].
void measure_stages(int argc, char** argv);
// Closest points, signs and refits against rtcPointQuery and CGAL; a deforming pair.
void compare_queries(Report& report);
// Methods of finding meeting triangles, on the same scenes; body boxes against Bullet.
void compare_broad_phases(Report& report);
// Random posed pairs against exact triangle tests.
void count_missed_pairs(Report& report);
// Closed-form pairs and organs: time of the methods against their error.
void plot_speed_and_error(Report& report);
// The thesis' algorithm of 2008 against ours.
void compare_with_thesis(Report& report);

}  // namespace trocar::bench
