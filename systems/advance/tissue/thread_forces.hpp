#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Threads move within the substeps of the bodies that hold them. In each, the thread is stepped first, implicitly, with the
// bodies where they are; then its springs act on the bodies with its points where they are. What the thread's step leaves of the energy
// is booked as work_numeric, the springs' energies are measured at the time of the bodies' velocities.

// Fills island.threads with the threads of the island's bodies, which must have been gathered.
void gather_threads(const AdvanceCall& call, AdvanceIsland& island, const AdvanceState& state);
// Steps the island's threads and sets their forces at the start of a substep.
void step_threads(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result);
// Adds the forces (N) of threads on the nodes of a body. axis: x, y and z, one float per node.
void add_thread_forces(const OtherForces& other, const AdvanceIsland& island, uint32_t body, float* const axis[3]);
// Work of these forces over a body's displacement in the substep, J.
double work_of_threads(const OtherForces& other, const AdvanceIsland& island, const AdvanceBody& b);
// Applies the impulses of threads and of tissue that holds a needle to hands and free bodies, after their own kick.
void pull_threaded_rigids(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools, AdvanceResult& result);
// Records energies and impulses of the springs at the end of a substep, and the work of hands and scripts on them.
void finish_threads(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
