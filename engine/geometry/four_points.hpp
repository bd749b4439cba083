#pragma once
#include <array>

#include "engine/geometry/vec4.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Four points or vectors, coordinate by coordinate: each lane of a register belongs to one of them. Four
// contact constraints cost little more than one, and no sum runs across lanes.
struct FourPoints {
    Vec4d x = {}, y = {}, z = {};
};
// Comparisons of lanes: -1 where true, 0 where not. `mask ? a : b` picks lane by lane.
using Mask4 = decltype(Vec4d{} < Vec4d{});

// Four numbers that are exact as floats.
struct alignas(16) FourFloats {
    std::array<float, 4> lane;
};
inline Vec4d wide(const FourFloats& a) { return (Vec4d)_mm256_cvtps_pd(_mm_load_ps(a.lane.data())); }
inline void narrow(Vec4d a, FourFloats& to) { _mm_store_ps(to.lane.data(), _mm256_cvtpd_ps((__m256d)a)); }

inline Vec4d all_lanes(double x) { return Vec4d{x, x, x, x}; }
inline uint32_t mask_bits(Mask4 mask) { return uint32_t(_mm256_movemask_pd((__m256d)mask)); }
// And back.
inline Mask4 mask_lanes(uint32_t bits) {
    const Mask4 all = {1, 2, 4, 8};
    return (all & int64_t(bits)) == all;
}
inline bool any(Mask4 mask) { return mask_bits(mask) != 0; }
inline Vec4d keep(Mask4 mask, Vec4d a) { return (Vec4d)(mask & (Mask4)a); }  // zero elsewhere, even where a is NaN
inline Vec4d square_root(Vec4d a) { return (Vec4d)_mm256_sqrt_pd((__m256d)a); }
// Returns the second argument if either is NaN.
inline Vec4d least(Vec4d a, Vec4d b) { return (Vec4d)_mm256_min_pd((__m256d)a, (__m256d)b); }
inline Vec4d greatest(Vec4d a, Vec4d b) { return (Vec4d)_mm256_max_pd((__m256d)a, (__m256d)b); }

inline FourPoints operator+(const FourPoints& a, const FourPoints& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline FourPoints operator-(const FourPoints& a, const FourPoints& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline FourPoints operator*(Vec4d s, const FourPoints& a) { return {s * a.x, s * a.y, s * a.z}; }
inline FourPoints keep(Mask4 mask, const FourPoints& a) { return {keep(mask, a.x), keep(mask, a.y), keep(mask, a.z)}; }
inline Vec4d dot(const FourPoints& a, const FourPoints& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec4d norm2(const FourPoints& a) { return dot(a, a); }
inline FourPoints cross(const FourPoints& a, const FourPoints& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline FourPoints in_all_lanes(const Vec3d& p) { return {all_lanes(p.x()), all_lanes(p.y()), all_lanes(p.z())}; }

// Packs four vectors of make_vec4 into lanes, and the inverse.
inline FourPoints side_by_side(Vec4d a, Vec4d b, Vec4d c, Vec4d d) {
    const __m256d xz0 = _mm256_unpacklo_pd((__m256d)a, (__m256d)b), y0 = _mm256_unpackhi_pd((__m256d)a, (__m256d)b);
    const __m256d xz1 = _mm256_unpacklo_pd((__m256d)c, (__m256d)d), y1 = _mm256_unpackhi_pd((__m256d)c, (__m256d)d);
    return {(Vec4d)_mm256_permute2f128_pd(xz0, xz1, 0x20), (Vec4d)_mm256_permute2f128_pd(y0, y1, 0x20),
            (Vec4d)_mm256_permute2f128_pd(xz0, xz1, 0x31)};
}
inline std::array<Vec4d, 4> one_by_one(const FourPoints& p) {
    const __m256d zero = _mm256_setzero_pd();
    const __m256d xy0 = _mm256_unpacklo_pd((__m256d)p.x, (__m256d)p.y);
    const __m256d xy1 = _mm256_unpackhi_pd((__m256d)p.x, (__m256d)p.y);
    const __m256d z0 = _mm256_unpacklo_pd((__m256d)p.z, zero), z1 = _mm256_unpackhi_pd((__m256d)p.z, zero);
    return {(Vec4d)_mm256_permute2f128_pd(xy0, z0, 0x20), (Vec4d)_mm256_permute2f128_pd(xy1, z1, 0x20),
            (Vec4d)_mm256_permute2f128_pd(xy0, z0, 0x31), (Vec4d)_mm256_permute2f128_pd(xy1, z1, 0x31)};
}
inline Vec4d lane_of(const FourPoints& p, uint32_t lane) { return make_vec4(p.x[lane], p.y[lane], p.z[lane]); }
inline void set_lane(FourPoints& p, uint32_t lane, Vec4d v) { p.x[lane] = v[0], p.y[lane] = v[1], p.z[lane] = v[2]; }

}  // namespace trocar
#pragma GCC diagnostic pop
