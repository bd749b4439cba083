#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Kinetic energy of a body from its particles' present velocities, J.
double kinetic_energy(const Particles& particles, const AdvanceBody& b);
// Whether a body's energy has grown over the call by far more than a stable step can show, without any input:
// an explicit step above its limit doubles the energy in a few steps. Not for bodies with constraints or
// external forces, which may add energy. After the last substep, before the state is written.
bool has_run_away(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, TissueScratch& scratch);

}  // namespace trocar
#pragma GCC diagnostic pop
