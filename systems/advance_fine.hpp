#pragma once
#include <cstdint>
#include <span>

#include "systems/advance.hpp"
namespace trocar {

// How many times as many substeps as their limit asks for the leapfrogs of an island need in the pass to come, whose substeps
// would be dt (s): 2 if in some shell held by the world the ends of a spring move by more than a twentieth of its rest
// against each other in one of them, else 1. Next to the limit leapfrog keeps the energy of what swings a little; where
// springs turn and fold in a few steps it gains some with every fold: the step resonates with the highest modes, in the third
// and fourth order at sqrt(3)/2 and sqrt(1/2) of the limit (Skeel, Srinivas, "Nonlinear stability analysis of area-preserving
// integrators", SIAM J. Numer. Anal. 38(1), 2000). Free bodies are left out: their springs would have to be looked at
// whenever they fall.
uint32_t finer_steps(const AdvanceInputs& inputs, const Particles& particles, std::span<const uint32_t> island_bodies, double dt);

}  // namespace trocar
