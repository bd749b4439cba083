// Sixteen lanes as the kernels shared by both instruction sets see them.
namespace trocar {
namespace {

#define TROCAR_LANES inline __attribute__((always_inline))

using V = __m512;
constexpr unsigned kWidth = 16;
struct Lanes {
    V x, y, z, w;
};

TROCAR_LANES V set(float v) { return _mm512_set1_ps(v); }
TROCAR_LANES V load(const float* p) { return _mm512_loadu_ps(p); }
TROCAR_LANES void keep_store(float* p, V v) { _mm512_storeu_ps(p, v); }
TROCAR_LANES V root(V v) { return _mm512_sqrt_ps(v); }
TROCAR_LANES V larger(V a, V b) { return _mm512_max_ps(a, b); }
TROCAR_LANES V multiply_add(V a, V b, V c) { return _mm512_fmadd_ps(a, b, c); }
// value where `sign` is above zero, else 0
TROCAR_LANES V where_positive(V sign, V value) {
    return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(sign, _mm512_setzero_ps(), _CMP_GT_OQ), value);
}
// 1 where the lane's number is not its own row, else 0
TROCAR_LANES V is_other(const unsigned* number, unsigned row) {
    const __m512i own =
        _mm512_add_epi32(_mm512_set1_epi32(static_cast<int>(row)), _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0));
    return _mm512_maskz_mov_ps(_mm512_cmpneq_epi32_mask(_mm512_loadu_si512(number), own), _mm512_set1_ps(1.0f));
}
TROCAR_LANES Lanes transpose(V a, V b, V c, V d) {
    const V ab_low = _mm512_unpacklo_ps(a, b), ab_high = _mm512_unpackhi_ps(a, b);
    const V cd_low = _mm512_unpacklo_ps(c, d), cd_high = _mm512_unpackhi_ps(c, d);
    return {_mm512_shuffle_ps(ab_low, cd_low, 0x44), _mm512_shuffle_ps(ab_low, cd_low, 0xEE), _mm512_shuffle_ps(ab_high, cd_high, 0x44),
            _mm512_shuffle_ps(ab_high, cd_high, 0xEE)};
}
TROCAR_LANES V load_rows(const float* base, const unsigned* number) {
    const auto row = [&](unsigned i) __attribute__((always_inline)) { return _mm_load_ps(base + 4 * static_cast<unsigned long>(i)); };
    V rows = _mm512_castps128_ps512(row(number[0]));
    rows = _mm512_mask_broadcast_f32x4(rows, 0x00F0, row(number[4]));
    rows = _mm512_mask_broadcast_f32x4(rows, 0x0F00, row(number[8]));
    return _mm512_mask_broadcast_f32x4(rows, 0xF000, row(number[12]));
}
// Rows of four floats by number: one 128-bit load each.
TROCAR_LANES Lanes gather4(const float* base, const unsigned* number) {
    return transpose(load_rows(base, number), load_rows(base, number + 1), load_rows(base, number + 2), load_rows(base, number + 3));
}
// Rows of four floats to numbers that all differ.
TROCAR_LANES void scatter4(float* base, const unsigned* number, const Lanes& lanes) {
    const Lanes r = transpose(lanes.x, lanes.y, lanes.z, lanes.w);
    const auto put = [&](V four, unsigned i) __attribute__((always_inline)) {
        _mm_store_ps(base + 4ul * number[i], _mm512_castps512_ps128(four));
        _mm_store_ps(base + 4ul * number[i + 4], _mm512_extractf32x4_ps(four, 1));
        _mm_store_ps(base + 4ul * number[i + 8], _mm512_extractf32x4_ps(four, 2));
        _mm_store_ps(base + 4ul * number[i + 12], _mm512_extractf32x4_ps(four, 3));
    };
    put(r.x, 0), put(r.y, 1), put(r.z, 2), put(r.w, 3);
}
TROCAR_LANES void swap_groups(V& a, V& b, V& c, V& d) {
    const V ab_low = _mm512_shuffle_f32x4(a, b, 0x44), ab_high = _mm512_shuffle_f32x4(a, b, 0xEE);
    const V cd_low = _mm512_shuffle_f32x4(c, d, 0x44), cd_high = _mm512_shuffle_f32x4(c, d, 0xEE);
    a = _mm512_shuffle_f32x4(ab_low, cd_low, 0x88);
    b = _mm512_shuffle_f32x4(ab_low, cd_low, 0xDD);
    c = _mm512_shuffle_f32x4(ab_high, cd_high, 0x88);
    d = _mm512_shuffle_f32x4(ab_high, cd_high, 0xDD);
}
// Consecutive rows of four floats.
TROCAR_LANES Lanes load4(const float* rows) {
    V a = _mm512_loadu_ps(rows), b = _mm512_loadu_ps(rows + 16), c = _mm512_loadu_ps(rows + 32), d = _mm512_loadu_ps(rows + 48);
    swap_groups(a, b, c, d);
    return transpose(a, b, c, d);
}
TROCAR_LANES void store4(float* rows, const Lanes& lanes) {
    Lanes r = transpose(lanes.x, lanes.y, lanes.z, lanes.w);
    swap_groups(r.x, r.y, r.z, r.w);
    _mm512_storeu_ps(rows, r.x);
    _mm512_storeu_ps(rows + 16, r.y);
    _mm512_storeu_ps(rows + 32, r.z);
    _mm512_storeu_ps(rows + 48, r.w);
}
TROCAR_LANES void add_doubles(double* sum, V value) {
    const __m512d low = _mm512_cvtps_pd(_mm512_castps512_ps256(value));
    const __m512d high = _mm512_cvtps_pd(_mm512_extractf32x8_ps(value, 1));
    _mm512_storeu_pd(sum, _mm512_add_pd(_mm512_loadu_pd(sum), low));
    _mm512_storeu_pd(sum + 8, _mm512_add_pd(_mm512_loadu_pd(sum + 8), high));
}

}  // namespace
}  // namespace trocar
