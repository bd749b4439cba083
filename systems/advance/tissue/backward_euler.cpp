#include "systems/advance/tissue/backward_euler.hpp"

#include <immintrin.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/base/check.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
#include "systems/advance/tissue/energy.hpp"
#include "systems/advance/tissue/forces.hpp"
namespace trocar {
namespace {

constexpr uint32_t kHistory = ImplicitScratch::kHistory;
// Rounds of iterations while the energy of a step has grown by more than its rounding: the minimum itself loses energy.
// If it has after the last, the step is shortened: without displacement nothing is left but the energy before less that
// of motion. By trial.
constexpr uint32_t kMostRounds = 8, kMostHalvings = 30;
constexpr double kRoundedEnergy = 1e-5;

__m128 at(const Float4& f) { return _mm_load_ps(&f.x); }
void put(Float4& f, __m128 v) { _mm_store_ps(&f.x, v); }

// Sum of the products of x, y and z, in double and in order.
double product(const std::vector<Float4>& a, const std::vector<Float4>& b, uint32_t count) {
    __m256d even = _mm256_setzero_pd(), odd = _mm256_setzero_pd();
    for (uint32_t i = 0; i < count; i += 2) {  // padded to sixteen
        even = _mm256_fmadd_pd(_mm256_cvtps_pd(at(a[i])), _mm256_cvtps_pd(at(b[i])), even);
        odd = _mm256_fmadd_pd(_mm256_cvtps_pd(at(a[i + 1])), _mm256_cvtps_pd(at(b[i + 1])), odd);
    }
    const Vec4d sum = (Vec4d)_mm256_add_pd(even, odd);
    return sum[0] + sum[1] + sum[2];
}

double longest(const std::vector<Float4>& a, uint32_t count) {
    float most = 0;
    for (uint32_t i = 0; i < count; ++i) most = std::max(most, a[i].x * a[i].x + a[i].y * a[i].y + a[i].z * a[i].z);
    return std::sqrt(double{most});
}

// The step of one body.
struct EulerStep {
    const AdvanceCall& call;
    const AdvanceIsland& island;
    TissueScratch& scratch;
    const AdvanceState& state;
    AdvanceBody& b;
    AdvanceResult& result;
    ImplicitScratch& s;
    ImplicitFactor& factor;
    uint32_t count;
};
using Acceleration = ImplicitScratch::Acceleration;

ImplicitFactor& factor_of(const AdvanceCall& call, const Particles& particles, uint32_t body, TissueScratch& s) {
    const AdvanceInputs& in = call.inputs;
    const double step = factored_step(call.dt);
    const float stiffness = in.bodies.spring_stiffness[body];
    const auto found = std::ranges::find_if(
        s.factor, [&](const ImplicitFactor& f) { return f.body == body && f.step == step && f.stiffness == stiffness; });
    if (found != s.factor.end()) return *found;
    make_factor(in.springs, in.bodies, particles, in.anchors, body, step, s.factor.emplace_back());
    return s.factor.back();
}

void make_room(ImplicitScratch& s, uint32_t count) {
    for (auto* field : {&s.position, &s.inertia, &s.displacement, &s.force, &s.change, &s.volume_gradient, &s.volume_response})
        field->resize(count);
    for (auto* fields : {&s.iterate, &s.changes, &s.forces})
        for (auto& field : *fields) field.resize(count);
    s.volume_share = 0;
    s.rate.resize(3 * size_t{count});
    s.still.assign(count, 0.0f);
}

// Damping before the step. Returns its work, J.
double damp(const AdvanceCall& call, TissueScratch& scratch, AdvanceBody& b) {
    if (b.shape) {
        b.step.back = 0;
        fit_drag(sum_shape(b.step, b.slices, scratch.shape_sums), b.step);
    }
    if (b.damping == 0) return 0;
    const double keep = std::exp(-b.damping * call.dt);
    const Vec3d drag(b.step.drag_velocity[0], b.step.drag_velocity[1], b.step.drag_velocity[2]),
        turn(b.step.drag_turn[0], b.step.drag_turn[1], b.step.drag_turn[2]);
    double work = 0;
    for (uint32_t i = 0; i < b.particles.count; ++i) {
        const Float4& o = b.now[i];
        if (!(o.w > 0)) continue;
        float* const velocity[3] = {b.step.new_velocity_x + i, b.step.new_velocity_y + i, b.step.new_velocity_z + i};
        const Vec3d before(*velocity[0], *velocity[1], *velocity[2]), with = drag + turn.cross(Vec3d(o.x, o.y, o.z));
        const Vec3d after = (with + keep * (before - with)).cast<float>().cast<double>();
        for (int k = 0; k < 3; ++k) *velocity[k] = static_cast<float>(after[k]);
        work += 0.5 / double{o.w} * (after - before).dot(after + before);
    }
    return work;
}

// s.force: the forces at the displacement, with that of inertia, N.
void find_force(EulerStep& e) {
    AdvanceBody& b = e.b;
    ImplicitScratch& s = e.s;
    for (uint32_t i = 0; i < e.count; ++i) put(s.position[i], _mm_add_ps(at(b.now[i]), at(s.displacement[i])));
    const Float4* const start = std::exchange(b.now, s.position.data());
    find_forces(e.call, e.island, e.state.particles, e.scratch, b, e.result);
    b.now = start;
    SpringStep step = b.step;
    step.offset = &s.position[0].x, step.new_offset = &s.change[0].x;
    step.velocity_x = step.velocity_y = step.velocity_z = s.still.data();
    float* const rate[3] = {s.rate.data(), s.rate.data() + e.count, s.rate.data() + 2 * size_t{e.count}};
    step.new_velocity_x = rate[0], step.new_velocity_y = rate[1], step.new_velocity_z = rate[2];
    step.remainder_x = nullptr;
    step.dt = 0, step.kick_dt = 1, step.kick_less = 0, step.keep = 1, step.back = 0;
    if (b.shape) fit_goals(sum_shape(step, b.slices, e.scratch.shape_sums), e.state.poses.orientation[b.body], step);
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) { spring_kernels().step(&step, begin, end, nullptr); });
    const float h = static_cast<float>(e.call.dt), per_h2 = 1 / (h * h);
    for (uint32_t i = 0; i < e.count; ++i) {
        const Float4 &u = s.displacement[i], &free = s.inertia[i];
        const float mass = b.now[i].w > 0 ? 1 / b.now[i].w : 0.0f;
        const auto along = [&](int k, float moved) { return mass * (rate[k][i] - moved * per_h2); };
        s.force[i] = {along(0, u.x - free.x), along(1, u.y - free.y), along(2, u.z - free.z), 0};
    }
}

