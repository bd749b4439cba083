#include <immintrin.h>

#include "engine/distance/closest_point_kernels.hpp"
namespace trocar {

namespace {
struct Lanes3 {
    __m256 x, y, z;
};
}  // namespace

// entry i (0..15) of a table of 16 floats, per lane
static inline __attribute__((always_inline)) __m256 look_up(const float* table, __m256i i) {
    const __m256 low = _mm256_permutevar8x32_ps(_mm256_load_ps(table), i);
    const __m256 high = _mm256_permutevar8x32_ps(_mm256_load_ps(table + 8), i);
    return _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32(i, 28)));
}
// as look_up, over 32 entries in two tables
static inline __attribute__((always_inline)) __m256 look_up_wide(const float* first, const float* second, __m256i i) {
    return _mm256_blendv_ps(look_up(first, i), look_up(second, i), _mm256_castsi256_ps(_mm256_slli_epi32(i, 27)));
}
static inline __attribute__((always_inline)) Lanes3 corner(const Meshlet* m, int k, int half) {
    const __m256i i = _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i*)(m->corner[k] + 8 * half)));
    Lanes3 r;
    if (__builtin_expect(!m->wide, 1)) {
        r.x = look_up(m->x, i);
        r.y = look_up(m->y, i);
        r.z = look_up(m->z, i);
    } else {
        r.x = look_up_wide(m->x, m->more_x, i);
        r.y = look_up_wide(m->y, m->more_y, i);
        r.z = look_up_wide(m->z, m->more_z, i);
    }
    return r;
}
static inline __attribute__((always_inline)) Lanes3 subtract(Lanes3 a, Lanes3 b) {
    Lanes3 r;
    r.x = _mm256_sub_ps(a.x, b.x);
    r.y = _mm256_sub_ps(a.y, b.y);
    r.z = _mm256_sub_ps(a.z, b.z);
    return r;
}
static inline __attribute__((always_inline)) __m256 dot(Lanes3 a, Lanes3 b) {
    return _mm256_fmadd_ps(a.z, b.z, _mm256_fmadd_ps(a.y, b.y, _mm256_mul_ps(a.x, b.x)));
}
static inline __attribute__((always_inline)) Lanes3 cross(Lanes3 a, Lanes3 b) {
    Lanes3 r;
    r.x = _mm256_fmsub_ps(a.y, b.z, _mm256_mul_ps(a.z, b.y));
    r.y = _mm256_fmsub_ps(a.z, b.x, _mm256_mul_ps(a.x, b.z));
    r.z = _mm256_fmsub_ps(a.x, b.y, _mm256_mul_ps(a.y, b.x));
    return r;
}
// squared distance of the origin to the segment from r along e
static inline __attribute__((always_inline)) __m256 to_segment(Lanes3 r, Lanes3 e) {
    const __m256 tiny = _mm256_set1_ps(1e-36f);
    __m256 t = _mm256_div_ps(dot(r, e), _mm256_max_ps(dot(e, e), tiny));
    t = _mm256_max_ps(_mm256_min_ps(t, _mm256_setzero_ps()), _mm256_set1_ps(-1.0f));
    Lanes3 q;
    q.x = _mm256_fnmadd_ps(t, e.x, r.x);
    q.y = _mm256_fnmadd_ps(t, e.y, r.y);
    q.z = _mm256_fnmadd_ps(t, e.z, r.z);
    return dot(q, q);
}
// same order of comparisons as the AVX-512 version; min and max are exact, so only NaN could differ
static inline __attribute__((always_inline)) float least(__m256 low, __m256 high) {
    const __m256 h = _mm256_min_ps(low, high);
    __m128 q = _mm_min_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
    q = _mm_min_ps(q, _mm_movehl_ps(q, q));
    q = _mm_min_ss(q, _mm_movehdup_ps(q));
    return _mm_cvtss_f32(q);
}
static inline __attribute__((always_inline)) float greatest(__m256 low, __m256 high) {
    const __m256 h = _mm256_max_ps(low, high);
    __m128 q = _mm_max_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
    q = _mm_max_ps(q, _mm_movehl_ps(q, q));
    q = _mm_max_ss(q, _mm_movehdup_ps(q));
    return _mm_cvtss_f32(q);
}

