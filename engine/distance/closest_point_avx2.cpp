#include <immintrin.h>

#include "engine/distance/closest_point_kernels.hpp"
namespace trocar {

#define KERNEL static inline __attribute__((always_inline))

typedef __m256 V;
typedef __m256i Index;
typedef __m256 Mask;

KERNEL V all(float x) { return _mm256_set1_ps(x); }
KERNEL V fused_add(V a, V b, V c) { return _mm256_fmadd_ps(a, b, c); }
KERNEL V fused_subtract(V a, V b, V c) { return _mm256_fmsub_ps(a, b, c); }
KERNEL V fused_negative(V a, V b, V c) { return _mm256_fnmadd_ps(a, b, c); }
KERNEL V lesser(V a, V b) { return _mm256_min_ps(a, b); }
KERNEL V greater(V a, V b) { return _mm256_max_ps(a, b); }
KERNEL V root(V a) { return _mm256_sqrt_ps(a); }
KERNEL V where_not_positive(V s, V yes, V no) { return _mm256_blendv_ps(no, yes, _mm256_cmp_ps(s, all(0), _CMP_LE_OQ)); }
KERNEL Mask at_least(V a, V b) { return _mm256_cmp_ps(a, b, _CMP_GE_OQ); }
KERNEL Mask both(Mask a, Mask b) { return _mm256_and_ps(a, b); }
KERNEL V keep(Mask m, V a) { return _mm256_and_ps(m, a); }
KERNEL Index index_of(const uint8_t* corner, int half) {
    return _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i*)(corner + 8 * half)));
}
// entry i (0..15) of a table of 16 floats, per lane
KERNEL V look_up(const float* table, Index i) {
    const V low = _mm256_permutevar8x32_ps(_mm256_load_ps(table), i), high = _mm256_permutevar8x32_ps(_mm256_load_ps(table + 8), i);
    return _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32(i, 28)));
}
// as look_up, over 32 entries in two tables
KERNEL V look_up_wide(const float* first, const float* second, Index i) {
    return _mm256_blendv_ps(look_up(first, i), look_up(second, i), _mm256_castsi256_ps(_mm256_slli_epi32(i, 27)));
}

#include "engine/distance/closest_point_kernels.inl"

// same order of comparisons as the AVX-512 version; min and max are exact, so only NaN could differ
KERNEL float least(V low, V high) {
    const __m256 h = _mm256_min_ps(low, high);
    __m128 q = _mm_min_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
    q = _mm_min_ps(q, _mm_movehl_ps(q, q));
    q = _mm_min_ss(q, _mm_movehdup_ps(q));
    return _mm_cvtss_f32(q);
}
KERNEL float greatest(V low, V high) { return -least(all(0) - low, all(0) - high); }

static float distance(const Meshlet* m, const float* q, float limit, float* squared, uint32_t* mask) {
    const V low = squared_distance(m, 0, q), high = squared_distance(m, 1, q), l = all(limit);
    _mm256_store_ps(squared, low);
    _mm256_store_ps(squared + 8, high);
    *mask = (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(low, l, _CMP_LT_OQ)) |
            (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(high, l, _CMP_LT_OQ)) << 8;
    return least(low, high);
}

static void measure(const Meshlet* m, MeshletMeasure* out) {
    const PartMeasure first = measure_part(m, 0), second = measure_part(m, 1);
    out->slenderness = greatest(first.slenderness, second.slenderness);
    out->size_term = greatest(first.size, second.size);
    out->slender_lanes = ~((uint32_t)_mm256_movemask_ps(first.sound) | (uint32_t)_mm256_movemask_ps(second.sound) << 8) & 0xffffu;
    const float* rows[6] = {m->x, m->y, m->z, m->more_x, m->more_y, m->more_z};
    for (int k = 0; k < 3; ++k) {
        const float *row = rows[k], *more = m->wide ? rows[3 + k] : row;
        const V low = _mm256_load_ps(row), high = _mm256_load_ps(row + 8), low2 = _mm256_load_ps(more), high2 = _mm256_load_ps(more + 8);
        out->min[k] = least(lesser(low, low2), lesser(high, high2));
        out->max[k] = greatest(greater(low, low2), greater(high, high2));
    }
}

static void fill(Meshlet* m, const float* offset, const uint32_t* vertex, const float* centre, float scale) {
    float* rows[6] = {m->x, m->y, m->z, m->more_x, m->more_y, m->more_z};
    const __m128 c = _mm_loadu_ps(centre), s = _mm_set1_ps(scale);
    for (int i = 0; i < (m->wide ? 32 : 16); i += 4) {
        __m128 p0 = _mm_mul_ps(_mm_sub_ps(_mm_load_ps(offset + 4ul * vertex[i]), c), s);
        __m128 p1 = _mm_mul_ps(_mm_sub_ps(_mm_load_ps(offset + 4ul * vertex[i + 1]), c), s);
        __m128 p2 = _mm_mul_ps(_mm_sub_ps(_mm_load_ps(offset + 4ul * vertex[i + 2]), c), s);
        __m128 p3 = _mm_mul_ps(_mm_sub_ps(_mm_load_ps(offset + 4ul * vertex[i + 3]), c), s);
        _MM_TRANSPOSE4_PS(p0, p1, p2, p3);
        float** row = rows + (i < 16 ? 0 : 3);
        _mm_store_ps(row[0] + (i & 15), p0);
        _mm_store_ps(row[1] + (i & 15), p1);
        _mm_store_ps(row[2] + (i & 15), p2);
    }
}

const MeshletKernels kMeshletKernelsAvx2 = {distance, measure, fill};

}  // namespace trocar