// The gradient of the volume and its response, at the start of a step.
void bind_pressure(EulerStep& e) {
    const AdvanceInputs& in = e.call.inputs;
    if (!has_pressure(in.bodies, e.b.body)) return;
    ImplicitScratch& s = e.s;
    const uint32_t prototype = in.bodies.mesh[e.b.body];
    float* g = s.rate.data();
    find_volume_gradient(in.springs, prototype, e.b.now, e.scratch.force_sums, g, g + e.count, g + 2 * size_t{e.count});
    for (uint32_t i = 0; i < e.count; ++i) {
        const bool moves = e.b.now[i].w > 0;
        s.volume_gradient[i] = moves ? Float4{g[i], g[e.count + i], g[2 * size_t{e.count} + i], 0} : Float4{};
    }
    solve_factor(e.factor, s.volume_gradient.data(), s.volume_response.data(), e.count);
    // p = K (V0 - V) / V0, so dp/dV is the difference of two pressures
    const double stiffness = find_pressure(in.springs, in.bodies, e.b.body, 0) - find_pressure(in.springs, in.bodies, e.b.body, 1);
    e.s.volume_share = 1 / (1 / stiffness + product(s.volume_gradient, s.volume_response, e.count));
}

// s.change = A^-1 s.force.
void solve(EulerStep& e) {
    ImplicitScratch& s = e.s;
    solve_factor(e.factor, s.force.data(), s.change.data(), e.count);
    if (e.s.volume_share == 0) return;
    const __m128 less = _mm_set1_ps(static_cast<float>(e.s.volume_share * product(s.volume_gradient, s.change, e.count)));
    for (uint32_t i = 0; i < e.count; ++i) put(s.change[i], _mm_fnmadd_ps(less, at(s.volume_response[i]), at(s.change[i])));
}

