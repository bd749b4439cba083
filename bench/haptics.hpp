#pragma once
#include "bench/rows.hpp"
namespace trocar::bench {

// A tick of lockstep runs that are the same to the bit: what one costs is the least that it took in any of them, the rest
// is what other programs on the machine took.
struct TickCost {
    double seconds = 1e9;  // of the thread
    bool touches = false;  // all tools are in contact
};
int tick_runs(const Report& report);
void note_tick(uint64_t tick, double seconds, bool touches, std::vector<TickCost>& cost);
// Costs (us) of the ticks in contact.
std::vector<double> touching_us(const std::vector<TickCost>& cost);

// Compute time of the tick on a deforming liver.
void tick_rows(Report& report);
// The same of two instruments that feel with their whole bodies, and the error of their forces and torques.
void shell_rows(Report& report);
// Energy that the device takes from an arm poking tissue for ten simulated minutes; minutes of one core, so not when quick.
void poke_rows(Report& report);
// Period of a live tick beside an idle thread of the same run, age of the surface under the force.
void live_rows(Report& report);

}  // namespace trocar::bench
