#pragma once
#include <vector>

#include "engine/geometry/four_points.hpp"
#include "engine/mesh/contact_kernels.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Rest positions of four consecutive vertices, axis by axis, m.
inline FourPoints load_four(const Vec3d* rest) {
    const double* p = rest->data();
    const __m256d a = _mm256_loadu_pd(p), b = _mm256_loadu_pd(p + 4), c = _mm256_loadu_pd(p + 8);
    const __m256d xy = _mm256_blend_pd(a, b, 12), zx = _mm256_permute2f128_pd(a, c, 0x21), yz = _mm256_blend_pd(b, c, 12);
    return {(Vec4d)_mm256_shuffle_pd(xy, zx, 10), (Vec4d)_mm256_shuffle_pd(xy, yz, 5), (Vec4d)_mm256_shuffle_pd(zx, yz, 10)};
}

// Coordinates of a body's vertices along a direction, from `base`: m times the direction's length.
inline void project_vertices(const Surfaces& s, uint32_t body, const Vec3d& base, const Vec3d& direction, std::vector<double>& along) {
    const uint32_t count = s.meshes.info[s.bodies.mesh[body]].vertices.count;
    along.resize(count);
    uint32_t v = 0;
    if (is_deformable(s.bodies, body)) {
        const Float4* offset = s.particles.offset.data() + s.bodies.particles[body].first;
        const Vec3d shift = s.poses.origin[body] - base;
        for (; v + 4 <= count; v += 4) {
            const auto load = [&](uint32_t k) { return _mm_load_ps(&offset[v + k].x); };
            __m128 x = load(0), y = load(1), z = load(2), w = load(3);
            _MM_TRANSPOSE4_PS(x, y, z, w);
            const auto part = [](__m128 p, double from, double factor) { return ((Vec4d)_mm256_cvtps_pd(p) + from) * factor; };
            const Vec4d sum = (part(x, shift.x(), direction.x()) + part(y, shift.y(), direction.y())) + part(z, shift.z(), direction.z());
            _mm256_storeu_pd(&along[v], (__m256d)sum);
        }
    }
    const BodyPoints points(s, body, base);
    const __m256d factor = _mm256_setr_pd(direction.x(), direction.y(), direction.z(), 0);
    if (!is_deformable(s.bodies, body)) {
        // in the body's frame: rotating one direction costs less than rotating every vertex
        const Vec3d* rest = s.meshes.position.data() + s.meshes.info[s.bodies.mesh[body]].vertices.first;
        const Vec3d turned = rotate_back(s.poses.orientation[body], direction);
        const double shift = (s.poses.origin[body] - base).dot(direction);
        for (; v + 4 <= count; v += 4) {
            const FourPoints p = load_four(rest + v);
            _mm256_storeu_pd(&along[v], (__m256d)(((p.x * turned.x() + p.y * turned.y()) + p.z * turned.z()) + shift));
        }
    }
    for (; v < count; ++v) {
        const Vec4d part = (Vec4d)_mm256_mul_pd(points(v), factor);
        along[v] = (part[0] + part[1]) + part[2];
    }
}

// Candidate separating axis of two bodies, not normalised: from centre to centre; for a static body, often a
// wall or floor, perpendicular to the side that is penetrated least.
inline Vec3d direction_between(const Surfaces& s, const BodyBoxes& boxes, uint32_t a, uint32_t b) {
    const Box &box_a = boxes.box[a], &box_b = boxes.box[b];
    const auto is_static = [&](uint32_t body) { return s.bodies.motion[body] == Motion::kStatic; };
    if (!is_static(a) && !is_static(b)) return 0.5 * (box_b.min + box_b.max - box_a.min - box_a.max);
    const Vec3d after = box_b.min - box_a.max, before = box_a.min - box_b.max;
    int axis = 0;
    after.cwiseMax(before).maxCoeff(&axis);
    return after[axis] > before[axis] ? Vec3d(Vec3d::Unit(axis)) : Vec3d(-Vec3d::Unit(axis));
}

}  // namespace trocar
#pragma GCC diagnostic pop
