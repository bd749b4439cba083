#include <algorithm>
#include <cmath>

#include "engine/shape_fit.hpp"
#include "engine/tet_forces.hpp"
#include "systems/advance_implicit.hpp"
namespace trocar {
namespace {

// Of a measured body: its velocities belong to the time of its positions.
double energy_of(const AdvanceIsland& island, const AdvanceBody& b, const float* offset) {
    std::vector<double>& sums = island.scratch.shape_sums;
    SpringStep step = b.step;
    step.offset = offset;
    step.velocity_x = step.new_velocity_x, step.velocity_y = step.new_velocity_y, step.velocity_z = step.new_velocity_z;
    step.back = 0;
    if (b.shape) {
        Quat orientation = island.poses.orientation[b.body];
        fit_goals(sum_shape(step, b.slices, sums), orientation, step);
    }
    const std::array<double, kEnergySums> t = sum_energy(step, b.slices, sums);
    const AdvanceInputs& in = island.inputs;
    double volumes = 0;
    if (has_tets(in.other.solids, in.bodies, b.body)) {
        TetStep tets = bind_tets(*in.other.solids, in.bodies, island.particles, b.body, in.other.torn_springs);
        tets.offset = offset;
        volumes = tet_energy(tets, b.particles.count, solid_moduli(in.bodies.tissue[b.body]),
                             {step.velocity_x, step.velocity_y, step.velocity_z}, 0, island.scratch.implicit.tet_energy);
    }
    return volumes + 0.5 * t[kSumMvv] + 0.25 * step.stiffness * t[kSumStretch] + 0.5 * t[kSumAnchor] -
           island.params.gravity.dot(Vec3d(t[kSumMPlace], t[kSumMPlace + 1], t[kSumMPlace + 2]));
}

double energy_after(const AdvanceIsland& island, const AdvanceBody& b) { return energy_of(island, b, b.step.new_offset); }

}  // namespace

double energy_before(const AdvanceIsland& island, const AdvanceBody& b) {
    return std::isfinite(b.energy) ? b.energy : energy_of(island, b, b.step.offset);
}

void book_measured(AdvanceIsland& island, bool pushed, double& work) {
    bool any = false;
    for (AdvanceBody& b : island.scratch.body) {
        if (!b.measured() || !b.touched) continue;
        const double now = energy_after(island, b);
        if (std::isfinite(now - b.energy)) work += now - b.energy;  // else a body about to be restored
        b.energy = now;
        any = any || b.step.force_x;
    }
    const double others = any ? energy_of_others(island, pushed) : 0;
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

void book_own_work(AdvanceIsland& island, AdvanceBody& b, double before, double known) {
    b.energy = energy_after(island, b);
    const double own = b.energy - before - known;
    if (std::isfinite(own)) island.result.work_numeric += own;  // else a body about to be restored
}

}  // namespace trocar
