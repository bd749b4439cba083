#include "systems/detect/broad/body_boxes.hpp"

#include <immintrin.h>

#include <algorithm>

#include "engine/contact/displacement_bound.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

Vec3d to_vector(__m128 v) {
    alignas(16) float p[4];
    _mm_store_ps(p, v);
    return {p[0], p[1], p[2]};
}

// Box of the finite offsets, relative to the body's origin; two vertices at a time, in two registers.
Box box_of_offsets(const Float4* offset, uint32_t count) {
    const __m256 inf = _mm256_set1_ps(std::numeric_limits<float>::infinity()), none = _mm256_sub_ps(_mm256_setzero_ps(), inf);
    __m256 low[2] = {inf, inf}, high[2] = {none, none};
    const auto take = [&](__m256 p, int axis) {
        // a vertex with a non-finite coordinate is ignored entirely; the fourth lane is not a coordinate
        const __m256 lost = _mm256_cmp_ps(_mm256_sub_ps(p, p), p, _CMP_UNORD_Q);
        if ((_mm256_movemask_ps(lost) & 0x77) != 0) [[unlikely]] {
            const int mask = _mm256_movemask_ps(lost);
            const __m256 keep =
                _mm256_castsi256_ps(_mm256_set_m128i(_mm_set1_epi32(mask & 0x70 ? 0 : -1), _mm_set1_epi32(mask & 7 ? 0 : -1)));
            low[axis] = _mm256_min_ps(low[axis], _mm256_blendv_ps(inf, p, keep));
            high[axis] = _mm256_max_ps(high[axis], _mm256_blendv_ps(none, p, keep));
            return;
        }
        low[axis] = _mm256_min_ps(low[axis], p);
        high[axis] = _mm256_max_ps(high[axis], p);
    };
    uint32_t i = 0;
    for (; i + 4 <= count; i += 4) {
        take(_mm256_loadu_ps(&offset[i].x), 0);
        take(_mm256_loadu_ps(&offset[i + 2].x), 1);
    }
    for (; i < count; ++i) {
        const __m128 p = _mm_load_ps(&offset[i].x);
        take(_mm256_set_m128(p, p), 0);
    }
    const __m256 l = _mm256_min_ps(low[0], low[1]), h = _mm256_max_ps(high[0], high[1]);
    return {to_vector(_mm_min_ps(_mm256_castps256_ps128(l), _mm256_extractf128_ps(l, 1))),
            to_vector(_mm_max_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1)))};
}

struct Speeds {
    double largest = 0, mean = 0;  // (m/s)^2, of the squared speeds
};

// Of the particles [first, end); a non-finite speed counts as zero. Summed in eight lanes, in the same order
// for every instruction set and number of threads.
Speeds squared_speeds(const Particles& particles, uint32_t first, uint32_t end) {
    const __m256 limit = _mm256_set1_ps(std::numeric_limits<float>::max());
    __m256 fastest = _mm256_setzero_ps();
    __m256d low = _mm256_setzero_pd(), high = _mm256_setzero_pd();
    const auto take = [&](__m256 x, __m256 y, __m256 z) {
        __m256 s = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(x, x), _mm256_mul_ps(y, y)), _mm256_mul_ps(z, z));
        s = _mm256_and_ps(s, _mm256_cmp_ps(s, limit, _CMP_LE_OQ));
        fastest = _mm256_max_ps(fastest, s);
        low = _mm256_add_pd(low, _mm256_cvtps_pd(_mm256_castps256_ps128(s)));
        high = _mm256_add_pd(high, _mm256_cvtps_pd(_mm256_extractf128_ps(s, 1)));
    };
    uint32_t i = first;
    for (; i + 8 <= end; i += 8) {
        take(_mm256_loadu_ps(&particles.velocity_x[i]), _mm256_loadu_ps(&particles.velocity_y[i]),
             _mm256_loadu_ps(&particles.velocity_z[i]));
    }
    alignas(32) float rest[3][8] = {};
    for (uint32_t k = 0; i < end; ++i, ++k) {
        rest[0][k] = particles.velocity_x[i];
        rest[1][k] = particles.velocity_y[i];
        rest[2][k] = particles.velocity_z[i];
    }
    take(_mm256_load_ps(rest[0]), _mm256_load_ps(rest[1]), _mm256_load_ps(rest[2]));
    alignas(32) float lane[8];
    alignas(32) double sum[4];
    _mm256_store_ps(lane, fastest);
    _mm256_store_pd(sum, _mm256_add_pd(low, high));
    const double total = ((sum[0] + sum[1]) + sum[2]) + sum[3];
    return {double(*std::max_element(lane, lane + 8)), end > first ? total / (end - first) : 0};
}

