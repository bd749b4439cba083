#pragma once
#include <immintrin.h>

#include "components/particles.hpp"
#include "engine/geometry/vec4.hpp"
namespace trocar {

// Sum of the finite velocities of some particles, added in their order, m/s; and their number.
struct VelocitySum {
    Vec3d sum = Vec3d::Zero();
    uint32_t count = 0;
};
inline VelocitySum sum_velocities(const Particles& particles, uint32_t first, uint32_t count) {
    const float *x = particles.velocity_x.data() + first, *y = particles.velocity_y.data() + first,
                *z = particles.velocity_z.data() + first;
    Vec4d sum = {};
    uint32_t finite = 0;
    const auto add = [&](__m128 velocity) {
        const Vec4d v = (Vec4d)_mm256_cvtps_pd(velocity);
        if (_mm256_movemask_pd(_mm256_cmp_pd((__m256d)(v - v), (__m256d)v, _CMP_UNORD_Q)) != 0) return;
        sum += v;
        ++finite;
    };
    uint32_t i = 0;
    for (; i + 4 <= count; i += 4) {
        __m128 a = _mm_loadu_ps(x + i), b = _mm_loadu_ps(y + i), c = _mm_loadu_ps(z + i), d = _mm_setzero_ps();
        _MM_TRANSPOSE4_PS(a, b, c, d);
        add(a), add(b), add(c), add(d);
    }
    for (; i < count; ++i) add(_mm_setr_ps(x[i], y[i], z[i], 0));
    return {to_vec3(sum), finite};
}

}  // namespace trocar
