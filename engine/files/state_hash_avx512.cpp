#include "engine/files/state_hash_kernels.hpp"
namespace trocar {

void mix_rows_avx512(unsigned long* lane, const unsigned char* bytes, unsigned long rows) { mix_rows(lane, bytes, rows); }

}  // namespace trocar
