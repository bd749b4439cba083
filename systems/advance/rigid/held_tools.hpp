#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Tools whose coupling to the hand yields in rotation too are free bodies without weight.

// Adds an element of island.free and its node.
void add_held_body(const AdvanceCall& call, const Poses& poses, uint32_t rigid_index, AdvanceIsland& island);
// Applies the coupling, in place of gravity and damping. It resists the contact impulses too.
void pull_held_body(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f);
// Records in ToolState the coupling's force and torque at the end of the substep.
void note_coupling(const AdvanceCall& call, const AdvanceFree& f, AdvanceIsland& island, std::span<ToolState> tools);

}  // namespace trocar
#pragma GCC diagnostic pop
