#include "systems/advance/tissue/forces.hpp"

#include <algorithm>

#include "engine/jobs/parallel.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/spring_step.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/tissue/link_forces.hpp"
#include "systems/advance/tissue/thread_forces.hpp"
namespace trocar {
namespace {

// The three force components of a body.
struct Forces {
    float* axis[3];
    uint32_t count;
};
Forces forces_of(const AdvanceBody& b, TissueScratch& scratch) {
    const size_t stride = scratch.force.size() / 3;
    float* first = scratch.force.data() + b.buffer;
    return {{first, first + stride, first + 2 * stride}, b.particles.count};
}

void set_pressure(const AdvanceCall& call, const AdvanceBody& b, const Forces& f, TissueScratch& scratch) {
    const AdvanceInputs& in = call.inputs;
    const double volume =
        find_volume_gradient(in.springs, in.bodies.mesh[b.body], b.now, scratch.force_sums, f.axis[0], f.axis[1], f.axis[2]);
    const float p = static_cast<float>(find_pressure(in.springs, in.bodies, b.body, volume));
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
        for (float* axis : f.axis) {
            for (uint32_t i = begin * kSliceWidth; i < end * kSliceWidth; ++i) axis[i] *= p;
        }
    });
}

void add_tets(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, const Forces& f, TissueScratch& scratch,
              AdvanceResult& result) {
    TetStep step = bind_tets(*call.inputs.other.solids, call.inputs.bodies, particles, b.body, call.inputs.other.torn_springs);
    step.offset = b.step.offset;
    step.corner_force = &scratch.corner_force[0].x;
    step.force_x = f.axis[0], step.force_y = f.axis[1], step.force_z = f.axis[2];
    result.min_volume_ratio = std::min<double>(result.min_volume_ratio, add_tet_forces(step, b.slices));
}

}  // namespace

bool has_forces(const AdvanceInputs& inputs, uint32_t body) {
    return has_pressure(inputs.bodies, body) || has_bending(inputs.bodies, body) || has_tets(inputs.other.solids, inputs.bodies, body);
}

void give_forces(const AdvanceCall& call, const Particles& particles, uint32_t count, TissueScratch& scratch, AdvanceIsland& island) {
    const AdvanceInputs& in = call.inputs;
    uint32_t corners = 0;
    for (const AdvanceBody& b : island.body) {
        if (has_tets(in.other.solids, in.bodies, b.body))
            corners = std::max(corners, corner_rows(bind_tets(*in.other.solids, in.bodies, particles, b.body)));
    }
    if (scratch.corner_force.size() < corners) scratch.corner_force.resize(corners);
    const auto forced = [&](const AdvanceBody& b) { return b.linked || b.threaded || has_forces(in, b.body); };
    if (std::none_of(island.body.begin(), island.body.end(), forced)) return;
    scratch.force.assign(size_t{3} * count, 0.0f);
    for (AdvanceBody& b : island.body) {
        if (!forced(b)) continue;
        const Forces f = forces_of(b, scratch);
        b.step.force_x = f.axis[0], b.step.force_y = f.axis[1], b.step.force_z = f.axis[2];
    }
}

void find_forces(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, TissueScratch& scratch, AdvanceBody& b,
                 AdvanceResult& result) {
    if (!b.step.force_x) return;
    const AdvanceInputs& in = call.inputs;
    const Forces f = forces_of(b, scratch);
    // the first force family writes, later ones add
    if (has_pressure(in.bodies, b.body)) {
        set_pressure(call, b, f, scratch);
    } else {
        for (float* axis : f.axis) std::fill_n(axis, f.count, 0.0f);
    }
    if (has_bending(in.bodies, b.body)) {
        add_bending_forces(in.springs, in.bodies.mesh[b.body], bending_rigidity(in.bodies.tissue[b.body]), b.now, scratch.hinge_force,
                           f.axis[0], f.axis[1], f.axis[2]);
    }
    if (has_tets(in.other.solids, in.bodies, b.body)) add_tets(call, particles, b, f, scratch, result);
    if (b.linked) add_link_forces(island, static_cast<uint32_t>(&b - island.body.data()), f.axis);
    if (b.threaded) add_thread_forces(in.other, island, b.body, f.axis);
}

}  // namespace trocar
