#include <algorithm>

#include "engine/tet_forces.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {

bool has_forces(const AdvanceInputs& inputs, uint32_t body) { return has_tets(inputs.other.solids, inputs.bodies, body); }

void give_forces(AdvanceIsland& island, uint32_t particles) {
    AdvanceScratch& s = island.scratch;
    const AdvanceInputs& in = island.inputs;
    uint32_t corners = 0;
    bool any = false;
    for (const AdvanceBody& b : s.body) {
        if (!has_forces(in, b.body)) continue;
        any = true;
        if (has_tets(in.other.solids, in.bodies, b.body)) {
            const TetStep step = bind_tets(*in.other.solids, in.bodies, island.particles, b.body);
            corners = std::max(corners, corner_rows(step));
        }
    }
    if (!any) return;
    if (s.force.size() < size_t{3} * particles) s.force.resize(size_t{3} * particles);
    if (s.corner_force.size() < corners) s.corner_force.resize(corners);
    for (AdvanceBody& b : s.body) {
        if (!has_forces(in, b.body)) continue;
        float* force = s.force.data() + b.buffer;
        b.step.force_x = force;
        b.step.force_y = force + particles;
        b.step.force_z = force + 2 * particles;
    }
}

void find_forces(AdvanceIsland& island, AdvanceBody& body) {
    AdvanceScratch& s = island.scratch;
    const AdvanceInputs& in = island.inputs;
    const size_t field = static_cast<size_t>(body.step.force_y - body.step.force_x);
    float* force = s.force.data() + body.buffer;
    for (int i = 0; i < 3; ++i) std::fill_n(force + i * field, body.particles.count, 0.0f);
    if (has_tets(in.other.solids, in.bodies, body.body)) {
        TetStep step = bind_tets(*in.other.solids, in.bodies, island.particles, body.body);
        step.offset = body.step.offset;
        step.corner_force = &s.corner_force[0].x;
        step.force_x = force, step.force_y = force + field, step.force_z = force + 2 * field;
        const double least = add_tet_forces(step, body.slices);
        island.result.min_volume_ratio = std::min(island.result.min_volume_ratio, least);
    }
}

}  // namespace trocar
