#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
namespace trocar {

// Adds a call's works and counters to the books. Islands are added in their order.
void add_advance_result(const AdvanceResult& result, Energy& energy, Report& report);

// Whole number of substeps in `seconds` that the bodies of an island need: none longer than the stable step of a body
// stepped by leapfrog or `largest`, nor than the step of one that is stepped otherwise, nor than Links::stable_dt.
uint32_t count_substeps(const Bodies& bodies, std::span<const uint32_t> island_bodies, double seconds, double largest,
                        std::span<const double> linked = {});

// Moves the bodies of one island through params.ticks ms under their springs, tetrahedra, anchors, links, damping, gravity
// and contact rows: deformable ones by the integrator of each (leapfrog or midpoint), free ones, those that a node
// drives, and tools in the hand. Reads static and scripted bodies through poses and paths and writes none of them. Rows
// start from rows.carried (where iterations > 1) and leave there what they carry at the end. Adds to rows.impulse and to
// ToolState.contact_impulse of the island's rows and tools; a row that a point has left behind gets an infinite
// rows.distance and rests from then on. A body that became non-finite, or whose energy grew without input, gets its state at
// the start of the call back, at rest. State is complete between calls. Same bits for any number of threads. Distinct
// islands may run at the same time, each with its own scratch.
void advance_island(const AdvanceParams& params, const AdvanceInputs& inputs, std::span<const uint32_t> island_bodies,
                    std::span<const uint32_t> island_rows, AdvanceScratch& scratch, AdvanceState state, AdvanceResult& result);

// Gives every scratch the room of the roomiest, so that after a pass it does not matter which thread runs which island:
// none allocates for what another has done before.
void share_room(std::span<AdvanceScratch> scratches);

}  // namespace trocar
