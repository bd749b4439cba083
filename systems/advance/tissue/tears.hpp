#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Index in Tears::body of a body whose springs may break, or kNone.
uint32_t tear_of(const Tears* tears, uint32_t body);
// Breaks the springs that are too long at the end of a substep: from the next one on they have no force.
void break_springs(const AdvanceCall& call, const Particles& particles, TissueScratch& scratch, AdvanceIsland& island,
                   AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
