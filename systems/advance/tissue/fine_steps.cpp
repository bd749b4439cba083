#include "systems/advance/tissue/fine_steps.hpp"

#include <immintrin.h>

#include <algorithm>
#include <cmath>

#include "components/links.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/relaxation.hpp"
#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/advance/tissue/link_forces.hpp"
#include "systems/advance/tissue/thread_forces.hpp"
namespace trocar {
namespace {

// Largest squared speed of the particles of a body, (m/s)^2; padded to a multiple of sixteen.
float fastest_of(const Particles& p, Range range) {
    __m256 most = _mm256_setzero_ps();
    for (uint32_t i = range.first; i < range.end(); i += 8) {
        const __m256 x = _mm256_loadu_ps(&p.velocity_x[i]), y = _mm256_loadu_ps(&p.velocity_y[i]), z = _mm256_loadu_ps(&p.velocity_z[i]);
        most = _mm256_max_ps(most, _mm256_fmadd_ps(x, x, _mm256_fmadd_ps(y, y, _mm256_mul_ps(z, z))));
    }
    alignas(32) float lane[8];
    _mm256_store_ps(lane, most);
    return *std::max_element(lane, lane + 8);
}

// Whether the ends of some spring move relative to each other by more than kApart of its rest length in dt.
bool folds_fast(const SpringStep& step, uint32_t slices, float dt) {
    const float share = kApart / dt;
    for (uint32_t slice = 0; slice < slices; ++slice) {
        for (size_t h = size_t{step.slice_column[slice]} * kSliceWidth; h < size_t{step.slice_column[slice + 1]} * kSliceWidth; ++h) {
            const uint32_t p = slice * kSliceWidth + h % kSliceWidth, q = step.neighbour[h];
            if (q <= p) continue;
            const float x = step.velocity_x[q] - step.velocity_x[p], y = step.velocity_y[q] - step.velocity_y[p],
                        z = step.velocity_z[q] - step.velocity_z[p], most = share * step.rest_length[h];
            if ((x * x + y * y) + z * z > most * most) return true;
        }
    }
    return false;
}

bool has_fast_folds(const AdvanceInputs& in, const Particles& particles, uint32_t body, double dt) {
    const SpringInfo& info = in.springs.info[in.bodies.mesh[body]];
    const double far = kShortDisplacement * info.mean_rest / dt;
    const Range range{in.bodies.particles[body].first + info.skin, in.bodies.particles[body].count - info.skin};
    if (!(fastest_of(particles, range) > far * far)) return false;
    const SpringStep step = bind_body(in.springs, in.bodies, in.anchors, particles, body, in.other.torn_springs);
    return folds_fast(step, info.slices.count, static_cast<float>(dt));
}

// Tetrahedra of a body whose forces go to s.volume_force.
TetStep bind_loose_tets(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, TissueScratch& scratch) {
    const AdvanceInputs& in = call.inputs;
    ImplicitScratch& s = scratch.implicit;
    const size_t padded_count = b.particles.count;
    s.volume_force.assign(3 * padded_count, 0.0f);
    s.position.resize(std::max(s.position.size(), padded_count));
    TetStep tets = bind_tets(*in.other.solids, in.bodies, particles, b.body, in.other.torn_springs);
    tets.corner_force = &scratch.corner_force[0].x;
    tets.force_x = s.volume_force.data(), tets.force_y = tets.force_x + padded_count, tets.force_z = tets.force_y + padded_count;
    return tets;
}

// Least volume ratio of a body whose nodes move from `now` with their present velocities.
float least_volume_later(TetStep tets, const Float4* now, const Particles& p, Range nodes, double seconds, std::vector<Float4>& position) {
    constexpr uint32_t kNodesPerChunk = 4096;
    const __m128 h = _mm_set1_ps(static_cast<float>(seconds));
    position.resize(std::max<size_t>(position.size(), nodes.count));
    parallel_for(nodes.count, kNodesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t v = begin; v < end; ++v) {
            const uint32_t i = nodes.first + v;
            const __m128 velocity = _mm_setr_ps(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i], 0);
            _mm_store_ps(&position[v].x, _mm_add_ps(_mm_load_ps(&now[v].x), _mm_mul_ps(h, velocity)));
        }
    });
    tets.offset = &position[0].x;
    return least_volume_ratio(tets);
}