// Moves to the next iterate: displacement + change, less a combination of the differences. Returns the longest move, m.
double accelerate(EulerStep& e, Acceleration& a) {
    ImplicitScratch& s = e.s;
    const uint32_t slot = a.iteration++ % kHistory, ahead = a.iteration % kHistory;
    const auto for_all = [&](const auto& visit) {
        for (uint32_t i = 0; i < e.count; ++i) visit(i);
    };
    if (a.iteration > 1) {  // the slot holds the previous values
        for_all([&](uint32_t i) {
            const __m128 next = _mm_add_ps(at(s.displacement[i]), at(s.change[i]));
            put(s.iterate[slot][i], _mm_sub_ps(next, at(s.iterate[slot][i])));
            put(s.changes[slot][i], _mm_sub_ps(at(s.change[i]), at(s.changes[slot][i])));
            put(s.forces[slot][i], _mm_sub_ps(at(s.force[i]), at(s.forces[slot][i])));
        });
        a.kept = std::min(a.kept + 1, kHistory - 1);
    }
    uint32_t used[kHistory];
    for (uint32_t k = 0; k < a.kept; ++k) used[k] = (slot + kHistory - k) % kHistory;
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kHistory, kHistory> matrix(a.kept, a.kept);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kHistory, 1> share(a.kept);
    for (uint32_t k = 0; k < a.kept; ++k)
        a.products[slot][used[k]] = a.products[used[k]][slot] = product(s.changes[used[k]], s.forces[slot], e.count);
    for (uint32_t k = 0; k < a.kept; ++k) {
        for (uint32_t j = 0; j < a.kept; ++j) matrix(k, j) = a.products[used[k]][used[j]] * (k == j ? 1 + 1e-6 : 1);
        share(k) = product(s.changes[used[k]], s.force, e.count);
    }
    if (a.kept > 0) share = matrix.ldlt().solve(share);
    if (!share.allFinite()) share.setZero();
    __m128 most = _mm_setzero_ps();
    for_all([&](uint32_t i) {
        const __m128 plain = _mm_add_ps(at(s.displacement[i]), at(s.change[i]));
        __m128 next = plain;
        for (uint32_t k = 0; k < a.kept; ++k)
            next = _mm_fnmadd_ps(_mm_set1_ps(static_cast<float>(share(k))), at(s.iterate[used[k]][i]), next);
        put(s.iterate[ahead][i], plain), put(s.changes[ahead][i], at(s.change[i])), put(s.forces[ahead][i], at(s.force[i]));
        const __m128 move = _mm_sub_ps(next, at(s.displacement[i]));
        most = _mm_max_ps(most, _mm_mul_ps(move, move));
        put(s.displacement[i], next);
    });
    return std::sqrt(double{most[0]} + most[1] + most[2]);
}

// Bound of what the rounding of positions to floats adds to the energy of the springs, J.
double rounded_energy(const EulerStep& e) {
    const double ulp = 0x1p-22 * e.call.inputs.meshes.info[e.call.inputs.bodies.mesh[e.b.body]].radius;  // m, of a length
    return e.b.step.stiffness * ulp * ulp * kSliceWidth * (e.b.step.slice_column[e.b.slices] - e.b.step.slice_column[0]);
}

