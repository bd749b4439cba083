#include "systems/advance/tissue/energy.hpp"

#include <algorithm>
#include <cmath>

#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/tissue/link_forces.hpp"
namespace trocar {
namespace {

// For a measured body: its velocities belong to the time of its positions.
double energy_of(const AdvanceCall& call, const AdvanceBody& b, const float* offset, TissueScratch& scratch, const AdvanceState& state) {
    std::vector<double>& sums = scratch.shape_sums;
    SpringStep step = b.step;
    step.offset = offset;
    step.velocity_x = step.new_velocity_x, step.velocity_y = step.new_velocity_y, step.velocity_z = step.new_velocity_z;
    step.back = 0;
    if (b.shape) {
        Quat orientation = state.poses.orientation[b.body];
        fit_goals(sum_shape(step, b.slices, sums), orientation, step);
    }
    const std::array<double, kEnergySums> t = sum_energy(step, b.slices, sums);
    const AdvanceInputs& in = call.inputs;
    double volumes = 0;
    if (has_tets(in.other.solids, in.bodies, b.body)) {
        TetStep tets = bind_tets(*in.other.solids, in.bodies, state.particles, b.body, in.other.torn_springs);
        tets.offset = offset;
        volumes = tet_energy(tets, b.particles.count, solid_moduli(in.bodies.tissue[b.body]),
                             {step.velocity_x, step.velocity_y, step.velocity_z}, 0, scratch.implicit.tet_energy);
    }
    return volumes + 0.5 * t[kSumMvv] + 0.25 * step.stiffness * t[kSumStretch] + 0.5 * t[kSumAnchor] -
           call.params.gravity.dot(Vec3d(t[kSumMPosition], t[kSumMPosition + 1], t[kSumMPosition + 2]));
}

double energy_after(const AdvanceCall& call, const AdvanceBody& b, TissueScratch& scratch, const AdvanceState& state) {
    return energy_of(call, b, b.step.new_offset, scratch, state);
}

}  // namespace

double energy_before(const AdvanceCall& call, const AdvanceBody& b, TissueScratch& scratch, const AdvanceState& state) {
    return std::isfinite(b.energy) ? b.energy : energy_of(call, b, b.step.offset, scratch, state);
}

void account_measured(const AdvanceCall& call, bool corrected, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                      double& work) {
    bool any = false;
    for (AdvanceBody& b : island.body) {
        if (!b.works_by_energy() || !b.touched) continue;
        const double now = energy_after(call, b, scratch, state);
        if (std::isfinite(now - b.energy)) work += now - b.energy;  // otherwise a body about to be restored
        b.energy = now;
        any = any || b.step.force_x;
    }
    const double others = any ? energy_of_others(call, island, state.particles, corrected) : 0;
    if (std::isfinite(others)) work += others;
}

double work_of_others(const SpringStep& step, uint32_t particles) {
    if (!step.force_x) return 0;
    double work = 0;
    for (uint32_t i = 0; i < particles; ++i) {
        const float *from = step.offset + 4ul * i, *to = step.new_offset + 4ul * i;
        work += double(step.force_x[i]) * (double(to[0]) - from[0]) + double(step.force_y[i]) * (double(to[1]) - from[1]) +
                double(step.force_z[i]) * (double(to[2]) - from[2]);
    }
    return work;
}

double own_work(const AdvanceCall& call, double before, double known, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b) {
    b.energy = energy_after(call, b, scratch, state);
    const double own = b.energy - before - known;
    return std::isfinite(own) ? own : 0;  // otherwise a body about to be restored
}

}  // namespace trocar
