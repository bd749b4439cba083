#pragma once
#include "bench/rows.hpp"
namespace trocar::bench {

// Compute time of the tick on a deforming liver.
void tick_rows(Report& report);
// The same of two instruments that feel with their whole bodies, and the error of their forces and torques.
void shell_rows(Report& report);
// Period of a live tick beside an idle thread of the same run, age of the surface under the force.
void live_rows(Report& report);

}  // namespace trocar::bench
