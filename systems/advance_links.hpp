#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Fills scratch.link with the island's links. Its bodies must have been gathered.
void gather_links(const AdvanceCall& call, AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result);
// Sets the force (N) of every link to that at the start of a substep.
void find_link_forces(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island);
// Adds the link forces (N) on the nodes of a row of scratch.body. axis: x, y and z, one float per node.
void add_link_forces(const AdvanceIsland& island, uint32_t body, float* const axis[3]);
// Gives hands and free bodies the impulses of their ends of the links, after they were kicked themselves.
void pull_linked_rigids(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools);
// What the energy of links, pressure and bending changes by (J) when nodes of measured bodies are moved: by the impulses of
// rows, or by pushes (`pushed`). Impulses act beside the forces as the step has taken them, pushes against links as they are
// by then.
double energy_of_others(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, bool pushed);
// Notes stretch and works of the links at the end of a substep, and breaks those that are too long.
void finish_links(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