// Iterates on towards the end of the step.
void iterate(EulerStep& e, Acceleration& acceleration) {
    ImplicitScratch& s = e.s;
    // m: nothing moves by less in floats; and what gravity moves, so that slow motion is not solved better than fast
    const double rounding = 0x1p-24 * e.call.inputs.meshes.info[e.call.inputs.bodies.mesh[e.b.body]].radius;
    const double usual = e.call.params.gravity.norm() * e.call.dt * e.call.dt;
    double before = std::numeric_limits<double>::infinity(), left = before, moved = 0;
    for (uint32_t i = 1;; ++i) {
        find_force(e), solve(e);
        ++e.result.implicit_iterations;
        const double size = product(s.change, s.force, e.count);
        if (size > before) acceleration = {};  // it overshot: a plain step
        before = size;
        if (i >= e.b.stepping.iterations || !(left > std::max(rounding, e.b.stepping.tolerance * std::max(moved, usual)))) break;
        left = accelerate(e, acceleration);
        moved = longest(s.displacement, e.count);
    }
    for (uint32_t k = 0; k < e.count; ++k) put(s.displacement[k], _mm_add_ps(at(s.displacement[k]), at(s.change[k])));
    if (std::isfinite(left) && std::max(moved, usual) > rounding)
        e.result.worst_implicit_residual = std::max(e.result.worst_implicit_residual, left / std::max(moved, usual));
}

// A first iterate in free fall, only for the differences to the second: the displacement h v.
void start(EulerStep& e, Acceleration& acceleration) {
    ImplicitScratch& s = e.s;
    const float h = static_cast<float>(e.call.dt);
    const float *x = e.b.step.new_velocity_x, *y = e.b.step.new_velocity_y, *z = e.b.step.new_velocity_z, *g = e.b.step.gravity;
    const __m128 fall = _mm_setr_ps(h * h * g[0], h * h * g[1], h * h * g[2], 0);
    for (uint32_t i = 0; i < e.count; ++i) {
        const bool moves = e.b.now[i].w > 0;
        s.inertia[i] = moves ? Float4{h * x[i], h * y[i], h * z[i], 0} : Float4{};
        put(s.displacement[i], moves ? _mm_add_ps(at(s.inertia[i]), fall) : _mm_setzero_ps());
    }
    bind_pressure(e);
    if (e.call.params.gravity.squaredNorm() > 0) {
        find_force(e), solve(e), accelerate(e, acceleration);
        ++e.result.implicit_iterations;
    }
    std::copy_n(s.inertia.begin(), e.count, s.displacement.begin());
}

// Writes positions and velocities. Returns the energy, J.
double finish(EulerStep& e) {
    const float h = static_cast<float>(e.call.dt);
    for (uint32_t i = 0; i < e.count; ++i) {
        const Float4& u = e.s.displacement[i];
        put(e.b.next[i], _mm_add_ps(at(e.b.now[i]), at(u)));
        e.b.step.new_velocity_x[i] = u.x / h, e.b.step.new_velocity_y[i] = u.y / h, e.b.step.new_velocity_z[i] = u.z / h;
    }
    return implicit_energy(e.call, e.b, e.b.next, e.scratch, e.state);
}

// ---- in contact ----

