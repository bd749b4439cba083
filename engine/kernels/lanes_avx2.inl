// Eight lanes, half a slice, for the kernels shared by both instruction sets: adds the arithmetic of one
// register to lanes_avx2.hpp.
#include "engine/kernels/lanes_avx2.hpp"
namespace trocar {
namespace {

#define TROCAR_LANES inline __attribute__((always_inline))

using V = __m256;
constexpr unsigned kWidth = 8;

TROCAR_LANES V set(float v) { return _mm256_set1_ps(v); }
TROCAR_LANES V load(const float* p) { return _mm256_loadu_ps(p); }
TROCAR_LANES void keep_store(float* p, V v) { _mm256_storeu_ps(p, v); }
TROCAR_LANES V root(V v) { return _mm256_sqrt_ps(v); }
TROCAR_LANES V larger(V a, V b) { return _mm256_max_ps(a, b); }
TROCAR_LANES V smaller(V a, V b) { return _mm256_min_ps(a, b); }
TROCAR_LANES V multiply_add(V a, V b, V c) { return _mm256_fmadd_ps(a, b, c); }
TROCAR_LANES V multiply_subtract(V a, V b, V c) { return _mm256_fmsub_ps(a, b, c); }
// c - a b
TROCAR_LANES V subtract_product(V c, V a, V b) { return _mm256_fnmadd_ps(a, b, c); }
// value where `sign` is positive, else 0
TROCAR_LANES V where_positive(V sign, V value) { return _mm256_and_ps(_mm256_cmp_ps(sign, _mm256_setzero_ps(), _CMP_GT_OQ), value); }
// 1 where the lane's number is not its own index, else 0
TROCAR_LANES V is_other(const unsigned* number, unsigned index) {
    const __m256i own = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(index)), _mm256_set_epi32(7, 6, 5, 4, 3, 2, 1, 0));
    const __m256i given = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(number));
    return _mm256_andnot_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(given, own)), _mm256_set1_ps(1.0f));
}

// Numbers at index[0], index[1], ...
TROCAR_LANES V gather(const float* base, const unsigned* index) {
    return _mm256_i32gather_ps(base, _mm256_loadu_si256(reinterpret_cast<const __m256i*>(index)), 4);
}
// Whether one of sixteen numbers is not zero.
TROCAR_LANES bool any_in_slice(const float* p) {
    const V zero = _mm256_setzero_ps();
    return _mm256_movemask_ps(_mm256_or_ps(_mm256_cmp_ps(load(p), zero, _CMP_NEQ_UQ), _mm256_cmp_ps(load(p + 8), zero, _CMP_NEQ_UQ))) != 0;
}

// The same in doubles, half as many.
using D = __m256d;
constexpr unsigned kWide = 4;

TROCAR_LANES D set_wide(double v) { return _mm256_set1_pd(v); }
TROCAR_LANES D load_wide(const double* p) { return _mm256_loadu_pd(p); }
TROCAR_LANES void keep_store(double* p, D v) { _mm256_storeu_pd(p, v); }
TROCAR_LANES D widened(const float* p) { return _mm256_cvtps_pd(_mm_loadu_ps(p)); }
TROCAR_LANES D widened(V v, int half) { return _mm256_cvtps_pd(half ? _mm256_extractf128_ps(v, 1) : _mm256_castps256_ps128(v)); }
TROCAR_LANES V narrowed(D low, D high) { return _mm256_set_m128(_mm256_cvtpd_ps(high), _mm256_cvtpd_ps(low)); }
TROCAR_LANES D multiply_add(D a, D b, D c) { return _mm256_fmadd_pd(a, b, c); }
TROCAR_LANES D multiply_subtract(D a, D b, D c) { return _mm256_fmsub_pd(a, b, c); }
TROCAR_LANES D subtract_product(D c, D a, D b) { return _mm256_fnmadd_pd(a, b, c); }
TROCAR_LANES D where_positive(D sign, D value) { return _mm256_and_pd(_mm256_cmp_pd(sign, _mm256_setzero_pd(), _CMP_GT_OQ), value); }
// kWide elements of four floats as fields.
TROCAR_LANES void load4_wide(const float* rows, D (&field)[4]) {
    __m128 x = _mm_load_ps(rows), y = _mm_load_ps(rows + 4), z = _mm_load_ps(rows + 8), w = _mm_load_ps(rows + 12);
    _MM_TRANSPOSE4_PS(x, y, z, w);
    field[0] = _mm256_cvtps_pd(x), field[1] = _mm256_cvtps_pd(y), field[2] = _mm256_cvtps_pd(z), field[3] = _mm256_cvtps_pd(w);
}

}  // namespace
}  // namespace trocar
