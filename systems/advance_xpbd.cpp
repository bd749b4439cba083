#include <algorithm>
#include <cmath>
#include <span>

#include "engine/implicit_kernels.hpp"
#include "engine/shape_fit.hpp"
#include "engine/tet_forces.hpp"
#include "systems/advance_implicit.hpp"
namespace trocar {
namespace {

// Batches of a colour that one thread takes at once.
constexpr uint32_t kBatchesPerChunk = 256;

Range batches_of(std::span<const Range> colour, Range colours) {
    return colours.count == 0 ? Range{} : Range{colour[colours.first].first, colour[colours.end() - 1].end() - colour[colours.first].first};
}

// Springs and tetrahedra of a body that tears, as what has torn has left them: b.step and the volumes are bound to that.
void bind_what_is_left(AdvanceIsland& island, const AdvanceBody& b, XpbdStep& step) {
    ImplicitScratch& s = island.scratch.implicit;
    const Springs& springs = island.inputs.springs;
    const uint32_t prototype = island.inputs.bodies.mesh[b.body];
    const Range rows = batches_of(springs.colour, springs.colours[prototype]);
    s.left_rest.resize(size_t{kSliceWidth} * rows.count), s.left_factor.resize(s.left_rest.size());
    parallel_for(rows.count, kBatchesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin * kSliceWidth; i < end * kSliceWidth; ++i) {
            const uint32_t batch = rows.first + i / kSliceWidth, lane = i % kSliceWidth, h = springs.batch_half_edge[batch][lane];
            const bool whole = h != kNone && b.step.neighbour[h] != springs.batch[batch][lane];
            s.left_rest[i] = whole ? b.step.rest_length[h] : 0.0f;
            s.left_factor[i] = !whole ? 0.0f : b.step.spring_factor ? b.step.spring_factor[h] : 1.0f;
        }
    });
    step.rest = s.left_rest.data() - size_t{kSliceWidth} * rows.first;
    step.factor = s.left_factor.data() - size_t{kSliceWidth} * rows.first;
    if (!step.corners) return;
    const Solids& solids = *island.inputs.other.solids;
    const Range tets = batches_of(solids.colour, solids.colours[prototype]);
    const std::vector<float>& rest = island.inputs.other.torn_springs->rest;
    s.left_volume.resize(size_t{kBatchWidth} * tets.count);
    parallel_for(tets.count, kBatchesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin * kBatchWidth; i < end * kBatchWidth; ++i) {
            const uint32_t t = solids.batch_tetrahedron[tets.first + i / kBatchWidth][i % kBatchWidth];
            s.left_volume[i] = t == kNone ? 0.0f : rest[t];
        }
    });
    step.volume = s.left_volume.data() - size_t{kBatchWidth} * tets.first;
}

bool may_tear(const Tears* tears, uint32_t body) {
    return tears && std::any_of(tears->body.begin(), tears->body.end(), [&](const TearBody& t) { return t.body == body; });
}

XpbdStep bind_xpbd(AdvanceIsland& island, const AdvanceBody& b) {
    ImplicitScratch& s = island.scratch.implicit;
    const Springs& springs = island.inputs.springs;
    const size_t rows = b.particles.count;
    s.place.assign(rows + 4 * kSliceWidth, Float4{});
    s.direction.assign(rows + 4 * kSliceWidth, Float4{});
    s.sums.resize(size_t{chunk_count(b.slices, kSlicesPerChunk)} * kSliceWidth);
    XpbdStep step = {};
    step.spring = &b.step;
    step.place = &s.place[0].x;
    step.increment = &s.direction[0].x;
    step.ends = springs.batch.data()->data();
    step.rest = springs.batch_rest.data()->data();
    step.rows = static_cast<uint32_t>(rows);
    const uint32_t prototype = island.inputs.bodies.mesh[b.body];
    if (springs.info[prototype].varied) step.factor = springs.batch_factor.data()->data();
    if (has_tets(island.inputs.other.solids, island.inputs.bodies, b.body)) {
        const Solids& solids = *island.inputs.other.solids;
        const SolidModuli moduli = solid_moduli(island.inputs.bodies.tissue[b.body]);
        step.corners = solids.batch.data()->data();
        step.volume = solids.batch_volume.data()->data();
        step.volume_factor = solids.batch_factor.data()->data();
        step.bulk = static_cast<float>(moduli.bulk), step.crush = static_cast<float>(moduli.crush);
        const double least = 0.5 / springs.info[prototype].mean_rest;  // of a good one it is 1.2 over an edge
        step.least_slope2 = static_cast<float>(least * least);
        if (b.stepping.iterations > 1) {
            s.volume_lambda.assign(solids.batch.size() * kSliceWidth, 0.0f);
            step.volume_lambda = s.volume_lambda.data();
        }
    }
    if (may_tear(island.inputs.other.tears, b.body)) bind_what_is_left(island, b, step);
    step.compliance = static_cast<float>(1 / (static_cast<double>(b.step.stiffness) * island.dt * island.dt));
    if (b.stepping.iterations > 1) {
        s.lambda.assign(springs.batch.size() * kSliceWidth, 0.0f);
        s.change.resize(3 * rows);
        step.lambda = s.lambda.data();
        step.anchor_lambda = s.change.data();
    }
    return step;
}

