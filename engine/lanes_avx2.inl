// Eight lanes, half a slice, as the kernels shared by both instruction sets see them: on top of lanes_avx2.hpp the
// arithmetic of one register.
#include "engine/lanes_avx2.hpp"
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
// value where `sign` is above zero, else 0
TROCAR_LANES V where_positive(V sign, V value) { return _mm256_and_ps(_mm256_cmp_ps(sign, _mm256_setzero_ps(), _CMP_GT_OQ), value); }
// 1 where the lane's number is not its own row, else 0
TROCAR_LANES V is_other(const unsigned* number, unsigned row) {
    const __m256i own = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(row)), _mm256_set_epi32(7, 6, 5, 4, 3, 2, 1, 0));
    const __m256i given = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(number));
    return _mm256_andnot_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(given, own)), _mm256_set1_ps(1.0f));
}

}  // namespace
}  // namespace trocar
