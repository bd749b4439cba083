#pragma once
#include <vector>

#include "systems/fluid/fluid_pass.hpp"
namespace trocar {

// Lets wounds bleed, and instruments that are on irrigate and suck. A nozzle's jet leaves as drops; where there is no room for
// more, it does not run. Suction takes drops within its reach first, then liquid on surfaces: all alike, in proportion.
struct FluidSourcesScratch {
    std::vector<uint32_t> cell;  // within reach of a nozzle
};
void run_sources(const FluidPass& pass, FluidSourcesScratch& scratch, FluidState& state);

}  // namespace trocar