// Of a body whose velocities are `back` seconds behind its places.
double energy_of(const AdvanceIsland& island, const AdvanceBody& b, const float* offset, double back) {
    std::vector<double>& sums = island.scratch.shape_sums;
    SpringStep step = b.step;
    step.offset = offset;
    step.velocity_x = step.new_velocity_x, step.velocity_y = step.new_velocity_y, step.velocity_z = step.new_velocity_z;
    step.back = static_cast<float>(back);
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
                             {step.velocity_x, step.velocity_y, step.velocity_z}, back, island.scratch.implicit.tet_energy);
    }
    return volumes + 0.5 * t[kSumMvv] + 0.25 * step.stiffness * t[kSumStretch] + 0.5 * t[kSumAnchor] -
           island.params.gravity.dot(Vec3d(t[kSumMPlace], t[kSumMPlace + 1], t[kSumMPlace + 2]));
}

double energy_after(const AdvanceIsland& island, const AdvanceBody& b) {
    return energy_of(island, b, b.step.new_offset, b.synchronous() ? 0 : 0.5 * island.dt);
}

}  // namespace

double energy_before(const AdvanceIsland& island, const AdvanceBody& b) {
    if (std::isfinite(b.energy)) return b.energy;
    return energy_of(island, b, b.step.offset, b.synchronous() ? 0 : 0.5 * b.last_dt);
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

namespace {

// Power of the forces that others put in, at the velocities before the step, W.
double power_of_others(const SpringStep& step, uint32_t particles) {
    if (!step.force_x) return 0;
    double power = 0;
    for (uint32_t i = 0; i < particles; ++i) {
        power += double(step.force_x[i]) * step.velocity_x[i] + double(step.force_y[i]) * step.velocity_y[i] +
                 double(step.force_z[i]) * step.velocity_z[i];
    }
    return power;
}

}  // namespace

void step_xpbd(AdvanceIsland& island, AdvanceBody& b, double* work) {
    const ImplicitKernels& kernels = implicit_kernels();
    const Springs& springs = island.inputs.springs;
    const Range colours = springs.colours.at(island.inputs.bodies.mesh[b.body]);
    AdvanceScratch& scratch = island.scratch;
    const XpbdStep step = bind_xpbd(island, b);
    const bool books = island.params.account_energy;
    const double before = books ? energy_before(island, b) : 0;
    const double kick = 0.5 * (b.last_dt + island.dt);
    // a kick does its work half at the velocities before it, half at those after it: energy is that of half a step back
    const double half_others = books ? 0.5 * kick * power_of_others(b.step, b.particles.count) : 0;
    b.last_dt = island.dt;
    b.step.kick_dt = static_cast<float>(kick);
    b.step.keep = static_cast<float>(std::exp(-b.damping * kick));
    if (b.shape) {
        fit_drag(sum_shape(b.step, b.slices, scratch.shape_sums), b.step);
    }
    const double damped = sum_over(b, scratch.implicit.sums,
                                   [&](uint32_t begin, uint32_t end, double* lanes) { kernels.xpbd_predict(&step, begin, end, lanes); });
    if (b.shape) {
        // the goals go where the body is going: else they would hold it back
        SpringStep coming = b.step;
        coming.offset = b.step.new_offset;
        fit_goals(sum_shape(coming, b.slices, scratch.shape_sums), island.poses.orientation[b.body], b.step);
    }
    for (uint32_t sweep = 0; sweep < b.stepping.iterations; ++sweep) {
        for (uint32_t c = colours.first; c < colours.end(); ++c) {
            const Range batches = springs.colour[c];
            parallel_for(batches.count, kBatchesPerChunk,
                         [&](uint32_t begin, uint32_t end) { kernels.xpbd_springs(&step, batches.first + begin, batches.first + end); });
        }
        const Solids* solids = step.corners ? island.inputs.other.solids : nullptr;
        for (uint32_t c = 0; solids && c < solids->colours[island.inputs.bodies.mesh[b.body]].count; ++c) {
            const Range batches = solids->colour[solids->colours[island.inputs.bodies.mesh[b.body]].first + c];
            parallel_for(batches.count, kBatchesPerChunk,
                         [&](uint32_t begin, uint32_t end) { kernels.xpbd_volumes(&step, batches.first + begin, batches.first + end); });
        }
        for_slices(b.slices, [&](uint32_t begin, uint32_t end) { kernels.xpbd_anchors(&step, begin, end); });
    }
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) { kernels.xpbd_finish(&step, begin, end); });
    if (!books) return;
    if (work) work[0] += damped;
    book_own_work(island, b, before, damped + half_others + 0.5 * kick / island.dt * work_of_others(b.step, b.particles.count));
}

}  // namespace trocar
