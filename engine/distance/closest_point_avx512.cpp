#include <immintrin.h>

#include "engine/distance/closest_point_kernels.hpp"
namespace trocar {

// GCC 12 warns about the deliberately undefined registers inside its own intrinsics
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"

namespace {
struct Lanes3 {
    __m512 x, y, z;
};
}  // namespace

static inline __attribute__((always_inline)) Lanes3 corner(const Meshlet* m, int k) {
    const __m512i i = _mm512_cvtepu8_epi32(_mm_load_si128((const __m128i*)m->corner[k]));
    const __m512 x = _mm512_load_ps(m->x), y = _mm512_load_ps(m->y), z = _mm512_load_ps(m->z);
    Lanes3 r;
    if (__builtin_expect(!m->wide, 1)) {
        r.x = _mm512_permutexvar_ps(i, x);
        r.y = _mm512_permutexvar_ps(i, y);
        r.z = _mm512_permutexvar_ps(i, z);
    } else {
        r.x = _mm512_permutex2var_ps(x, i, _mm512_load_ps(m->more_x));
        r.y = _mm512_permutex2var_ps(y, i, _mm512_load_ps(m->more_y));
        r.z = _mm512_permutex2var_ps(z, i, _mm512_load_ps(m->more_z));
    }
    return r;
}
static inline __attribute__((always_inline)) Lanes3 subtract(Lanes3 a, Lanes3 b) {
    Lanes3 r;
    r.x = _mm512_sub_ps(a.x, b.x);
    r.y = _mm512_sub_ps(a.y, b.y);
    r.z = _mm512_sub_ps(a.z, b.z);
    return r;
}
static inline __attribute__((always_inline)) __m512 dot(Lanes3 a, Lanes3 b) {
    return _mm512_fmadd_ps(a.z, b.z, _mm512_fmadd_ps(a.y, b.y, _mm512_mul_ps(a.x, b.x)));
}
static inline __attribute__((always_inline)) Lanes3 cross(Lanes3 a, Lanes3 b) {
    Lanes3 r;
    r.x = _mm512_fmsub_ps(a.y, b.z, _mm512_mul_ps(a.z, b.y));
    r.y = _mm512_fmsub_ps(a.z, b.x, _mm512_mul_ps(a.x, b.z));
    r.z = _mm512_fmsub_ps(a.x, b.y, _mm512_mul_ps(a.y, b.x));
    return r;
}
// squared distance of the origin to the segment from r along e
static inline __attribute__((always_inline)) __m512 to_segment(Lanes3 r, Lanes3 e) {
    const __m512 tiny = _mm512_set1_ps(1e-36f);
    __m512 t = _mm512_div_ps(dot(r, e), _mm512_max_ps(dot(e, e), tiny));
    t = _mm512_max_ps(_mm512_min_ps(t, _mm512_setzero_ps()), _mm512_set1_ps(-1.0f));
    Lanes3 q;
    q.x = _mm512_fnmadd_ps(t, e.x, r.x);
    q.y = _mm512_fnmadd_ps(t, e.y, r.y);
    q.z = _mm512_fnmadd_ps(t, e.z, r.z);
    return dot(q, q);
}
// same order of comparisons as the AVX2 version; min and max are exact, so only NaN could differ
static inline __attribute__((always_inline)) float least(__m512 v) {
    const __m256 h = _mm256_min_ps(_mm512_castps512_ps256(v), _mm512_extractf32x8_ps(v, 1));
    __m128 q = _mm_min_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
    q = _mm_min_ps(q, _mm_movehl_ps(q, q));
    q = _mm_min_ss(q, _mm_movehdup_ps(q));
    return _mm_cvtss_f32(q);
}
static inline __attribute__((always_inline)) float greatest(__m512 v) {
    const __m256 h = _mm256_max_ps(_mm512_castps512_ps256(v), _mm512_extractf32x8_ps(v, 1));
    __m128 q = _mm_max_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
    q = _mm_max_ps(q, _mm_movehl_ps(q, q));
    q = _mm_max_ss(q, _mm_movehdup_ps(q));
    return _mm_cvtss_f32(q);
}

static float distance(const Meshlet* m, const float* q, float limit, float* squared, uint32_t* mask) {
    const Lanes3 a0 = corner(m, 0), b0 = corner(m, 1), c0 = corner(m, 2);
    // edges from the vertices, not from the differences to q: their relative error must not grow with the distance
    const Lanes3 ab = subtract(b0, a0), bc = subtract(c0, b0), ca = subtract(a0, c0);
    Lanes3 p;
    p.x = _mm512_set1_ps(q[0]);
    p.y = _mm512_set1_ps(q[1]);
    p.z = _mm512_set1_ps(q[2]);
    const Lanes3 a = subtract(a0, p), b = subtract(b0, p), c = subtract(c0, p);
    __m512 d = _mm512_min_ps(to_segment(a, ab), _mm512_min_ps(to_segment(b, bc), to_segment(c, ca)));
    const Lanes3 n = cross(ca, ab);
    const __m512 s =
        _mm512_max_ps(dot(cross(n, ab), a), _mm512_max_ps(dot(cross(n, bc), b), dot(cross(n, ca), c)));  // <= 0: above the face
    const __m512 h = dot(n, a);
    const __m512 face = _mm512_mul_ps(h, _mm512_div_ps(h, _mm512_max_ps(dot(n, n), _mm512_set1_ps(1e-36f))));
    const __mmask16 above = _mm512_cmp_ps_mask(s, _mm512_setzero_ps(), _CMP_LE_OQ);
    d = _mm512_mask_blend_ps(above, d, _mm512_min_ps(face, d));
    _mm512_store_ps(squared, d);
    *mask = (uint32_t)_mm512_cmp_ps_mask(d, _mm512_set1_ps(limit), _CMP_LT_OQ);
    return least(d);
}

static void measure(const Meshlet* m, MeshletMeasure* out) {
    const Lanes3 a = corner(m, 0), b = corner(m, 1), c = corner(m, 2);
    const Lanes3 ab = subtract(b, a), bc = subtract(c, b), ca = subtract(a, c);
    const Lanes3 n = cross(ca, ab);
    const __m512 n2 = dot(n, n);
    const __m512 l2 = _mm512_max_ps(dot(ab, ab), _mm512_max_ps(dot(bc, bc), dot(ca, ca)));
    const __mmask16 sound = _mm512_cmp_ps_mask(n2, _mm512_mul_ps(_mm512_set1_ps(1e-4f), _mm512_mul_ps(l2, l2)), _CMP_GE_OQ) &
                            _mm512_cmp_ps_mask(l2, _mm512_set1_ps(1e-14f), _CMP_GE_OQ);
    const __m512 slenderness = _mm512_maskz_div_ps(sound, l2, _mm512_sqrt_ps(n2));
    const __m512 size = _mm512_mul_ps(_mm512_sqrt_ps(l2), _mm512_fmadd_ps(slenderness, _mm512_set1_ps(24.0f), _mm512_set1_ps(16.0f)));
    out->slenderness = greatest(slenderness);
    out->size_term = greatest(_mm512_maskz_mov_ps(sound, size));
    out->slender_lanes = (uint32_t)(uint16_t)~sound;
    __m512 x0 = _mm512_load_ps(m->x), y0 = _mm512_load_ps(m->y), z0 = _mm512_load_ps(m->z), x1 = x0, y1 = y0, z1 = z0;
    if (m->wide) {
        const __m512 x = _mm512_load_ps(m->more_x), y = _mm512_load_ps(m->more_y), z = _mm512_load_ps(m->more_z);
        x0 = _mm512_min_ps(x0, x), x1 = _mm512_max_ps(x1, x);
        y0 = _mm512_min_ps(y0, y), y1 = _mm512_max_ps(y1, y);
        z0 = _mm512_min_ps(z0, z), z1 = _mm512_max_ps(z1, z);
    }
    out->min[0] = least(x0), out->min[1] = least(y0), out->min[2] = least(z0);
    out->max[0] = greatest(x1), out->max[1] = greatest(y1), out->max[2] = greatest(z1);
}

static void fill(Meshlet* m, const float* offset, const uint32_t* vertex, const float* centre, float scale) {
    kMeshletKernelsAvx2.fill(m, offset, vertex, centre, scale);
}

const MeshletKernels kMeshletKernelsAvx512 = {distance, measure, fill};

}  // namespace trocar
