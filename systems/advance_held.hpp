#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Tools whose coupling to the hand gives way in turning too are free bodies without weight.

// Makes the row of scratch.free and the node of one.
void add_held_body(const AdvanceCall& call, const Poses& poses, uint32_t rigid_row, AdvanceIsland& island);
// The coupling, in place of gravity and damping. It resists the rows' impulses too.
void pull_held_body(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f);
// Notes in ToolState what the coupling does at the end of the substep.
void note_coupling(const AdvanceCall& call, const AdvanceFree& f, AdvanceIsland& island, std::span<ToolState> tools);

}  // namespace trocar
#pragma GCC diagnostic pop
