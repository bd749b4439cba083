#include "engine/tissue/spring_step.hpp"

namespace trocar {

SpringStep bind_body(const Springs& springs, const Bodies& bodies, const Anchors& anchors, const Particles& particles, uint32_t body,
                     const TornSprings* torn) {
    const uint32_t prototype = bodies.mesh[body], first = bodies.particles[body].first + springs.info[prototype].skin;
    SpringStep step = {};
    step.offset = &particles.offset[first].x;
    step.velocity_x = particles.velocity_x.data() + first;
    step.velocity_y = particles.velocity_y.data() + first;
    step.velocity_z = particles.velocity_z.data() + first;
    step.slice_column = springs.slice_column.data() + springs.info[prototype].slices.first + prototype;
    step.neighbour = springs.neighbour.data();
    step.rest_length = springs.rest_length.data();
    const SpringInfo& info = springs.info[prototype];
    step.packed = info.packed == kNone ? nullptr : springs.packed[info.packed].data();
    step.first_column = step.slice_column[0];
    step.rest_unit = info.rest_unit;
    if (torn && size_t{step.slice_column[springs.info[prototype].slices.count]} * kSliceWidth <= torn->neighbour.size()) {
        step.neighbour = torn->neighbour.data();
        step.rest_length = torn->rest_length.data();
        step.packed = nullptr;
    }
    step.spring_factor = springs.info[prototype].varied ? springs.factor.data() : nullptr;
    if (torn && step.spring_factor && size_t{step.slice_column[springs.info[prototype].slices.count]} * kSliceWidth <= torn->factor.size())
        step.spring_factor = torn->factor.data();
    step.anchor_stiffness = anchors.stiffness.data() + first;
    step.anchor_x = anchors.rest_x.data() + first;
    step.anchor_y = anchors.rest_y.data() + first;
    step.anchor_z = anchors.rest_z.data() + first;
    step.turn[0] = step.turn[4] = step.turn[8] = 1;
    step.stiffness = bodies.spring_stiffness[body];
    step.keep = 1;
    step.other_law = law_of(bodies, body) != TissueLaw::kSprings;
    return step;
}

std::array<double, kEnergySums> sum_energy(const SpringStep& body, uint32_t slices, std::vector<double>& chunk_sums) {
    const SpringKernels& kernels = spring_kernels();
    return sum_slices<kEnergySums>(slices, chunk_sums,
                                   [&](uint32_t begin, uint32_t end, double* sums) { kernels.energy_sums(&body, begin, end, sums); });
}

}  // namespace trocar
