// Sixteen lanes as the kernels shared by both instruction sets see them: on top of lanes_avx512.hpp the
// arithmetic of one register.
#include "engine/lanes_avx512.hpp"
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
// value where `sign` is above zero, else 0
TROCAR_LANES V where_positive(V sign, V value) {
    return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(sign, _mm512_setzero_ps(), _CMP_GT_OQ), value);
}
// 1 where the lane's number is not its own row, else 0
TROCAR_LANES V is_other(const unsigned* number, unsigned row) {
    const __m512i own =
        _mm512_add_epi32(_mm512_set1_epi32(static_cast<int>(row)), _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0));
    return _mm512_maskz_mov_ps(_mm512_cmpneq_epi32_mask(_mm512_loadu_si512(number), own), _mm512_set1_ps(1.0f));
}

}  // namespace
}  // namespace trocar
