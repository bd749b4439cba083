#pragma once
#include <immintrin.h>

#include "components/math.hpp"
// Functions with register arguments are all inlined, so the ABI difference without AVX is irrelevant.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Three doubles in one vector register; the fourth is zero. Compilers keep Vec3d in three scalar registers,
// which makes contact constraints three times as slow.
typedef double Vec4d __attribute__((vector_size(32)));

inline Vec4d make_vec4(double x, double y, double z) { return Vec4d{x, y, z, 0}; }
inline Vec4d load_vec4(const double* p) { return (Vec4d)_mm256_maskload_pd(p, _mm256_setr_epi64x(-1, -1, -1, 0)); }
inline Vec4d to_vec4(const Vec3d& v) { return load_vec4(v.data()); }
inline Vec3d to_vec3(Vec4d v) { return {v[0], v[1], v[2]}; }
// Three floats; the fourth is arbitrary.
inline Vec4d float_vec4(__m128 p) { return (Vec4d)_mm256_cvtps_pd(_mm_blend_ps(p, _mm_setzero_ps(), 8)); }

inline double dot(Vec4d a, Vec4d b) {
    const __m256d product = (__m256d)(a * b);
    const __m128d xy = _mm256_castpd256_pd128(product);
    return xy[0] + xy[1] + _mm256_extractf128_pd(product, 1)[0];
}
inline double norm2(Vec4d a) { return dot(a, a); }
inline Vec4d cross(Vec4d a, Vec4d b) {
    const auto yzx = [](Vec4d v) { return (Vec4d)_mm256_permute4x64_pd((__m256d)v, 0b11001001); };
    return yzx(a * yzx(b) - yzx(a) * b);
}

}  // namespace trocar
#pragma GCC diagnostic pop
