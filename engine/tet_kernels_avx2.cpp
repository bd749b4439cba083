#include "engine/lanes_avx2.inl"
#include "engine/tet_kernels.hpp"
namespace trocar {
namespace {

#include "engine/tet_kernels.inl"

}  // namespace

extern const TetKernels kTetKernelsAvx2 = {press, measure, gather_corners};

}  // namespace trocar