Box box_of_rigid(const Surfaces& surfaces, uint32_t body, uint32_t count) {
    const BodyPoints points(surfaces, body, surfaces.poses.origin[body]);
    const __m256d inf = _mm256_set1_pd(std::numeric_limits<double>::infinity());
    __m256d low = inf, high = _mm256_sub_pd(_mm256_setzero_pd(), inf);
    for (uint32_t i = 0; i < count; ++i) {
        const __m256d p = points(i);
        if (!is_finite(p)) continue;
        low = _mm256_min_pd(low, p);
        high = _mm256_max_pd(high, p);
    }
    alignas(32) double a[4], b[4];
    _mm256_store_pd(a, low);
    _mm256_store_pd(b, high);
    return {Vec3d(a[0], a[1], a[2]), Vec3d(b[0], b[1], b[2])};
}

void compute_body_box(double period, const Surfaces& s, uint32_t body, BodyBoxes& boxes) {
    const MeshInfo& info = s.meshes.info[s.bodies.mesh[body]];
    const uint32_t count = info.vertices.count;
    double speed = 0, mean_speed = 0;  // m/s
    Box box;
    if (is_deformable(s.bodies, body)) {
        const uint32_t first = s.bodies.particles[body].first;
        box = box_of_offsets(s.particles.offset.data() + first, count);
        const Speeds squared = squared_speeds(s.particles, first, first + count);
        speed = std::sqrt(squared.largest);
        mean_speed = boxes.speed[body] = std::sqrt(squared.mean);
    } else {
        box = box_of_rigid(s, body, count);
        speed = boxes.speed[body] + s.poses.angular_velocity[body].norm() * info.radius;
        if (!std::isfinite(speed)) speed = 0;
        mean_speed = speed;
    }
    // a sheet that touches itself keeps half its thickness from others: find_self_contacts
    const double own = self_contact_of(s.bodies, body) > 0 && info.admission == Admission::kSheet ? 0.5 * s.bodies.thickness[body] : 0;
    const double margin = displacement_bound(speed * period, mean_speed * period, info.mean_edge) + own;
    const Vec3d extent = Vec3d::Constant(margin + 0.5 * s.bodies.thickness[body]);
    boxes.margin[body] = margin;
    const Box wide{s.poses.origin[body] + box.min - extent, s.poses.origin[body] + box.max + extent};
    boxes.box[body] = (wide.min.array() <= wide.max.array()).all() ? wide : Box{};
}

// Bounds on the bodies' own speeds in the period.
void find_speeds(const BodyBoxesInputs& in, std::vector<double>& speed) {
    const Surfaces& s = in.surfaces;
    speed.resize(s.bodies.mesh.size());
    for (uint32_t body = 0; body < speed.size(); ++body) speed[body] = is_deformable(s.bodies, body) ? 0.0 : s.poses.velocity[body].norm();
    for (size_t t = 0; t < in.tools.size(); ++t) speed[in.tools[t].body] += in.devices->start(t).velocity.norm();
    for (const RigidMass& free : s.bodies.rigid_mass) speed[free.body] += in.period * in.gravity.norm();
}

void empty_boxes_of_absent(const BodyBoxesInputs& in, BodyBoxes& boxes) {
    for (uint32_t body = 0; in.spawning && body < in.spawning->away.size(); ++body)
        if (is_away(*in.spawning, body)) boxes.box[body] = {};
    for (uint32_t body = 0; in.node_state && body < in.node_state->off.size(); ++body)
        if (is_off(*in.node_state, body)) boxes.box[body] = {};
}

}  // namespace

uint32_t compute_body_boxes(const BodyBoxesInputs& in, BodyBoxes& boxes, const SleepingBodies& sleeping_bodies) {
    const uint32_t count = uint32_t(in.surfaces.bodies.mesh.size());
    if (boxes.box.size() != count) std::fill(sleeping_bodies.seen.begin(), sleeping_bodies.seen.end(), 0);
    boxes.box.resize(count);
    boxes.margin.resize(count);
    find_speeds(in, boxes.speed);
    parallel_for(count, std::clamp(count / 64, 1u, 32u), [&](uint32_t begin, uint32_t end) {
        for (uint32_t body = begin; body < end; ++body)
            if (!was_seen(sleeping_bodies, body)) compute_body_box(in.period, in.surfaces, body, boxes);
    });
    empty_boxes_of_absent(in, boxes);
    uint32_t unswept = 0;
    for (uint32_t body = 0; body < count; ++body) {
        const Motion motion = in.surfaces.bodies.motion[body];
        const double spin = motion == Motion::kKinematic ? in.surfaces.poses.angular_velocity[body].norm() : 0;
        const double speed = boxes.speed[body] + spin * in.surfaces.meshes.info[in.surfaces.bodies.mesh[body]].radius;
        unswept += (motion == Motion::kDeformable || motion == Motion::kKinematic) && speed * in.period > boxes.margin[body];
    }
    return unswept;
}

}  // namespace trocar
