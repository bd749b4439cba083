#pragma once
#include <cstdint>
#include <span>

#include "systems/advance.hpp"
namespace trocar {

// How many times as many substeps as their limit asks for the leapfrogs of an island need in the pass to come, whose substeps
// would be dt (s), else 1:
//   shells held by the world: 2 if the ends of some spring move by more than a twentieth of its rest against each other in one.
//       Next to the limit leapfrog keeps the energy of what swings a little; where springs turn and fold in a few steps it gains
//       some with every fold: the step resonates with the highest modes, in the third and fourth order at sqrt(3)/2 and sqrt(1/2)
//       of the limit (Skeel, Srinivas, "Nonlinear stability analysis of area-preserving integrators", SIAM J. Numer. Anal. 38(1),
//       2000). Free shells are left out: their springs would have to be looked at whenever they fall
//   solids that have rows: 2 if some tetrahedron keeps less than 0.7 of its volume, 4 below a half. Springs pressed short and
//       tetrahedra pressed flat are stiffer than at rest (solid_limit.hpp): a box of 10 kg on a soft pad of 0.9 kg gains energy
//       without end at the limit, and at a quarter of it keeps its books to 0.2 % of the largest elastic energy
uint32_t finer_steps(const AdvanceInputs& inputs, const Particles& particles, std::span<const uint32_t> island_bodies,
                     const ContactRows& rows, std::span<const uint32_t> island_rows, double dt);

}  // namespace trocar
