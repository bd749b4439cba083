// GCC 12's own headers leave the unused operand of unmasked intrinsics uninitialised on purpose (GCC bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>

#include "engine/kernels/implicit_kernels.hpp"
#include "engine/kernels/lanes_avx512.inl"
namespace trocar {
namespace {

#include "engine/kernels/implicit_kernels.inl"

}  // namespace

extern const ImplicitKernels kImplicitKernelsAvx512 = {predict, begin, apply, move, turn, finish, tet_slopes, tet_blocks, tet_pull};

}  // namespace trocar
