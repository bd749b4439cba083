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

// Solids with crushed tetrahedra that no row touches go through a substep in finer explicit ones (advance_fine.cpp): backward
// Euler would stop in folds that inertia leaves, and let go, their nodes cross a cell in a step, for which no limit was made.
// Springs and volumes have rests besides the one they were made for: what is thrown about at random may end in one.
// Least volume of a tetrahedron over that at rest where its body would be in so many seconds at the velocities it has;
double least_volume(AdvanceIsland& island, const AdvanceBody& b, double seconds);
// whether that is how it must be stepped, given that least volume now: below kCrushed, or fast and below it a substep ago or
// from now; a body stepped by leapfrog only if it is fast;
bool is_wild(AdvanceIsland& island, const AdvanceBody& b, double least);
// the substep, with forces of links as they are. Returns the work of damping, J.
double step_finely(AdvanceIsland& island, AdvanceBody& b);

// Energy of a measured body where it is now, before its step of the books: springs, anchors, gravity and motion, J.
double energy_before(const AdvanceIsland& island, const AdvanceBody& b);
// Work of the forces that others put in, along the way of the step, J.
double work_of_others(const SpringStep& step, uint32_t particles);
// Books as the step's own work what its energy changed by from `before` (J) but for what is known: damping, others, rows.
void book_own_work(AdvanceIsland& island, AdvanceBody& b, double before, double known);

}  // namespace trocar
