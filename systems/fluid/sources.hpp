#pragma once
#include <vector>

#include "systems/fluid/fluid_pass.hpp"
namespace trocar {

// A place of a body that a staple holds.
struct StapledPlace {
    uint32_t body = kNone;
    Vec3d at = Vec3d::Zero();  // m, world
};

struct FluidSourcesScratch {
    std::vector<uint32_t> cell;  // within reach of a nozzle
    std::vector<StapledPlace> stapled;
    std::vector<double> gas;  // m^3, one per action: what suction takes besides liquid in this pass
};

// Lets wounds bleed, and instruments that are on irrigate and suck. A nozzle's jet leaves as drops; where there is no room for
// more, it does not run. Suction takes drops within its reach first, then liquid on surfaces: all alike, in proportion, and gas with
// what is left of its flow.
// A vessel is open by the part of the tissue around it that has not coagulated; a staple within reach closes it; and where a wound is
// pressed it bleeds by what the pressure of the blood is above that of the contact.
void run_sources(const FluidPass& pass, FluidSourcesScratch& scratch, FluidState& state);

}  // namespace trocar
