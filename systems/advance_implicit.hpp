#pragma once
#include <algorithm>

#include "engine/implicit_kernels.hpp"
#include "engine/parallel.hpp"
#include "engine/spring_step.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {

// Runs call(begin, end, lanes) over the chunks of a body and adds the lanes up in their order.
template <typename Call>
double sum_over(const AdvanceBody& b, std::vector<double>& sums, const Call& call) {
    std::fill(sums.begin(), sums.end(), 0.0);
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) { call(begin, end, sums.data() + begin / kSlicesPerChunk * kSliceWidth); });
    double sum = 0;
    for (const double s : sums) sum += s;
    return sum;
}

// Energy of a measured body where it is now, before its step of the books: springs, anchors, gravity and motion, J.
double energy_before(const AdvanceIsland& island, const AdvanceBody& b);
// Books as the step's own work what its energy changed by from `before` (J) but for damping and the forces of others.
void book_own_work(AdvanceIsland& island, AdvanceBody& b, double before, double damped);

}  // namespace trocar
