#include <algorithm>
#include <cmath>

#include "engine/deformable_setup.hpp"
#include "engine/shape_fit.hpp"
#include "engine/spring_step.hpp"
#include "engine/tet_forces.hpp"
#include "systems/advance_implicit.hpp"
namespace trocar {
namespace {

// How many explicit steps go for one, and how much of an edge nodes may move in a step before anybody looks closer.
constexpr uint32_t kFiner = 4;
constexpr double kFarWay = 0.25;

// Tetrahedra of a body whose forces go to s.volume_force.
TetStep bind_loose_tets(AdvanceIsland& island, const AdvanceBody& b) {
    const AdvanceInputs& in = island.inputs;
    ImplicitScratch& s = island.scratch.implicit;
    const size_t rows = b.particles.count;
    s.volume_force.assign(3 * rows, 0.0f);
    s.place.resize(std::max(s.place.size(), rows));
    TetStep tets = bind_tets(*in.other.solids, in.bodies, island.particles, b.body, in.other.torn_springs);
    tets.corner_force = &island.scratch.corner_force[0].x;
    tets.force_x = s.volume_force.data(), tets.force_y = tets.force_x + rows, tets.force_z = tets.force_y + rows;
    return tets;
}

}  // namespace

double least_volume(AdvanceIsland& island, const AdvanceBody& b, double seconds) {
    const AdvanceInputs& in = island.inputs;
    if (!has_tets(in.other.solids, in.bodies, b.body)) return 1;
    TetStep tets = bind_loose_tets(island, b);
    std::vector<Float4>& place = island.scratch.implicit.place;
    const float h = static_cast<float>(seconds);
    const Particles& p = island.particles;
    for (uint32_t v = 0; v < b.particles.count; ++v) {
        const Float4& o = b.now[v];
        const uint32_t i = b.particles.first + v;
        place[v] = {o.x + h * p.velocity_x[i], o.y + h * p.velocity_y[i], o.z + h * p.velocity_z[i], o.w};
    }
    tets.offset = &place[0].x;
    return add_tet_forces(tets, b.slices);
}

bool is_wild(AdvanceIsland& island, const AdvanceBody& b, double least) {
    if (least < kCrushed && b.synchronous()) return true;
    const AdvanceInputs& in = island.inputs;
    if (!has_tets(in.other.solids, in.bodies, b.body)) return false;
    const Particles& p = island.particles;
    float fastest = 0;
    for (uint32_t i = b.particles.first; i < b.particles.end(); ++i) {
        fastest = std::max(fastest, p.velocity_x[i] * p.velocity_x[i] + p.velocity_y[i] * p.velocity_y[i] + p.velocity_z[i] * p.velocity_z[i]);
    }
    const double far = kFarWay * in.springs.info[in.bodies.mesh[b.body]].mean_rest / island.dt;
    if (!(fastest > far * far)) return false;
    // what swells fast was crushed a step ago
    return least < kCrushed || least_volume(island, b, island.dt) < kCrushed || least_volume(island, b, -island.dt) < kCrushed;
}

double step_finely(AdvanceIsland& island, AdvanceBody& b) {
    AdvanceScratch& scratch = island.scratch;
    ImplicitScratch& s = scratch.implicit;
    const size_t rows = b.particles.count;
    const uint32_t count = kFiner * substeps_for(island.dt, island.inputs.bodies.stable_dt[b.body], island.dt);
    // velocities of the same time: half a kick at both ends; half a step behind: as many kicks as ways
    const uint32_t last = b.synchronous() ? count : count - 1;
    const double dt = island.dt / count;
    TetStep tets = bind_loose_tets(island, b);
    SpringStep step = b.step;
    step.remainder_x = step.remainder_y = step.remainder_z = nullptr;
    float* const force[3] = {tets.force_x, tets.force_y, tets.force_z};
    step.force_x = force[0], step.force_y = force[1], step.force_z = force[2];
    s.sums.assign(size_t{chunk_count(b.slices, kSlicesPerChunk)} * kSliceWidth, 0.0);
    for (uint32_t i = 0; i <= last; ++i) {
        for (float* axis : force) std::fill_n(axis, rows, 0.0f);
        if (b.linked) add_link_forces(scratch, static_cast<uint32_t>(&b - scratch.body.data()), force);
        tets.offset = step.offset;
        island.result.min_volume_ratio = std::min<double>(island.result.min_volume_ratio, add_tet_forces(tets, b.slices));
        const double kick = b.synchronous() ? (i == 0 || i == count ? 0.5 * dt : dt) : i == 0 ? 0.5 * (b.last_dt + dt) : dt;
        const double left = b.shape ? 1.0 : std::exp(-0.5 * b.damping * kick);
        step.kick_dt = static_cast<float>(kick * left), step.kick_less = static_cast<float>(kick * (left - 1));
        step.keep = static_cast<float>(std::exp(-b.damping * kick));
        step.dt = i < count ? static_cast<float>(dt) : 0.0f;
        step.new_offset = (last - i) % 2 == 0 ? &b.next->x : &s.place[0].x;
        if (b.shape) {
            const ShapeTotals totals = sum_shape(step, b.slices, scratch.shape_sums);
            fit_goals(totals, island.poses.orientation[b.body], step);
            fit_drag(totals, step);
        }
        for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
            spring_kernels().step(&step, begin, end, s.sums.data() + begin / kSlicesPerChunk * kSliceWidth);
        });
        step.offset = step.new_offset;
    }
    if (!b.synchronous()) b.last_dt = dt;
    double damped = 0;
    for (const double sum : s.sums) damped += sum;
    return damped;
}

}  // namespace trocar
