#pragma GCC diagnostic push
// GCC 12's own headers leave the unused operand of unmasked intrinsics uninitialised on purpose (GCC bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>

#include "engine/files/state_hash_kernels.hpp"
namespace trocar {

void mix_rows_avx512(unsigned long* lane, const unsigned char* bytes, unsigned long rows) {
    constexpr unsigned kVectors = kHashLanes / 8;
    const __m512i first = _mm512_set1_epi64(static_cast<long long>(0xbf58476d1ce4e5b9ull)),
                  second = _mm512_set1_epi64(static_cast<long long>(0x94d049bb133111ebull)),
                  step = _mm512_set1_epi64(static_cast<long long>(0x9e3779b97f4a7c15ull));
    __m512i state[kVectors];
    for (unsigned i = 0; i < kVectors; ++i) state[i] = _mm512_loadu_si512(lane + 8 * i);
    for (; rows > 0; --rows, bytes += 8 * kHashLanes) {
#pragma GCC unroll 4
        for (unsigned i = 0; i < kVectors; ++i) {
            __m512i z = _mm512_xor_si512(state[i], _mm512_loadu_si512(bytes + 64 * i));
            z = _mm512_mullo_epi64(_mm512_xor_si512(z, _mm512_srli_epi64(z, 30)), first);
            z = _mm512_mullo_epi64(_mm512_xor_si512(z, _mm512_srli_epi64(z, 27)), second);
            state[i] = _mm512_add_epi64(_mm512_xor_si512(z, _mm512_srli_epi64(z, 31)), step);
        }
    }
    for (unsigned i = 0; i < kVectors; ++i) _mm512_storeu_si512(lane + 8 * i, state[i]);
}

}  // namespace trocar
#pragma GCC diagnostic pop
