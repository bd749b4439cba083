// Sixteen lanes for the kernels shared by both instruction sets: adds the arithmetic of one register to
// lanes_avx512.hpp.
#include "engine/kernels/lanes_avx512.hpp"
namespace trocar {
namespace {

#define TROCAR_LANES inline __attribute__((always_inline))

using V = __m512;
constexpr unsigned kWidth = 16;

TROCAR_LANES V set(float v) { return _mm512_set1_ps(v); }
TROCAR_LANES V load(const float* p) { return _mm512_loadu_ps(p); }
TROCAR_LANES void keep_store(float* p, V v) { _mm512_storeu_ps(p, v); }
TROCAR_LANES V root(V v) { return _mm512_sqrt_ps(v); }
TROCAR_LANES V larger(V a, V b) { return _mm512_max_ps(a, b); }
TROCAR_LANES V smaller(V a, V b) { return _mm512_min_ps(a, b); }
TROCAR_LANES V multiply_add(V a, V b, V c) { return _mm512_fmadd_ps(a, b, c); }
TROCAR_LANES V multiply_subtract(V a, V b, V c) { return _mm512_fmsub_ps(a, b, c); }
// c - a b
TROCAR_LANES V subtract_product(V c, V a, V b) { return _mm512_fnmadd_ps(a, b, c); }
// value where `sign` is positive, else 0
TROCAR_LANES V where_positive(V sign, V value) {
    return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(sign, _mm512_setzero_ps(), _CMP_GT_OQ), value);
}
// 1 where the lane's number is not its own index, else 0
TROCAR_LANES V is_other(const unsigned* number, unsigned index) {
    const __m512i own = _mm512_add_epi32(_mm512_set1_epi32(static_cast<int>(index)),
                                         _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0));
    return _mm512_maskz_mov_ps(_mm512_cmpneq_epi32_mask(_mm512_loadu_si512(number), own), _mm512_set1_ps(1.0f));
}

// Numbers at index[0], index[1], ...
TROCAR_LANES V gather(const float* base, const unsigned* index) { return _mm512_i32gather_ps(_mm512_loadu_si512(index), base, 4); }
// Whether one of sixteen numbers is not zero.
TROCAR_LANES bool any_in_slice(const float* p) { return _mm512_cmp_ps_mask(load(p), _mm512_setzero_ps(), _CMP_NEQ_UQ) != 0; }

// The same in doubles, half as many.
using D = __m512d;
constexpr unsigned kWide = 8;

TROCAR_LANES D set_wide(double v) { return _mm512_set1_pd(v); }
TROCAR_LANES D load_wide(const double* p) { return _mm512_loadu_pd(p); }
TROCAR_LANES void keep_store(double* p, D v) { _mm512_storeu_pd(p, v); }
TROCAR_LANES D widened(const float* p) { return _mm512_cvtps_pd(_mm256_loadu_ps(p)); }
TROCAR_LANES D widened(V v, int half) { return _mm512_cvtps_pd(half ? _mm512_extractf32x8_ps(v, 1) : _mm512_castps512_ps256(v)); }
TROCAR_LANES V narrowed(D low, D high) {
    return _mm512_insertf32x8(_mm512_castps256_ps512(_mm512_cvtpd_ps(low)), _mm512_cvtpd_ps(high), 1);
}
TROCAR_LANES D multiply_add(D a, D b, D c) { return _mm512_fmadd_pd(a, b, c); }
TROCAR_LANES D multiply_subtract(D a, D b, D c) { return _mm512_fmsub_pd(a, b, c); }
TROCAR_LANES D subtract_product(D c, D a, D b) { return _mm512_fnmadd_pd(a, b, c); }
TROCAR_LANES D where_positive(D sign, D value) {
    return _mm512_maskz_mov_pd(_mm512_cmp_pd_mask(sign, _mm512_setzero_pd(), _CMP_GT_OQ), value);
}
// kWide elements of four floats as fields.
TROCAR_LANES void load4_wide(const float* rows, D (&field)[4]) {
    const auto two = [&](int i) __attribute__((always_inline)) {
        return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(rows + 4 * i)), _mm_load_ps(rows + 16 + 4 * i), 1);
    };
    const __m256 a = two(0), b = two(1), c = two(2), d = two(3);
    const __m256 ab_low = _mm256_unpacklo_ps(a, b), ab_high = _mm256_unpackhi_ps(a, b);
    const __m256 cd_low = _mm256_unpacklo_ps(c, d), cd_high = _mm256_unpackhi_ps(c, d);
    field[0] = _mm512_cvtps_pd(_mm256_shuffle_ps(ab_low, cd_low, 0x44)),
    field[1] = _mm512_cvtps_pd(_mm256_shuffle_ps(ab_low, cd_low, 0xEE));
    field[2] = _mm512_cvtps_pd(_mm256_shuffle_ps(ab_high, cd_high, 0x44)),
    field[3] = _mm512_cvtps_pd(_mm256_shuffle_ps(ab_high, cd_high, 0xEE));
}

}  // namespace
}  // namespace trocar
