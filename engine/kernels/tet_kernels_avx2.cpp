#include "engine/kernels/lanes_avx2.inl"
#include "engine/kernels/tet_kernels.hpp"
namespace trocar {
namespace {

#include "engine/kernels/tet_kernels.inl"

}  // namespace

extern const TetKernels kTetKernelsAvx2 = {press, press_neo_hookean, measure, gather_corners};

}  // namespace trocar