// The same after so many seconds, of a body with tetrahedra.
double least_volume(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, double seconds, TissueScratch& scratch) {
    const AdvanceInputs& in = call.inputs;
    const TetStep tets = bind_tets(*in.other.solids, in.bodies, particles, b.body, in.other.torn_springs);
    return least_volume_later(tets, b.now, particles, b.particles, seconds, scratch.implicit.position);
}

// Least volume ratio of a solid, now and in the middle of a pass of `seconds`.
double least_volume_of_pass(const AdvanceInputs& in, const Particles& particles, uint32_t body, double seconds,
                            std::vector<Float4>& position) {
    const TetStep tets = bind_tets(*in.other.solids, in.bodies, particles, body, in.other.torn_springs);
    const Range all = in.bodies.particles[body];
    const uint32_t skin = embedded_count(*in.other.solids, in.bodies.mesh[body]);
    const Range nodes{all.first + skin, all.count - skin};
    return std::min(least_volume_ratio(tets),
                    least_volume_later(tets, &particles.offset[nodes.first], particles, nodes, 0.5 * seconds, position));
}

// Whether a link of the body may break in the coming pass, or was let go of at its start.
bool may_lose_a_link(const AdvanceInputs& in, uint32_t body) {
    constexpr double kNear = 0.9;  // of its strength
    const Links* links = in.other.links;
    if (!in.other.actions || !links) return false;
    const std::vector<uint32_t>& released = in.other.action_state->released;
    if (std::ranges::find(released, body) != released.end()) return true;
    return std::ranges::any_of(links->group, [&](const LinkGroup& g) {
        return g.body != kNone && (g.body == body || g.holder == body) && g.links.count > 0 && g.largest_strain > kNear * g.break_strain;
    });
}

}  // namespace

bool needs_subcycling(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, double least, TissueScratch& scratch) {
    const AdvanceInputs& in = call.inputs;
    if (!has_tets(in.other.solids, in.bodies, b.body)) return false;
    const Particles& p = particles;
    float fastest = 0;
    for (uint32_t i = b.particles.first; i < b.particles.end(); ++i) {
        fastest =
            std::max(fastest, p.velocity_x[i] * p.velocity_x[i] + p.velocity_y[i] * p.velocity_y[i] + p.velocity_z[i] * p.velocity_z[i]);
    }
    const double far = kFarDisplacement * in.springs.info[in.bodies.mesh[b.body]].mean_rest / call.dt;
    if (!(fastest > far * far)) return false;
    // fast expansion means that it was crushed a step before
    return least < kCrushed || least_volume(call, particles, b, call.dt, scratch) < kCrushed ||
           least_volume(call, particles, b, -call.dt, scratch) < kCrushed;
}

bool needs_leapfrog(const AdvanceInputs& inputs, const Particles& particles, const ContactConstraints& constraints,
                    std::span<const uint32_t> island_bodies, std::span<const uint32_t> island_constraints) {
    const Bodies& bodies = inputs.bodies;
    if (bodies.stepping.empty()) return false;
    const auto is_implicit = [&](uint32_t body) { return stepping_of(bodies, body).integrator == Integrator::kBackwardEuler; };
    const auto turns = [&](uint32_t body) {
        if (bodies.motion[body] == Motion::kFree) return true;
        return bodies.motion[body] == Motion::kHand &&
               (std::ranges::any_of(inputs.tools, [&](const HandTool& t) { return t.body == body && t.inertia > 0; }) ||
                std::ranges::any_of(inputs.jaws, [&](const ToolJaw& jaw) { return jaw.body == body; }));
    };
    const bool any_turns = std::ranges::any_of(island_bodies, turns);
    // an implicit step takes as long as this many of leapfrog: 5 to 10 iterations, each with a solution and sweeps
    constexpr double kLeapfrogSteps = 16;
    const auto is_tied = [&](uint32_t body) {
        const Links* links = inputs.other.links;
        const double least = kLeapfrogSteps * bodies.stable_dt[body];
        const ThreadState* threads = inputs.other.thread_state;
        return (links && body < links->stable_dt.size() && links->stable_dt[body] < least) ||
               (threads && body < threads->stable_dt.size() && threads->stable_dt[body] < least);
    };
    const auto is_held = [&](uint32_t body) {
        if (bodies.anchor_frame[body] == AnchorFrame::kWorld) return true;
        // padding, which has no mass either, is in the last slice
        const auto first = particles.offset.begin() + bodies.particles[body].first;
        const uint32_t count = bodies.particles[body].count;
        return count > kSliceWidth &&
               std::any_of(first, first + (count - kSliceWidth), [](const Float4& particle) { return particle.w == 0; });
    };
    const auto unsolved = [&](uint32_t body) {
        return is_implicit(body) &&
               (any_turns || has_pressure(bodies, body) || self_contact_of(bodies, body) > 0 || is_tied(body) || !is_held(body));
    };
    return std::ranges::any_of(island_constraints,
                               [&](uint32_t c) { return unsolved(constraints.body[c]) || unsolved(constraints.other[c]); });
}

