#pragma once
namespace trocar {

// StateHash::mix over kHashLanes parallel words, `rows` times: lane[i] takes word i of each row of kHashLanes words. Plain C
// types only, as in spring_kernels.hpp: compiled for each instruction set, with the bits of the scalar function.
constexpr unsigned kHashLanes = 32;
void mix_rows_avx2(unsigned long* lane, const unsigned char* bytes, unsigned long rows);
void mix_rows_avx512(unsigned long* lane, const unsigned char* bytes, unsigned long rows);

static inline __attribute__((always_inline)) void mix_rows(unsigned long* lane, const unsigned char* bytes, unsigned long rows) {
    unsigned long state[kHashLanes];  // stays in registers
    for (unsigned i = 0; i < kHashLanes; ++i) state[i] = lane[i];
    for (; rows > 0; --rows, bytes += sizeof state) {
        for (unsigned i = 0; i < kHashLanes; ++i) {
            unsigned long word;
            __builtin_memcpy(&word, bytes + i * sizeof word, sizeof word);
            unsigned long z = state[i] ^ word;
            z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ul;
            z = (z ^ (z >> 27)) * 0x94d049bb133111ebul;
            state[i] = (z ^ (z >> 31)) + 0x9e3779b97f4a7c15ul;
        }
    }
    for (unsigned i = 0; i < kHashLanes; ++i) lane[i] = state[i];
}

}  // namespace trocar
