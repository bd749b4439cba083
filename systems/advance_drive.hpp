#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Bodies that a node drives. In place of what is done with other free ones:

// Finds the drive of a row of scratch.free, if it has one.
void bind_drive(const AdvanceCall& call, uint32_t free_row, AdvanceIsland& island);
void kick_driven(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f);
void move_driven(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f);
// Moves it by `share` of the pushes of its free sides.
void push_driven(const AdvanceCall& call, double share, AdvanceIsland& island, AdvanceFree& f, AdvanceResult& result);
void restore_drive(const AdvanceCall& call, const AdvanceFree& f);
// Friction and limits of all drives, once: part of a sweep. Returns the largest change of a velocity, m/s.
double solve_drives(AdvanceIsland& island);
// The same once more after the rows, then state and books.
void settle_drives(const AdvanceCall& call, AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