uint32_t finer_steps(const AdvanceInputs& in, const Particles& particles, std::span<const uint32_t> island_bodies, double dt,
                     double seconds, AdvanceScratch& scratch) {
    uint32_t most = 1;
    for (const uint32_t body : island_bodies) {
        if (!is_deformable(in.bodies, body) || stepping_of(in, body).integrator != Integrator::kLeapfrog) continue;
        if (may_lose_a_link(in, body)) most = std::max(most, kFinerLosing);
        if (has_tets(in.other.solids, in.bodies, body)) {
            const double least = least_volume_of_pass(in, particles, body, seconds, scratch.tissue.implicit.position);
            most = std::max(most, least < kPressedFlat ? kFinerPressedFlat : least < kPressed ? kFinerPressed : 1u);
        } else if (most < kFinerShell && (in.bodies.tissue[body].damping == 0 || (in.bodies.anchor_frame[body] != AnchorFrame::kShape &&
                                                                                  has_fast_folds(in, particles, body, dt)))) {
            most = kFinerShell;
        }
    }
    return most;
}

double step_finely(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                   AdvanceResult& result) {
    ImplicitScratch& s = scratch.implicit;
    const size_t padded_count = b.particles.count;
    const uint32_t count = kFiner * substeps_for(call.dt, call.inputs.bodies.stable_dt[b.body], call.dt);
    const double dt = call.dt / count;
    TetStep tets = bind_loose_tets(call, state.particles, b, scratch);
    SpringStep step = b.step;
    step.remainder_x = step.remainder_y = step.remainder_z = nullptr, step.remainder_step = 0;
    float* const force[3] = {tets.force_x, tets.force_y, tets.force_z};
    step.force_x = force[0], step.force_y = force[1], step.force_z = force[2];
    s.sums.assign(size_t{chunk_count(b.slices, kSlicesPerChunk)} * kSliceWidth, 0.0);
    for (uint32_t i = 0; i < count; ++i) {
        for (float* axis : force) std::fill_n(axis, padded_count, 0.0f);
        if (b.linked) add_link_forces(island, static_cast<uint32_t>(&b - island.body.data()), force);
        if (b.threaded) add_thread_forces(call.inputs.other, island, b.body, force);
        tets.offset = step.offset;
        result.min_volume_ratio = std::min<double>(result.min_volume_ratio, add_tet_forces(tets, b.slices));
        const double kick = i == 0 ? 0.5 * (b.last_dt + dt) : dt;
        if (step.branches > 0) set_relaxing_time(prony_of(call.inputs.bodies, b.body), i == 0 ? b.last_dt : dt, step);
        const double left = b.shape ? 1.0 : std::exp(-0.5 * b.damping * kick);
        step.kick_dt = static_cast<float>(kick * left), step.kick_less = static_cast<float>(kick * (left - 1));
        step.keep = static_cast<float>(std::exp(-b.damping * kick));
        step.dt = static_cast<float>(dt);
        step.new_offset = (count - 1 - i) % 2 == 0 ? &b.next->x : &s.position[0].x;
        if (b.shape) {
            const ShapeTotals totals = sum_shape(step, b.slices, scratch.shape_sums);
            fit_goals(totals, state.poses.orientation[b.body], step);
            fit_drag(totals, step);
        }
        for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
            spring_kernels().step(&step, begin, end, s.sums.data() + begin / kSlicesPerChunk * kSliceWidth);
        });
        step.offset = step.new_offset;
    }
    b.last_dt = dt;
    double damped = 0;
    for (const double sum : s.sums) damped += sum;
    return damped;
}

}  // namespace trocar
