#include "engine/kernels/lanes_avx512.inl"
#include "engine/kernels/spring_kernels.hpp"
namespace trocar {
namespace {

#include "engine/kernels/spring_kernels.inl"

}  // namespace

extern const SpringKernels kSpringKernelsAvx512 = {step, shape_sums, energy_sums, relaxing_sums};

}  // namespace trocar
