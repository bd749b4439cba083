#include "systems/advance/tissue/energy.hpp"

#include <cmath>

#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
#include "systems/advance/tissue/thread_forces.hpp"
namespace trocar {

double implicit_energy(const AdvanceCall& call, const AdvanceBody& b, const Float4* offset, TissueScratch& scratch,
                       const AdvanceState& state) {
    const AdvanceInputs& in = call.inputs;
    const uint32_t prototype = in.bodies.mesh[b.body];
    SpringStep step = b.step;
    step.offset = &offset->x;
    step.velocity_x = step.new_velocity_x, step.velocity_y = step.new_velocity_y, step.velocity_z = step.new_velocity_z;
    step.back = static_cast<float>(0.5 * b.last_dt);
    if (b.shape) {
        Quat orientation = state.poses.orientation[b.body];
        fit_goals(sum_shape(step, b.slices, scratch.shape_sums), orientation, step);
    }
    const std::array<double, kEnergySums> t = sum_energy(step, b.slices, scratch.shape_sums);
    double others = 0;
    if (has_bending(in.bodies, b.body))
        others += find_bending_energy(in.springs, prototype, bending_rigidity(in.bodies.tissue[b.body]), offset, scratch.force_sums);
    if (has_pressure(in.bodies, b.body)) {
        const size_t count = b.particles.count;
        float* g = scratch.implicit.rate.data();
        others +=
            find_pressure_energy(in.springs, in.bodies, b.body,
                                 find_volume_gradient(in.springs, prototype, offset, scratch.force_sums, g, g + count, g + 2 * count));
    }
    return others + 0.5 * t[kSumMvv] + 0.25 * step.stiffness * t[kSumStretch] + 0.5 * t[kSumAnchor] -
           call.params.gravity.dot(Vec3d(t[kSumMPosition], t[kSumMPosition + 1], t[kSumMPosition + 2]));
}

double work_of_links(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceBody& b) {
    double work = 0;
    for (uint32_t e = b.link_ends.first; e < b.link_ends.end(); ++e) {
        const AdvanceLink& link = island.links.link[island.links.link_end[e] / 2];
        const bool far = island.links.link_end[e] % 2 != 0;
        const uint32_t node = far ? link.far_node : link.node;
        const Vec4d moved = float_vec4(_mm_load_ps(&b.next[node].x)) - float_vec4(_mm_load_ps(&b.now[node].x));
        work += dot(far ? -link.force : link.force, moved);
    }
    return b.threaded ? work + work_of_threads(call.inputs.other, island, b) : work;
}

}  // namespace trocar
