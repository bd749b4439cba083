#pragma once
#include <algorithm>

#include "engine/jobs/parallel.hpp"
#include "engine/tissue/spring_step.hpp"
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One step of a body, and its energy accounting. b.step is bound to this substep.
void step_midpoint(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, ContactSolver& solver,
                   const AdvanceState& state, AdvanceBody& b, AdvanceResult& result);

// Runs call(begin, end, lanes) over the chunks of a body and adds up the lanes in chunk order.
template <typename Call>
double sum_over(const AdvanceBody& b, std::vector<double>& sums, const Call& call) {
    std::fill(sums.begin(), sums.end(), 0.0);
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) { call(begin, end, sums.data() + begin / kSlicesPerChunk * kSliceWidth); });
    double sum = 0;
    for (const double s : sums) sum += s;
    return sum;
}

}  // namespace trocar
#pragma GCC diagnostic pop
