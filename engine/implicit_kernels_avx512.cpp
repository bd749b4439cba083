// GCC 12's own headers leave the unused operand of unmasked intrinsics uninitialised on purpose (GCC bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>

#include "engine/implicit_kernels.hpp"
#include "engine/lanes_avx512.inl"
namespace trocar {
namespace {

#include "engine/implicit_kernels.inl"

}  // namespace

extern const ImplicitKernels kImplicitKernelsAvx512 = {predict, begin, apply, move, turn, finish, tet_slopes, tet_blocks, tet_pull};

}  // namespace trocar
