#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Fills island.links with the island's links. Its bodies must have been gathered.
void gather_links(const AdvanceCall& call, AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result);
// Sets the force (N) of every link to that at the start of a substep.
void find_link_forces(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island);
// Adds the link forces (N) on the nodes of an element of island.body. axis: x, y and z, one float per node.
void add_link_forces(const AdvanceIsland& island, uint32_t body, float* const axis[3]);
// Applies the impulses of links to hands and free bodies, after their own kick.
void pull_linked_rigids(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools);
// Records stretch and work of the links at the end of a substep, and breaks those that are too long.
void finish_links(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
