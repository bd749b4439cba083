#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
namespace trocar {

// Adds a call's works and counters to the energy accounting and the report. Islands are added in their order.
void add_advance_result(const AdvanceResult& result, Energy& energy, Report& report);

// Number of substeps in `seconds` that the bodies of an island need: none longer than the stable step of a
// leapfrog body or `largest`, the step of another body, or Links::stable_dt. leapfrog: as AdvanceInputs.
uint32_t count_substeps(const Bodies& bodies, std::span<const uint32_t> island_bodies, double seconds, double largest,
                        std::span<const double> linked = {}, bool leapfrog = false);

// Moves the bodies of one island through params.ticks ms under springs, tetrahedra, anchors, links, damping,
// gravity and contact constraints: deformable ones by the integrator of each (leapfrog or backward Euler), free
// ones, driven ones, and tools in the hand. Static and scripted bodies are only read, through poses and
// paths. Constraints warm start from constraints.warm_start (if iterations > 1) and store their last impulses
// there. Adds to constraints.impulse and to ToolState.contact_impulse; an expired constraint gets an infinite
// constraints.distance and stays inactive. A body that became non-finite, or whose energy grew without input,
// returns to its state at the start of the call, at rest. State is complete between calls. Same bits for any
// number of threads. Distinct islands may run concurrently, each with its own scratch.
void advance_island(const AdvanceParams& params, const AdvanceInputs& inputs, std::span<const uint32_t> island_bodies,
                    std::span<const uint32_t> island_constraints, AdvanceScratch& scratch, AdvanceState state, AdvanceResult& result);

// Gives every scratch the largest capacities of all, so that any thread can run any island without
// allocating.
void share_room(std::span<AdvanceScratch> scratches);

}  // namespace trocar
