#include <immintrin.h>

#include "engine/kernels/implicit_kernels.hpp"
#include "engine/kernels/lanes_avx2.inl"
namespace trocar {
namespace {

#include "engine/kernels/implicit_kernels.inl"

}  // namespace

extern const ImplicitKernels kImplicitKernelsAvx2 = {predict, begin, apply, move, turn, finish, tet_slopes, tet_blocks, tet_pull};

}  // namespace trocar
