#include <immintrin.h>

#include "engine/files/state_hash_kernels.hpp"
namespace trocar {
namespace {

// Low 64 bits of the products: AVX2 multiplies 32 bits at a time.
inline __attribute__((always_inline)) __m256i multiply(__m256i x, __m256i low, __m256i high) {
    const __m256i across = _mm256_add_epi64(_mm256_mul_epu32(_mm256_srli_epi64(x, 32), low), _mm256_mul_epu32(x, high));
    return _mm256_add_epi64(_mm256_mul_epu32(x, low), _mm256_slli_epi64(across, 32));
}

}  // namespace

void mix_rows_avx2(unsigned long* lane, const unsigned char* bytes, unsigned long rows) {
    constexpr unsigned kVectors = kHashLanes / 4;
    const __m256i first = _mm256_set1_epi64x(static_cast<long long>(0xbf58476d1ce4e5b9ull)), first_high = _mm256_srli_epi64(first, 32),
                  second = _mm256_set1_epi64x(static_cast<long long>(0x94d049bb133111ebull)), second_high = _mm256_srli_epi64(second, 32),
                  step = _mm256_set1_epi64x(static_cast<long long>(0x9e3779b97f4a7c15ull));
    __m256i state[kVectors];
    for (unsigned i = 0; i < kVectors; ++i) state[i] = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(lane + 4 * i));
    for (; rows > 0; --rows, bytes += 8 * kHashLanes) {
#pragma GCC unroll 8
        for (unsigned i = 0; i < kVectors; ++i) {
            __m256i z = _mm256_xor_si256(state[i], _mm256_loadu_si256(reinterpret_cast<const __m256i*>(bytes + 32 * i)));
            z = multiply(_mm256_xor_si256(z, _mm256_srli_epi64(z, 30)), first, first_high);
            z = multiply(_mm256_xor_si256(z, _mm256_srli_epi64(z, 27)), second, second_high);
            state[i] = _mm256_add_epi64(_mm256_xor_si256(z, _mm256_srli_epi64(z, 31)), step);
        }
    }
    for (unsigned i = 0; i < kVectors; ++i) _mm256_storeu_si256(reinterpret_cast<__m256i*>(lane + 4 * i), state[i]);
}

}  // namespace trocar
