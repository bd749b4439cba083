#pragma once
namespace trocar {

// StateHash::mix over kHashLanes parallel words, `rows` times: lane[i] takes word i of each row of kHashLanes
// words. Plain C types only, as in spring_kernels.hpp; both give the same bits as the scalar function.
constexpr unsigned kHashLanes = 32;
void mix_rows_avx2(unsigned long* lane, const unsigned char* bytes, unsigned long rows);
void mix_rows_avx512(unsigned long* lane, const unsigned char* bytes, unsigned long rows);

}  // namespace trocar