// Of each particle alone: twice its own part of the Hessian. H <= 2 D, as k (x_p - x_q)^2 <= 2 k (x_p^2 + x_q^2).
void find_metric(EulerStep& e) {
    ImplicitScratch& s = e.s;
    const SpringStep& step = e.b.step;
    const double per_h2 = 1 / (e.call.dt * e.call.dt);
    s.metric.resize(e.count), s.response.resize(e.count);
    for (uint32_t p = 0; p < e.count; ++p) {
        const Float4& from = s.position[p];
        s.metric[p] = s.response[p] = {};
        if (!(e.b.now[p].w > 0)) continue;
        const double own = per_h2 / e.b.now[p].w + step.anchor_stiffness[p] + (e.factor.bending.empty() ? 0 : e.factor.bending[p]);
        double m[6] = {own, own, own, 0, 0, 0};
        const uint32_t slice = p / kSliceWidth;
        for (uint32_t c = step.slice_column[slice]; c < step.slice_column[slice + 1]; ++c) {
            const size_t half = size_t{c} * kSliceWidth + p % kSliceWidth;
            const uint32_t q = step.neighbour[half];
            if (q == p) continue;
            const double x = s.position[q].x - from.x, y = s.position[q].y - from.y, z = s.position[q].z - from.z;
            const double length2 = x * x + y * y + z * z, rest = step.rest_length[half];
            const double k = 2 * double{step.stiffness} * (step.spring_factor ? step.spring_factor[half] : 1.0f);
            const double across = length2 > rest * rest ? 1 - rest / std::sqrt(length2) : 0;
            const double along = length2 > 0 ? (1 - across) / length2 : 0;
            m[0] += k * (across + along * x * x), m[1] += k * (across + along * y * y), m[2] += k * (across + along * z * z);
            m[3] += k * along * x * y, m[4] += k * along * x * z, m[5] += k * along * y * z;
        }
        Eigen::Matrix3d matrix;
        matrix << m[0], m[3], m[4], m[3], m[1], m[5], m[4], m[5], m[2];
        const Eigen::Matrix3d inverse = matrix.inverse();
        for (int k = 0; k < 6; ++k) s.metric[p][k] = static_cast<float>(m[k]);
        s.response[p] = {static_cast<float>(inverse(0, 0)), static_cast<float>(inverse(1, 1)), static_cast<float>(inverse(2, 2)),
                         static_cast<float>(inverse(0, 1)), static_cast<float>(inverse(0, 2)), static_cast<float>(inverse(1, 2))};
    }
}

Float4 times(const ImplicitScratch::Symmetric& m, const Float4& v) {
    return {m[0] * v.x + m[3] * v.y + m[4] * v.z, m[3] * v.x + m[1] * v.y + m[5] * v.z, m[4] * v.x + m[5] * v.y + m[2] * v.z, 0};
}

EulerStep bind(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
               AdvanceResult& result) {
    ImplicitScratch& s = scratch.touched[b.implicit_slot];
    return {call, island, scratch, state, b, result, s, factor_of(call, state.particles, b.body, scratch), b.particles.count};
}

// Calls visit(node, index in the body) for the body's contact nodes.
template <typename Visit>
void for_nodes_of(const AdvanceIsland& island, const AdvanceBody& b, const Visit& visit) {
    const uint32_t owner = static_cast<uint32_t>(&b - island.body.data());
    for (uint32_t n = 0; n < island.nodes.node.size(); ++n) {
        const uint32_t particle = island.nodes.node.particle[n];
        if (particle != kNone && island.nodes.node.owner[n] == owner) visit(n, particle - b.particles.first);
    }
}

// The change of each particle alone.
void relax(EulerStep& e) {
    ImplicitScratch& s = e.s;
    for (uint32_t i = 0; i < e.count; ++i) s.change[i] = times(s.response[i], s.force[i]);
}

// Sets the velocities of contact nodes to those of the next iterate.
void show_nodes(const EulerStep& e, AdvanceIsland& island) {
    const double per_h = 1 / e.call.dt;
    for_nodes_of(island, e.b, [&](uint32_t n, uint32_t i) {
        if (e.b.now[i].w > 0) island.nodes.node.velocity[n] = per_h * float_vec4(_mm_add_ps(at(e.s.displacement[i]), at(e.s.change[i])));
    });
}

// Sets the changes of contact nodes by their velocities.
void take_nodes(EulerStep& e, const AdvanceIsland& island) {
    for_nodes_of(island, e.b, [&](uint32_t n, uint32_t i) {
        if (!(e.b.now[i].w > 0)) return;
        const __m128 u = _mm256_cvtpd_ps((__m256d)(e.call.dt * island.nodes.node.velocity[n]));
        put(e.s.change[i], _mm_sub_ps(u, at(e.s.displacement[i])));
    });
}

}  // namespace

