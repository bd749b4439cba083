#pragma once
#include <immintrin.h>
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {
namespace {

// Eight elements (x, y, z, w), floats, as four registers: as lanes_avx512.hpp.
struct Lanes {
    __m256 x, y, z, w;
};

// Swaps rows and columns within each 128-bit group: rows of (x, y, z, w) become the four fields.
inline __attribute__((always_inline)) Lanes transpose(__m256 a, __m256 b, __m256 c, __m256 d) {
    const __m256 ab_low = _mm256_unpacklo_ps(a, b), ab_high = _mm256_unpackhi_ps(a, b);
    const __m256 cd_low = _mm256_unpacklo_ps(c, d), cd_high = _mm256_unpackhi_ps(c, d);
    return {_mm256_shuffle_ps(ab_low, cd_low, 0x44), _mm256_shuffle_ps(ab_low, cd_low, 0xEE), _mm256_shuffle_ps(ab_high, cd_high, 0x44),
            _mm256_shuffle_ps(ab_high, cd_high, 0xEE)};
}
inline __attribute__((always_inline)) __m256 join(const float* low, const float* high) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(low)), _mm_load_ps(high), 1);
}
inline __attribute__((always_inline)) Lanes gather4(const float* base, const unsigned* index) {
    const auto rows = [&](int i) __attribute__((always_inline)) { return join(base + 4ul * index[i], base + 4ul * index[i + 4]); };
    return transpose(rows(0), rows(1), rows(2), rows(3));
}
// The same for 16-bit indices, counted from element `from`.
inline __attribute__((always_inline)) Lanes gather4_near(const float* base, const unsigned short* index, long from) {
    const float* first = base + 4 * from;
    const auto rows = [&](int i) __attribute__((always_inline)) { return join(first + 4ul * index[i], first + 4ul * index[i + 4]); };
    return transpose(rows(0), rows(1), rows(2), rows(3));
}
inline __attribute__((always_inline)) __m256 widen(const unsigned short* values) {
    return _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(values))));
}
inline __attribute__((always_inline)) Lanes load4(const float* rows) {
    return transpose(join(rows, rows + 16), join(rows + 4, rows + 20), join(rows + 8, rows + 24), join(rows + 12, rows + 28));
}
inline __attribute__((always_inline)) void store4(float* rows, const Lanes& lanes) {
    const Lanes r = transpose(lanes.x, lanes.y, lanes.z, lanes.w);
    _mm256_storeu_ps(rows, _mm256_permute2f128_ps(r.x, r.y, 0x20));
    _mm256_storeu_ps(rows + 8, _mm256_permute2f128_ps(r.z, r.w, 0x20));
    _mm256_storeu_ps(rows + 16, _mm256_permute2f128_ps(r.x, r.y, 0x31));
    _mm256_storeu_ps(rows + 24, _mm256_permute2f128_ps(r.z, r.w, 0x31));
}

// value[0..7] added to doubles sum[0..7].
inline __attribute__((always_inline)) void add_doubles(double* sum, __m256 value) {
    const __m256d low = _mm256_cvtps_pd(_mm256_castps256_ps128(value));
    const __m256d high = _mm256_cvtps_pd(_mm256_extractf128_ps(value, 1));
    _mm256_storeu_pd(sum, _mm256_add_pd(_mm256_loadu_pd(sum), low));
    _mm256_storeu_pd(sum + 4, _mm256_add_pd(_mm256_loadu_pd(sum + 4), high));
}

}  // namespace
}  // namespace trocar
#pragma GCC diagnostic pop
