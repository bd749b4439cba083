#include "engine/kernels/lanes_avx2.inl"
#include "engine/kernels/spring_kernels.hpp"
namespace trocar {
namespace {

#include "engine/kernels/spring_kernels.inl"

}  // namespace

extern const SpringKernels kSpringKernelsAvx2 = {step, shape_sums, energy_sums, relaxing_sums};

}  // namespace trocar
