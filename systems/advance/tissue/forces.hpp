#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Whether a body has forces besides springs and anchors that a step evaluates at its start: pressure,
// bending, and for leapfrog bodies tetrahedra.
bool has_forces(const AdvanceInputs& inputs, uint32_t body);
// Assigns ranges of scratch.force to bodies that has_forces. count: particles of the whole island.
void give_forces(const AdvanceCall& call, const Particles& particles, uint32_t count, TissueScratch& scratch, AdvanceIsland& island);
// Sets the forces (N) of a body that has_forces at the start of a substep, at body.step.offset. No effect on
// others.
void find_forces(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, TissueScratch& scratch,
                 AdvanceBody& body, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
