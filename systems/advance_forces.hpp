#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Whether a body has forces besides springs and anchors that a step takes as they are at its start: pressure, bending, and of
// bodies stepped by leapfrog tetrahedra.
bool has_forces(const AdvanceInputs& inputs, uint32_t body);
// Gives bodies that has_forces their rows of scratch.force. count: particles of the whole island.
void give_forces(const AdvanceCall& call, const Particles& particles, uint32_t count, TissueScratch& scratch, AdvanceIsland& island);
// Sets the forces (N) of a body that has_forces to those at the start of a substep, where body.step.offset is. Does nothing to
// others.
void find_forces(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, TissueScratch& scratch,
                 AdvanceBody& body, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
