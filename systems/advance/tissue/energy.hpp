#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Energy of a body with its particles at `offset`, at the time of its velocities: springs, anchors, pressure, bending,
// gravity and motion, J.
double implicit_energy(const AdvanceCall& call, const AdvanceBody& b, const Float4* offset, TissueScratch& scratch,
                       const AdvanceState& state);
// Work of links and threads over the step's displacement, J.
double work_of_links(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceBody& b);

}  // namespace trocar
#pragma GCC diagnostic pop
