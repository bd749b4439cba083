#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Energy of the velocities of a body as the particles have them now, J.
double kinetic_energy(const Particles& particles, const AdvanceBody& b);
// Whether a body's energy has grown over the call by far more than a stable step can show, with nothing to give it any:
// an explicit step above its limit doubles its energy in a few steps. Bodies with rows or with forces of others are left
// out: those may give energy. After the last substep, before the state is written.
bool has_run_away(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, TissueScratch& scratch);

}  // namespace trocar
#pragma GCC diagnostic pop
