#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// How many times as many substeps as their limit asks for the leapfrogs of an island need in the pass to come of `seconds`, whose
// substeps would be dt (s), else 1:
//   shells held by the world: 2 if the ends of some spring move by more than a twentieth of its rest against each other in one.
//       Next to the limit leapfrog keeps the energy of what swings a little; where springs turn and fold in a few steps it gains
//       some with every fold: the step resonates with the highest modes, in the third and fourth order at sqrt(3)/2 and sqrt(1/2)
//       of the limit (Skeel, Srinivas, "Nonlinear stability analysis of area-preserving integrators", SIAM J. Numer. Anal. 38(1),
//       2000). Free shells are left out: their springs would have to be looked at whenever they fall
//   solids that have rows: 2 if some tetrahedron keeps less than 0.45 of its volume now or in the middle of the pass, 4 below 0.3.
//       Springs pressed short and tetrahedra pressed flat are stiffer than at rest (solid_limit.hpp): a box of 10 kg that falls on a
//       soft pad of 0.9 kg gains energy without end at the limit; so its books close to 0.05 % of the largest elastic energy, and
//       what presses tissue as instruments do pays for no finer step
// `scratch` is the island's, as of advance_island: a byte a body where there are solids, and the nodes of one that is touched.
uint32_t finer_steps(const AdvanceInputs& inputs, const Particles& particles, std::span<const uint32_t> island_bodies,
                     const ContactRows& rows, std::span<const uint32_t> island_rows, double dt, double seconds, AdvanceScratch& scratch);

// Wild bodies: solids with crushed tetrahedra that no constraint touches go through a substep in finer explicit ones. Backward Euler
// would come to rest in folds that inertia opens; once let go, nodes cross a whole cell in a step, which no step limit allows for.
// Springs and volumes have more than one shape at rest: what is thrown about at random may end in another.
// The least volume ratio of a body's tetrahedra where it will be in so many seconds at the velocities it has.
double least_volume(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, double seconds, TissueScratch& scratch);
// Whether a body is wild, given the least volume ratio now: below kCrushed, or fast and below it a substep ago or a substep from now; a
// body stepped by leapfrog only if it is fast.
bool is_wild(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, double least, TissueScratch& scratch);
// The substep of a wild body, with the forces of links at its start. Returns the work of damping, J.
double step_finely(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                   AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
