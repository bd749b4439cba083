#include "systems/body_boxes.hpp"

#include <immintrin.h>

#include "engine/geometry/contact_kernels.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

// Mean squared speed of the particles [first, end); those without a finite speed count as still.
double mean_squared_speed(const Particles& particles, uint32_t first, uint32_t end) {
    double sum = 0;
    for (uint32_t i = first; i < end; ++i) {
        const float x = particles.velocity_x[i], y = particles.velocity_y[i], z = particles.velocity_z[i];
        const float s = x * x + y * y + z * z;
        if (s <= std::numeric_limits<float>::max()) sum += static_cast<double>(s);
    }
    return end > first ? sum / (end - first) : 0;
}

// How far a body reaches in a period: the way of its fastest vertex, but no more than the root mean square way and half
// an edge, nor than three edges. Without these bounds one vertex that trembles, or a fine body that falls fast, makes
// everything near (190 ms and 5 s a pass); what comes faster is found inside and pushed out.
double reach_of(double fastest_way, double mean_way, double mean_edge) {
    return std::min({fastest_way, mean_way + 0.5 * mean_edge, 3 * mean_edge}) + 0.05 * mean_edge;
}

Vec3d to_vector(__m128 v) {
    alignas(16) float p[4];
    _mm_store_ps(p, v);
    return {p[0], p[1], p[2]};
}

// Box of the finite offsets, relative to the body's origin.
Box box_of_offsets(const Float4* offset, uint32_t count) {
    const __m128 inf = _mm_set1_ps(std::numeric_limits<float>::infinity());
    __m128 low = inf, high = _mm_sub_ps(_mm_setzero_ps(), inf);
    const auto take = [&](__m128 p) {
        low = _mm_min_ps(low, p);
        high = _mm_max_ps(high, p);
    };
    for (uint32_t i = 0; i < count; ++i) {
        const __m128 p = _mm_load_ps(&offset[i].x);
        const bool finite = (_mm_movemask_ps(_mm_cmpunord_ps(_mm_sub_ps(p, p), p)) & 7) == 0;
        if (finite) [[likely]] {
            take(p);
        }
    }
    return {to_vector(low), to_vector(high)};
}

// Largest squared speed of the particles [first, end); particles without a finite speed are skipped.
float fastest_squared(const Particles& particles, uint32_t first, uint32_t end) {
    const __m256 limit = _mm256_set1_ps(std::numeric_limits<float>::max());
    __m256 fastest = _mm256_setzero_ps();
    uint32_t i = first;
    for (; i + 8 <= end; i += 8) {
        const __m256 x = _mm256_loadu_ps(&particles.velocity_x[i]), y = _mm256_loadu_ps(&particles.velocity_y[i]),
                     z = _mm256_loadu_ps(&particles.velocity_z[i]);
        const __m256 s = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(x, x), _mm256_mul_ps(y, y)), _mm256_mul_ps(z, z));
        fastest = _mm256_max_ps(fastest, _mm256_and_ps(s, _mm256_cmp_ps(s, limit, _CMP_LE_OQ)));
    }
    alignas(32) float lane[8];
    _mm256_store_ps(lane, fastest);
    float best = *std::max_element(lane, lane + 8);
    for (; i < end; ++i) {
        const float x = particles.velocity_x[i], y = particles.velocity_y[i], z = particles.velocity_z[i];
        const float s = x * x + y * y + z * z;
        if (s <= std::numeric_limits<float>::max()) best = std::max(best, s);
    }
    return best;
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
        speed = std::sqrt(double(fastest_squared(s.particles, first, first + count)));
        mean_speed = std::sqrt(mean_squared_speed(s.particles, first, first + count));
    } else {
        box = box_of_rigid(s, body, count);
        speed = s.poses.velocity[body].norm() + s.poses.angular_velocity[body].norm() * info.radius;
        if (!std::isfinite(speed)) speed = 0;
        mean_speed = speed;
    }
    const double margin = reach_of(speed * period, mean_speed * period, info.mean_edge);
    const Vec3d reach = Vec3d::Constant(margin + 0.5 * s.bodies.thickness[body]);
    boxes.margin[body] = margin;
    const Box wide{s.poses.origin[body] + box.min - reach, s.poses.origin[body] + box.max + reach};
    boxes.box[body] = (wide.min.array() <= wide.max.array()).all() ? wide : Box{};
}

}  // namespace

void compute_body_boxes(double period, const Surfaces& surfaces, BodyBoxes& boxes) {
    const uint32_t count = uint32_t(surfaces.bodies.mesh.size());
    boxes.box.resize(count);
    boxes.margin.resize(count);
    parallel_for(count, 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t body = begin; body < end; ++body) compute_body_box(period, surfaces, body, boxes);
    });
}

}  // namespace trocar
