#pragma once
#include <vector>

#include "engine/geometry/contact_kernels.hpp"
#include "engine/geometry/four_points.hpp"
namespace trocar {

// Coordinates of a body's vertices along a direction, from `base`: m times the direction's length.
inline void project_vertices(const Surfaces& s, uint32_t body, const Vec3d& base, const Vec3d& way, std::vector<double>& along) {
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
            const Vec4d sum = (part(x, shift.x(), way.x()) + part(y, shift.y(), way.y())) + part(z, shift.z(), way.z());
            _mm256_storeu_pd(&along[v], (__m256d)sum);
        }
    }
    const BodyPoints points(s, body, base);
    const __m256d factor = _mm256_setr_pd(way.x(), way.y(), way.z(), 0);
    for (; v < count; ++v) {
        const Vec4d part = (Vec4d)_mm256_mul_pd(points(v), factor);
        along[v] = (part[0] + part[1]) + part[2];
    }
}

}  // namespace trocar
