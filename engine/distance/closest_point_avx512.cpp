#include <immintrin.h>

#include "engine/distance/closest_point_kernels.hpp"
namespace trocar {

// GCC 12 warns about the deliberately undefined registers inside its own intrinsics
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"
#define KERNEL static inline __attribute__((always_inline))

typedef __m512 V;
typedef __m512i Index;
typedef __mmask16 Mask;

KERNEL V all(float x) { return _mm512_set1_ps(x); }
KERNEL V fused_add(V a, V b, V c) { return _mm512_fmadd_ps(a, b, c); }
KERNEL V fused_subtract(V a, V b, V c) { return _mm512_fmsub_ps(a, b, c); }
KERNEL V fused_negative(V a, V b, V c) { return _mm512_fnmadd_ps(a, b, c); }
KERNEL V lesser(V a, V b) { return _mm512_min_ps(a, b); }
KERNEL V greater(V a, V b) { return _mm512_max_ps(a, b); }
KERNEL V root(V a) { return _mm512_sqrt_ps(a); }
KERNEL V where_not_positive(V s, V yes, V no) { return _mm512_mask_blend_ps(_mm512_cmp_ps_mask(s, all(0), _CMP_LE_OQ), no, yes); }
KERNEL Mask at_least(V a, V b) { return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ); }
KERNEL Mask both(Mask a, Mask b) { return a & b; }
KERNEL V keep(Mask m, V a) { return _mm512_maskz_mov_ps(m, a); }
KERNEL Index index_of(const uint8_t* corner, int) { return _mm512_cvtepu8_epi32(_mm_load_si128((const __m128i*)corner)); }
KERNEL V look_up(const float* table, Index i) { return _mm512_permutexvar_ps(i, _mm512_load_ps(table)); }
KERNEL V look_up_wide(const float* first, const float* second, Index i) {
    return _mm512_permutex2var_ps(_mm512_load_ps(first), i, _mm512_load_ps(second));
}

#include "engine/distance/closest_point_kernels.inl"

// same order of comparisons as the AVX2 version; min and max are exact, so only NaN could differ
KERNEL float least(V v) {
    const __m256 h = _mm256_min_ps(_mm512_castps512_ps256(v), _mm512_extractf32x8_ps(v, 1));
    __m128 q = _mm_min_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
    q = _mm_min_ps(q, _mm_movehl_ps(q, q));
    q = _mm_min_ss(q, _mm_movehdup_ps(q));
    return _mm_cvtss_f32(q);
}
KERNEL float greatest(V v) { return -least(all(0) - v); }

static float distance(const Meshlet* m, const float* q, float limit, float* squared, uint32_t* mask) {
    const V d = squared_distance(m, 0, q);
    _mm512_store_ps(squared, d);
    *mask = (uint32_t)_mm512_cmp_ps_mask(d, all(limit), _CMP_LT_OQ);
    return least(d);
}

static void measure(const Meshlet* m, MeshletMeasure* out) {
    const PartMeasure part = measure_part(m, 0);
    out->slenderness = greatest(part.slenderness);
    out->size_term = greatest(part.size);
    out->slender_lanes = (uint32_t)(uint16_t)~part.sound;
    const float* rows[6] = {m->x, m->y, m->z, m->more_x, m->more_y, m->more_z};
    for (int k = 0; k < 3; ++k) {
        const V row = _mm512_load_ps(rows[k]), more = m->wide ? _mm512_load_ps(rows[3 + k]) : row;
        out->min[k] = least(lesser(row, more));
        out->max[k] = greatest(greater(row, more));
    }
}

static void fill(Meshlet* m, const float* offset, const uint32_t* vertex, const float* centre, float scale) {
    kMeshletKernelsAvx2.fill(m, offset, vertex, centre, scale);
}

const MeshletKernels kMeshletKernelsAvx512 = {distance, measure, fill};

}  // namespace trocar
