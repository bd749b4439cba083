#include "engine/lanes_avx512.inl"
#include "engine/tet_kernels.hpp"
namespace trocar {
namespace {

#include "engine/tet_kernels.inl"

}  // namespace

extern const TetKernels kTetKernelsAvx512 = {press, measure, gather_corners};

}  // namespace trocar
