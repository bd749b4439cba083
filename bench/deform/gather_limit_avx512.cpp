#include <immintrin.h>
namespace trocar::bench {

// Sum of gathered floats, so that the compiler drops none. numbers: a multiple of 16.
extern float gather_sum_avx512(const float* values, const int* number, unsigned numbers, unsigned repeats) {
    __m512 sum = _mm512_setzero_ps(), other = sum;
    for (unsigned r = 0; r < repeats; ++r) {
        for (unsigned i = 0; i < numbers; i += 32) {
            sum = _mm512_add_ps(sum, _mm512_i32gather_ps(_mm512_loadu_si512(number + i), values, 4));
            other = _mm512_add_ps(other, _mm512_i32gather_ps(_mm512_loadu_si512(number + i + 16), values, 4));
        }
    }
    return _mm512_reduce_add_ps(_mm512_add_ps(sum, other));
}

}  // namespace trocar::bench
