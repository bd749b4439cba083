#include <immintrin.h>

#include "engine/implicit_kernels.hpp"
#include "engine/lanes_avx2.inl"
namespace trocar {
namespace {

#include "engine/implicit_kernels.inl"

}  // namespace

extern const ImplicitKernels kImplicitKernelsAvx2 = {predict, begin, apply, move, turn, finish, tet_slopes, tet_blocks, tet_pull};

}  // namespace trocar
