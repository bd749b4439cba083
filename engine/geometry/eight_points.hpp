#pragma once
#include <immintrin.h>

#include <cstddef>
#include <cstdint>
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Eight floats in a register, and eight points or vectors, coordinate by coordinate: each lane of a register
// belongs to one of them.
typedef float Vec8f __attribute__((vector_size(32)));
struct EightPoints {
    Vec8f x = {}, y = {}, z = {};
};
// Comparisons of lanes: -1 where true, 0 where not. `mask ? a : b` picks lane by lane.
using Mask8 = decltype(Vec8f{} < Vec8f{});

template <typename Lanes>
Vec8f load_lanes(const Lanes& a, size_t first = 0) {
    return (Vec8f)_mm256_loadu_ps(a.data() + first);
}
template <typename Lanes>
void put_lanes(Vec8f a, Lanes& lanes, size_t first = 0) {
    _mm256_storeu_ps(lanes.data() + first, (__m256)a);
}
inline Vec8f lanes_of(float x) { return Vec8f{x, x, x, x, x, x, x, x}; }
inline uint32_t mask_bits(Mask8 mask) { return uint32_t(_mm256_movemask_ps((__m256)mask)); }
inline Vec8f square_roots(Vec8f a) { return (Vec8f)_mm256_sqrt_ps((__m256)a); }
// Returns the second argument if either is NaN.
inline Vec8f least(Vec8f a, Vec8f b) { return (Vec8f)_mm256_min_ps((__m256)a, (__m256)b); }
inline Vec8f greatest(Vec8f a, Vec8f b) { return (Vec8f)_mm256_max_ps((__m256)a, (__m256)b); }
inline Vec8f positive(Vec8f a) { return greatest(a, Vec8f{}); }
inline float least_lane(Vec8f a) {
    const __m128 four = _mm_min_ps(_mm256_castps256_ps128((__m256)a), _mm256_extractf128_ps((__m256)a, 1));
    const __m128 two = _mm_min_ps(four, _mm_movehl_ps(four, four));
    return _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)));
}

inline EightPoints operator+(const EightPoints& a, const EightPoints& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline EightPoints operator-(const EightPoints& a, const EightPoints& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline EightPoints operator*(Vec8f s, const EightPoints& a) { return {s * a.x, s * a.y, s * a.z}; }
inline Vec8f dot(const EightPoints& a, const EightPoints& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec8f norm2(const EightPoints& a) { return dot(a, a); }
inline EightPoints cross(const EightPoints& a, const EightPoints& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline EightPoints either(Mask8 mask, const EightPoints& a, const EightPoints& b) {
    return {mask ? a.x : b.x, mask ? a.y : b.y, mask ? a.z : b.z};
}

}  // namespace trocar
#pragma GCC diagnostic pop
