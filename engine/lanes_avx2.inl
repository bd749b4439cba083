// Eight lanes, half a slice, as the kernels shared by both instruction sets see them.
namespace trocar {
namespace {

#define TROCAR_LANES inline __attribute__((always_inline))

using V = __m256;
constexpr unsigned kWidth = 8;
struct Lanes {
    V x, y, z, w;
};

TROCAR_LANES V set(float v) { return _mm256_set1_ps(v); }
TROCAR_LANES V load(const float* p) { return _mm256_loadu_ps(p); }
TROCAR_LANES void keep_store(float* p, V v) { _mm256_storeu_ps(p, v); }
TROCAR_LANES V root(V v) { return _mm256_sqrt_ps(v); }
TROCAR_LANES V larger(V a, V b) { return _mm256_max_ps(a, b); }
TROCAR_LANES V multiply_add(V a, V b, V c) { return _mm256_fmadd_ps(a, b, c); }
// value where `sign` is above zero, else 0
TROCAR_LANES V where_positive(V sign, V value) { return _mm256_and_ps(_mm256_cmp_ps(sign, _mm256_setzero_ps(), _CMP_GT_OQ), value); }
// 1 where the lane's number is not its own row, else 0
TROCAR_LANES V is_other(const unsigned* number, unsigned row) {
    const __m256i own = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(row)), _mm256_set_epi32(7, 6, 5, 4, 3, 2, 1, 0));
    const __m256i given = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(number));
    return _mm256_andnot_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(given, own)), _mm256_set1_ps(1.0f));
}
TROCAR_LANES Lanes transpose(V a, V b, V c, V d) {
    const V ab_low = _mm256_unpacklo_ps(a, b), ab_high = _mm256_unpackhi_ps(a, b);
    const V cd_low = _mm256_unpacklo_ps(c, d), cd_high = _mm256_unpackhi_ps(c, d);
    return {_mm256_shuffle_ps(ab_low, cd_low, 0x44), _mm256_shuffle_ps(ab_low, cd_low, 0xEE), _mm256_shuffle_ps(ab_high, cd_high, 0x44),
            _mm256_shuffle_ps(ab_high, cd_high, 0xEE)};
}
TROCAR_LANES V join(const float* low, const float* high) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(low)), _mm_load_ps(high), 1);
}
// Rows of four floats by number: one 128-bit load each.
TROCAR_LANES Lanes gather4(const float* base, const unsigned* number) {
    const auto rows = [&](int i) __attribute__((always_inline)) { return join(base + 4ul * number[i], base + 4ul * number[i + 4]); };
    return transpose(rows(0), rows(1), rows(2), rows(3));
}
// Rows of four floats to numbers that all differ.
TROCAR_LANES void scatter4(float* base, const unsigned* number, const Lanes& lanes) {
    const Lanes r = transpose(lanes.x, lanes.y, lanes.z, lanes.w);
    const auto put = [&](V two, int i) __attribute__((always_inline)) {
        _mm_store_ps(base + 4ul * number[i], _mm256_castps256_ps128(two));
        _mm_store_ps(base + 4ul * number[i + 4], _mm256_extractf128_ps(two, 1));
    };
    put(r.x, 0), put(r.y, 1), put(r.z, 2), put(r.w, 3);
}
// Consecutive rows of four floats.
TROCAR_LANES Lanes load4(const float* rows) {
    return transpose(join(rows, rows + 16), join(rows + 4, rows + 20), join(rows + 8, rows + 24), join(rows + 12, rows + 28));
}
TROCAR_LANES void store4(float* rows, const Lanes& lanes) {
    const Lanes r = transpose(lanes.x, lanes.y, lanes.z, lanes.w);
    _mm256_storeu_ps(rows, _mm256_permute2f128_ps(r.x, r.y, 0x20));
    _mm256_storeu_ps(rows + 8, _mm256_permute2f128_ps(r.z, r.w, 0x20));
    _mm256_storeu_ps(rows + 16, _mm256_permute2f128_ps(r.x, r.y, 0x31));
    _mm256_storeu_ps(rows + 24, _mm256_permute2f128_ps(r.z, r.w, 0x31));
}
TROCAR_LANES void add_doubles(double* sum, V value) {
    const __m256d low = _mm256_cvtps_pd(_mm256_castps256_ps128(value));
    const __m256d high = _mm256_cvtps_pd(_mm256_extractf128_ps(value, 1));
    _mm256_storeu_pd(sum, _mm256_add_pd(_mm256_loadu_pd(sum), low));
    _mm256_storeu_pd(sum + 4, _mm256_add_pd(_mm256_loadu_pd(sum + 4), high));
}

}  // namespace
}  // namespace trocar
