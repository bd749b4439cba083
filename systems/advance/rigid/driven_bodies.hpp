#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Driven bodies: free bodies with one coordinate of a scene node. Their versions of the free bodies'
// functions:

// Finds the drive of an element of island.free, if it has one.
void bind_drive(const AdvanceCall& call, uint32_t free_index, AdvanceIsland& island);
void kick_driven(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f);
void move_driven(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f);
// Moves it by `share` of the corrections of its free sides.
void correct_driven(const AdvanceCall& call, double share, AdvanceIsland& island, AdvanceFree& f, AdvanceResult& result);
void restore_drive(const AdvanceCall& call, const AdvanceFree& f);
// One iteration over friction and limits of all drives, as part of a sweep. Returns the largest change of a
// velocity, m/s.
double solve_drives(AdvanceIsland& island);
// One more such iteration after the constraints, then state and energy accounting.
void finish_drives(const AdvanceCall& call, AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