void begin_touched_step(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state,
                        AdvanceBody& b, AdvanceResult& result) {
    EulerStep e = bind(call, island, scratch, state, b, result);
    ImplicitScratch& s = e.s;
    make_room(s, e.count);
    s.energy = std::isfinite(b.energy) ? b.energy : implicit_energy(call, b, b.now, scratch, state);
    b.last_dt = 0;
    s.damped = damp(call, scratch, b);
    s.acceleration = {};
    const float h = static_cast<float>(call.dt);
    const float *x = b.step.new_velocity_x, *y = b.step.new_velocity_y, *z = b.step.new_velocity_z;
    for (uint32_t i = 0; i < e.count; ++i)
        s.inertia[i] = b.now[i].w > 0 ? Float4{h * x[i], h * y[i], h * z[i], 0} : Float4{};
    std::copy_n(s.inertia.begin(), e.count, s.displacement.begin());
    find_force(e);
    find_metric(e);
    relax(e);
    for (uint32_t i = 0; i < e.count; ++i) {
        const __m128 u = _mm_add_ps(at(s.displacement[i]), at(s.change[i]));
        put(b.next[i], _mm_add_ps(at(b.now[i]), u));
        b.step.new_velocity_x[i] = u[0] / h, b.step.new_velocity_y[i] = u[1] / h, b.step.new_velocity_z[i] = u[2] / h;
    }
}

void set_responses(const AdvanceCall& call, const AdvanceBody& b, const TissueScratch& scratch, AdvanceIsland& island) {
    const ImplicitScratch& s = scratch.touched[b.implicit_slot];
    const double per_h2 = 1 / (call.dt * call.dt);
    for_nodes_of(island, b, [&](uint32_t n, uint32_t i) {
        const ImplicitScratch::Symmetric& r = s.response[i];
        NodeResponse& response = island.nodes.response[n];
        response.column[0] = per_h2 * make_vec4(r[0], r[3], r[4]);
        response.column[1] = per_h2 * make_vec4(r[3], r[1], r[5]);
        response.column[2] = per_h2 * make_vec4(r[4], r[5], r[2]);
    });
}

void relax_touched_step(const AdvanceCall& call, AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                        AdvanceResult& result) {
    EulerStep e = bind(call, island, scratch, state, b, result);
    ImplicitScratch& s = e.s;
    find_force(e);
    relax(e);
    ++result.implicit_iterations;
    const double per_h = 1 / call.dt;
    for_nodes_of(island, b, [&](uint32_t n, uint32_t i) {
        if (!(b.now[i].w > 0)) return;
        const Vec4d push = per_h * island.nodes.response[n].impulse;
        Float4 force;
        put(force, _mm_add_ps(at(s.force[i]), _mm256_cvtpd_ps((__m256d)push)));
        s.change[i] = times(s.response[i], force);
    });
    show_nodes(e, island);
}

void smooth_touched_step(const AdvanceCall& call, AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                         AdvanceResult& result) {
    EulerStep e = bind(call, island, scratch, state, b, result);
    ImplicitScratch& s = e.s;
    const double per_h = 1 / call.dt;
    for_nodes_of(island, b, [&](uint32_t n, uint32_t i) {
        const Vec4d push = per_h * island.nodes.response[n].impulse;
        put(s.force[i], _mm_add_ps(at(s.force[i]), _mm256_cvtpd_ps((__m256d)push)));
    });
    solve(e);
    for (uint32_t i = 0; i < e.count; ++i) {
        const Float4 alone = times(s.response[i], s.force[i]);
        put(s.change[i], _mm_mul_ps(_mm_set1_ps(0.5f), _mm_add_ps(at(s.change[i]), at(alone))));
    }
    show_nodes(e, island);
}

