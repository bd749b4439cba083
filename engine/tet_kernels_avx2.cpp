#include "engine/lanes_avx2.hpp"
#include "engine/tet_kernels.hpp"
namespace trocar {
namespace {

struct Vec {
    __m256 x, y, z;
};
inline __attribute__((always_inline)) Vec between(const Lanes& from, const Lanes& to) {
    return {_mm256_sub_ps(to.x, from.x), _mm256_sub_ps(to.y, from.y), _mm256_sub_ps(to.z, from.z)};
}
inline __attribute__((always_inline)) Vec cross(const Vec& a, const Vec& b) {
    return {_mm256_fmsub_ps(a.y, b.z, _mm256_mul_ps(a.z, b.y)), _mm256_fmsub_ps(a.z, b.x, _mm256_mul_ps(a.x, b.z)),
            _mm256_fmsub_ps(a.x, b.y, _mm256_mul_ps(a.y, b.x))};
}
inline __attribute__((always_inline)) Lanes scaled(__m256 s, const Vec& a) {
    return {_mm256_mul_ps(s, a.x), _mm256_mul_ps(s, a.y), _mm256_mul_ps(s, a.z), _mm256_setzero_ps()};
}
// -(a + b + c): the forces of a tetrahedron add up to nothing.
inline __attribute__((always_inline)) Lanes against(const Lanes& a, const Lanes& b, const Lanes& c) {
    const __m256 zero = _mm256_setzero_ps();
    const auto sum = [&](__m256 p, __m256 q, __m256 r) __attribute__((always_inline)) {
        return _mm256_sub_ps(zero, _mm256_add_ps(_mm256_add_ps(p, q), r));
    };
    return {sum(a.x, b.x, c.x), sum(a.y, b.y, c.y), sum(a.z, b.z, c.z), zero};
}

void press(const TetStep* body, unsigned first, unsigned last, float* least) {
    const auto set = [](float v) { return _mm256_set1_ps(v); };
    const unsigned long corner_rows = 4ul * body->tetrahedra;
    for (unsigned t = 16 * first; t < 16 * last; t += 8) {
        const Lanes p0 = gather(body->offset, body->corner0 + t);
        const Vec a = between(p0, gather(body->offset, body->corner1 + t));
        const Vec b = between(p0, gather(body->offset, body->corner2 + t));
        const Vec c = between(p0, gather(body->offset, body->corner3 + t));
        const Vec bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
        const __m256 volume = _mm256_fmadd_ps(a.x, bc.x, _mm256_fmadd_ps(a.y, bc.y, _mm256_mul_ps(a.z, bc.z)));
        const __m256 swelling = _mm256_mul_ps(_mm256_sub_ps(volume, _mm256_loadu_ps(body->rest + t)), _mm256_loadu_ps(body->per_rest + t));
        const __m256 held = _mm256_max_ps(_mm256_min_ps(swelling, set(kStretchCap)), set(-1.0f));
        const __m256 crushed = _mm256_min_ps(_mm256_add_ps(held, set(1.0f - kCrushed)), _mm256_setzero_ps());
        const __m256 pressure = _mm256_fmadd_ps(set(body->crush), crushed, _mm256_mul_ps(set(body->bulk), held));
        __m256 share = _mm256_mul_ps(pressure, set(-1.0f / 6));
        if (body->factor) share = _mm256_mul_ps(share, _mm256_loadu_ps(body->factor + t));
        const Lanes f1 = scaled(share, bc), f2 = scaled(share, ca), f3 = scaled(share, ab);
        float* out = body->corner_force + 4ul * t;
        store(out, against(f1, f2, f3));
        store(out + corner_rows, f1);
        store(out + 2 * corner_rows, f2);
        store(out + 3 * corner_rows, f3);
        float* lane = least + t % 16;
        _mm256_storeu_ps(lane, _mm256_min_ps(_mm256_add_ps(swelling, set(1.0f)), _mm256_loadu_ps(lane)));
    }
}

void gather_corners(const TetStep* body, unsigned first, unsigned last) {
    for (unsigned half_slice = 2 * first; half_slice < 2 * last; ++half_slice) {
        const unsigned slice = half_slice / 2, lane = 8 * (half_slice % 2), row = 16 * slice + lane;
        __m256 x = _mm256_loadu_ps(body->force_x + row), y = _mm256_loadu_ps(body->force_y + row), z = _mm256_loadu_ps(body->force_z + row);
        const unsigned long end = 16ul * body->slot_column[slice + 1];
        for (unsigned long h = 16ul * body->slot_column[slice]; h < end; h += 16) {
            const Lanes f = gather(body->corner_force, body->slot + h + lane);
            x = _mm256_add_ps(x, f.x);
            y = _mm256_add_ps(y, f.y);
            z = _mm256_add_ps(z, f.z);
        }
        _mm256_storeu_ps(body->force_x + row, x);
        _mm256_storeu_ps(body->force_y + row, y);
        _mm256_storeu_ps(body->force_z + row, z);
    }
}

}  // namespace

extern const TetKernels kTetKernelsAvx2 = {press, gather_corners};

}  // namespace trocar
