#pragma once
#include "bench/table.hpp"
namespace trocar::bench {

// Cost of a tick over bit-identical lockstep runs: the least of any run; the excess is due to other programs.
struct TickCost {
    double seconds = 1e9;  // s of the thread
    bool touches = false;  // all tools are in contact
};
int tick_runs(const Report& report);
void note_tick(uint64_t tick, double seconds, bool touches, std::vector<TickCost>& cost);
// Costs (us) of the ticks in contact.
std::vector<double> touching_us(const std::vector<TickCost>& cost);

// Compute time of the tick on a deforming liver.
void tick_rows(Report& report);
// The same for two instruments with whole-body contact, and the error of their forces and torques.
void shell_rows(Report& report);
// Energy that the device gains from ten simulated minutes of poking; takes minutes, so not with --quick.
void poke_rows(Report& report);
// Period of a live tick and of an idle thread of the same run, age of the surface under the force.
void live_rows(Report& report);

}  // namespace trocar::bench