bool accept_touched_step(const AdvanceCall& call, AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                         AdvanceResult& result) {
    EulerStep e = bind(call, island, scratch, state, b, result);
    ImplicitScratch& s = e.s;
    take_nodes(e, island);
    const double rounding = 0x1p-24 * call.inputs.meshes.info[call.inputs.bodies.mesh[b.body]].radius;
    const double usual = call.params.gravity.norm() * call.dt * call.dt;
    for (uint32_t i = 0; i < e.count; ++i) s.force[i] = times(s.metric[i], s.change[i]);
    const double left = accelerate(e, s.acceleration);
    return !(left > std::max(rounding, b.stepping.tolerance * std::max(longest(s.displacement, e.count), usual)));
}

bool finish_touched_step(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state,
                         AdvanceBody& b, AdvanceResult& result) {
    EulerStep e = bind(call, island, scratch, state, b, result);
    ImplicitScratch& s = e.s;
    take_nodes(e, island);
    for (uint32_t i = 0; i < e.count; ++i) put(s.displacement[i], _mm_add_ps(at(s.displacement[i]), at(s.change[i])));
    b.energy = finish(e);
    s.contact = 0;
    for_nodes_of(island, b, [&](uint32_t n, uint32_t i) {
        s.contact += dot(island.nodes.response[n].impulse, float_vec4(at(s.displacement[i]))) / call.dt;
    });
    s.work = b.energy - s.energy - s.damped - work_of_links(call, island, b) - s.contact;
    s.acceleration = {};
    return !(s.work > kRoundedEnergy * (std::abs(b.energy) + std::abs(s.contact)) + rounded_energy(e));
}

void account_touched_step(const AdvanceCall& call, const TissueScratch& scratch, AdvanceBody& b, AdvanceResult& result) {
    const ImplicitScratch& s = scratch.touched[b.implicit_slot];
    ++result.implicit_steps;
    if (!call.params.account_energy) return;
    if (b.damping_work) b.damping_work[0] += s.damped;
    if (!std::isfinite(s.work + s.contact)) return;  // a body about to be restored
    result.work_contact += s.contact;
    result.work_numeric += s.work;
}

void account_corrections(const AdvanceCall& call, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b, AdvanceResult& result) {
    const double energy = implicit_energy(call, b, b.next, scratch, state);
    if (std::isfinite(energy - b.energy)) result.work_push += energy - b.energy;
    b.energy = energy;
}

void step_backward_euler(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state,
                         AdvanceBody& b, AdvanceResult& result) {
    TROCAR_ASSERT(!b.touched);  // needs_leapfrog
    ImplicitScratch& s = scratch.implicit;
    make_room(s, b.particles.count);
    EulerStep e{call, island, scratch, state, b, result, s, factor_of(call, state.particles, b.body, scratch), b.particles.count};
    const double before = std::isfinite(b.energy) ? b.energy : implicit_energy(call, b, b.now, scratch, state);
    b.last_dt = 0;
    const double damped = damp(call, scratch, b);
    Acceleration acceleration;
    start(e, acceleration);
    double work = std::numeric_limits<double>::infinity(), grown = work;
    const auto measure = [&] {
        b.energy = finish(e);
        work = b.energy - before - damped - work_of_links(call, island, b);
        return work > kRoundedEnergy * std::abs(b.energy) + rounded_energy(e);
    };
    for (uint32_t round = 0; round < kMostRounds; ++round) {
        iterate(e, acceleration);
        if (!measure() || !(work < grown)) break;
        grown = work;
    }
    for (uint32_t halving = 0; halving < kMostHalvings && measure(); ++halving) {
        for (Float4& u : s.displacement) put(u, _mm_mul_ps(_mm_set1_ps(0.5f), at(u)));
        result.worst_implicit_residual = std::max(result.worst_implicit_residual, 1.0);
    }
    ++result.implicit_steps;
    if (!call.params.account_energy) return;
    if (b.damping_work) b.damping_work[0] += damped;
    if (std::isfinite(work)) result.work_numeric += work;  // otherwise a body about to be restored
}

}  // namespace trocar