static inline __attribute__((always_inline)) __m256 half_distance(const Meshlet* m, int half, const float* q) {
    const Lanes3 a0 = corner(m, 0, half), b0 = corner(m, 1, half), c0 = corner(m, 2, half);
    // edges from the vertices, not from the differences to q: their relative error must not grow with the distance
    const Lanes3 ab = subtract(b0, a0), bc = subtract(c0, b0), ca = subtract(a0, c0);
    Lanes3 p;
    p.x = _mm256_set1_ps(q[0]);
    p.y = _mm256_set1_ps(q[1]);
    p.z = _mm256_set1_ps(q[2]);
    const Lanes3 a = subtract(a0, p), b = subtract(b0, p), c = subtract(c0, p);
    const __m256 d = _mm256_min_ps(to_segment(a, ab), _mm256_min_ps(to_segment(b, bc), to_segment(c, ca)));
    const Lanes3 n = cross(ca, ab);
    const __m256 s =
        _mm256_max_ps(dot(cross(n, ab), a), _mm256_max_ps(dot(cross(n, bc), b), dot(cross(n, ca), c)));  // <= 0: above the face
    const __m256 h = dot(n, a);
    const __m256 face = _mm256_mul_ps(h, _mm256_div_ps(h, _mm256_max_ps(dot(n, n), _mm256_set1_ps(1e-36f))));
    const __m256 above = _mm256_cmp_ps(s, _mm256_setzero_ps(), _CMP_LE_OQ);
    return _mm256_blendv_ps(d, _mm256_min_ps(face, d), above);
}

static float distance(const Meshlet* m, const float* q, float limit, float* squared, uint32_t* mask) {
    const __m256 low = half_distance(m, 0, q), high = half_distance(m, 1, q);
    _mm256_store_ps(squared, low);
    _mm256_store_ps(squared + 8, high);
    const __m256 l = _mm256_set1_ps(limit);
    *mask = (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(low, l, _CMP_LT_OQ)) |
            (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps(high, l, _CMP_LT_OQ)) << 8;
    return least(low, high);
}

struct HalfMeasure {
    __m256 size, slenderness, sound;
};

static inline __attribute__((always_inline)) HalfMeasure half_measure(const Meshlet* m, int half) {
    const Lanes3 a = corner(m, 0, half), b = corner(m, 1, half), c = corner(m, 2, half);
    const Lanes3 ab = subtract(b, a), bc = subtract(c, b), ca = subtract(a, c);
    const Lanes3 n = cross(ca, ab);
    const __m256 n2 = dot(n, n);
    const __m256 l2 = _mm256_max_ps(dot(ab, ab), _mm256_max_ps(dot(bc, bc), dot(ca, ca)));
    HalfMeasure r;
    r.sound = _mm256_and_ps(_mm256_cmp_ps(n2, _mm256_mul_ps(_mm256_set1_ps(1e-4f), _mm256_mul_ps(l2, l2)), _CMP_GE_OQ),
                            _mm256_cmp_ps(l2, _mm256_set1_ps(1e-14f), _CMP_GE_OQ));
    r.slenderness = _mm256_and_ps(r.sound, _mm256_div_ps(l2, _mm256_sqrt_ps(n2)));
    r.size = _mm256_and_ps(r.sound,
                           _mm256_mul_ps(_mm256_sqrt_ps(l2), _mm256_fmadd_ps(r.slenderness, _mm256_set1_ps(24.0f), _mm256_set1_ps(16.0f))));
    return r;
}

static void measure(const Meshlet* m, MeshletMeasure* out) {
    const HalfMeasure low = half_measure(m, 0), high = half_measure(m, 1);
    out->slenderness = greatest(low.slenderness, high.slenderness);
    out->size_term = greatest(low.size, high.size);
    out->slender_lanes = ~((uint32_t)_mm256_movemask_ps(low.sound) | (uint32_t)_mm256_movemask_ps(high.sound) << 8) & 0xffffu;
    const float* rows[6] = {m->x, m->y, m->z, m->more_x, m->more_y, m->more_z};
    for (int k = 0; k < 3; ++k) {
        __m256 low0 = _mm256_load_ps(rows[k]), high0 = _mm256_load_ps(rows[k] + 8), low1 = low0, high1 = high0;
        if (m->wide) {
            const __m256 low2 = _mm256_load_ps(rows[3 + k]), high2 = _mm256_load_ps(rows[3 + k] + 8);
            low0 = _mm256_min_ps(low0, low2), low1 = _mm256_max_ps(low1, low2);
            high0 = _mm256_min_ps(high0, high2), high1 = _mm256_max_ps(high1, high2);
        }
        out->min[k] = least(low0, high0);
        out->max[k] = greatest(low1, high1);
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
