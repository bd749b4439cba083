#pragma once
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
// GCC 12's own headers leave the unused operand of unmasked intrinsics uninitialised on purpose (GCC bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
namespace trocar {
namespace {

// Sixteen elements (x, y, z, w), floats, as four registers; lanes_avx2.hpp has the same for eight. For kernel
// units only: every function is inlined where it is used.
struct Lanes {
    __m512 x, y, z, w;
};

// Swaps rows and columns within each 128-bit group: rows of (x, y, z, w) become the four fields.
inline __attribute__((always_inline)) Lanes transpose(__m512 a, __m512 b, __m512 c, __m512 d) {
    const __m512 ab_low = _mm512_unpacklo_ps(a, b), ab_high = _mm512_unpackhi_ps(a, b);
    const __m512 cd_low = _mm512_unpacklo_ps(c, d), cd_high = _mm512_unpackhi_ps(c, d);
    return {_mm512_shuffle_ps(ab_low, cd_low, 0x44), _mm512_shuffle_ps(ab_low, cd_low, 0xEE), _mm512_shuffle_ps(ab_high, cd_high, 0x44),
            _mm512_shuffle_ps(ab_high, cd_high, 0xEE)};
}

// Elements index[0], [4], [8] and [12] in the four 128-bit groups.
inline __attribute__((always_inline)) __m512 load_rows(const float* base, const unsigned* index) {
    const auto row = [&](unsigned i) __attribute__((always_inline)) { return _mm_load_ps(base + 4 * static_cast<unsigned long>(i)); };
    __m512 rows = _mm512_castps128_ps512(row(index[0]));
    rows = _mm512_mask_broadcast_f32x4(rows, 0x00F0, row(index[4]));
    rows = _mm512_mask_broadcast_f32x4(rows, 0x0F00, row(index[8]));
    return _mm512_mask_broadcast_f32x4(rows, 0xF000, row(index[12]));
}

// One 128-bit load per neighbour instead of three gathers: one cache line is touched, not three.
inline __attribute__((always_inline)) Lanes gather4(const float* base, const unsigned* index) {
    return transpose(load_rows(base, index), load_rows(base, index + 1), load_rows(base, index + 2), load_rows(base, index + 3));
}

// The same for 16-bit indices, counted from element `from`.
inline __attribute__((always_inline)) Lanes gather4_near(const float* base, const unsigned short* index, long from) {
    const float* first = base + 4 * from;  // this form makes the compiler keep it in a register: a tenth of the step's time
    const auto row = [&](int i) __attribute__((always_inline)) { return _mm_load_ps(first + 4ul * index[i]); };
    const auto rows = [&](int i) __attribute__((always_inline)) {
        __m512 r = _mm512_castps128_ps512(row(i));
        r = _mm512_mask_broadcast_f32x4(r, 0x00F0, row(i + 4));
        r = _mm512_mask_broadcast_f32x4(r, 0x0F00, row(i + 8));
        return _mm512_mask_broadcast_f32x4(r, 0xF000, row(i + 12));
    };
    return transpose(rows(0), rows(1), rows(2), rows(3));
}
inline __attribute__((always_inline)) __m512 widen(const unsigned short* values) {
    return _mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(values))));
}

// Transposes the 4 x 4 groups of 128 bits, so that transpose() yields 16 elements in order.
inline __attribute__((always_inline)) void swap_groups(__m512& a, __m512& b, __m512& c, __m512& d) {
    const __m512 ab_low = _mm512_shuffle_f32x4(a, b, 0x44), ab_high = _mm512_shuffle_f32x4(a, b, 0xEE);
    const __m512 cd_low = _mm512_shuffle_f32x4(c, d, 0x44), cd_high = _mm512_shuffle_f32x4(c, d, 0xEE);
    a = _mm512_shuffle_f32x4(ab_low, cd_low, 0x88);
    b = _mm512_shuffle_f32x4(ab_low, cd_low, 0xDD);
    c = _mm512_shuffle_f32x4(ab_high, cd_high, 0x88);
    d = _mm512_shuffle_f32x4(ab_high, cd_high, 0xDD);
}
inline __attribute__((always_inline)) Lanes load4(const float* rows) {
    __m512 a = _mm512_loadu_ps(rows), b = _mm512_loadu_ps(rows + 16), c = _mm512_loadu_ps(rows + 32), d = _mm512_loadu_ps(rows + 48);
    swap_groups(a, b, c, d);
    return transpose(a, b, c, d);
}
inline __attribute__((always_inline)) void store4(float* rows, const Lanes& lanes) {
    Lanes r = transpose(lanes.x, lanes.y, lanes.z, lanes.w);
    swap_groups(r.x, r.y, r.z, r.w);
    _mm512_storeu_ps(rows, r.x);
    _mm512_storeu_ps(rows + 16, r.y);
    _mm512_storeu_ps(rows + 32, r.z);
    _mm512_storeu_ps(rows + 48, r.w);
}

// value[0..15] added to doubles sum[0..15].
inline __attribute__((always_inline)) void add_doubles(double* sum, __m512 value) {
    const __m512d low = _mm512_cvtps_pd(_mm512_castps512_ps256(value));
    const __m512d high = _mm512_cvtps_pd(_mm512_extractf32x8_ps(value, 1));
    _mm512_storeu_pd(sum, _mm512_add_pd(_mm512_loadu_pd(sum), low));
    _mm512_storeu_pd(sum + 8, _mm512_add_pd(_mm512_loadu_pd(sum + 8), high));
}

}  // namespace
}  // namespace trocar
#pragma GCC diagnostic pop
