#include "systems/advance/tissue/runaway.hpp"

#include <immintrin.h>

#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
#include "systems/advance/island/constants.hpp"
namespace trocar {
namespace {

struct Sums {
    double mass = 0, elastic = 0, gravity = 0;
};

// Elastic energy and height of a body `back` seconds before a position, J; plain loops in double: only needed
// if a body's energy has grown fast.
Sums sum_potential(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, const Float4* at, double back,
                   TissueScratch& scratch) {
    SpringStep step = b.step;
    step.offset = &at->x;
    step.back = static_cast<float>(back);
    const auto position = [&](uint32_t v) {
        const Particles& p = particles;
        const uint32_t i = b.particles.first + v;
        return Vec3d(Vec3d(at[v].x, at[v].y, at[v].z) - back * Vec3d(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]));
    };
    if (b.shape) {
        Quat orientation = b.orientation;
        fit_goals(sum_shape(step, b.slices, scratch.shape_sums), orientation, step);
    }
    Sums sums;
    for (uint32_t v = 0; v < b.particles.count; ++v) {
        const Vec3d x = position(v), rest(step.anchor_x[v], step.anchor_y[v], step.anchor_z[v]);
        Vec3d goal;
        for (int i = 0; i < 3; ++i)
            goal[i] = step.centre[i] + Vec3d(step.turn[3 * i], step.turn[3 * i + 1], step.turn[3 * i + 2]).dot(rest);
        sums.elastic += 0.5 * step.anchor_stiffness[v] * (x - goal).squaredNorm();
        const double mass = at[v].w > 0 ? 1.0 / at[v].w : 0;
        sums.mass += mass;
        sums.gravity -= mass * call.params.gravity.dot(x);
        for (uint32_t c = step.slice_column[v / kSliceWidth]; c < step.slice_column[v / kSliceWidth + 1]; ++c) {
            const size_t half_edge = size_t{c} * kSliceWidth + v % kSliceWidth;
            const uint32_t far_end = step.neighbour[half_edge];
            if (far_end == v) continue;
            const double stretch = (position(far_end) - x).norm() - step.rest_length[half_edge];
            sums.elastic += 0.25 * step.stiffness * stretch * stretch;
        }
    }
    return sums;
}

}  // namespace

double kinetic_energy(const Particles& particles, const AdvanceBody& b) {
    const Particles& p = particles;
    const float* inverse_mass = &p.offset[b.particles.first].w;
    const __m256i lanes = _mm256_set_epi32(28, 24, 20, 16, 12, 8, 4, 0);
    __m256 sum = _mm256_setzero_ps();
    for (uint32_t i = b.particles.first; i < b.particles.end(); i += 8, inverse_mass += 32) {
        const __m256 x = _mm256_loadu_ps(&p.velocity_x[i]), y = _mm256_loadu_ps(&p.velocity_y[i]), z = _mm256_loadu_ps(&p.velocity_z[i]);
        const __m256 w = _mm256_i32gather_ps(inverse_mass, lanes, 4);
        const __m256 v2 = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(x, x), _mm256_mul_ps(y, y)), _mm256_mul_ps(z, z));
        sum = _mm256_add_ps(sum, _mm256_and_ps(_mm256_div_ps(v2, w), _mm256_cmp_ps(w, _mm256_setzero_ps(), _CMP_GT_OQ)));
    }
    alignas(32) float lane[8];
    _mm256_store_ps(lane, sum);
    double energy = 0;
    for (const float s : lane) energy += 0.5 * static_cast<double>(s);
    return energy;
}

bool has_run_away(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, TissueScratch& scratch) {
    const double kinetic = kinetic_energy(particles, b);
    if (b.touched || b.step.force_x || b.step.spring_factor || kinetic <= kGrowth * b.kinetic) return false;
    const Sums before = sum_potential(call, particles, b, particles.offset.data() + b.particles.first, 0, scratch);
    if (kinetic <= kNoise * before.mass) return false;
    const Sums after = sum_potential(call, particles, b, b.now, 0.5 * b.last_dt, scratch);
    const double grown = (kinetic - b.kinetic) + (after.elastic - before.elastic) + (after.gravity - before.gravity);
    return grown > kGrowth * (b.kinetic + before.elastic) + kNoise * before.mass && grown > 0.5 * (kinetic + after.elastic);
}

}  // namespace trocar
