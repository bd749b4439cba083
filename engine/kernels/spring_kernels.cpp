#include "engine/kernels/spring_kernels.hpp"

#include "engine/base/cpu.hpp"
namespace trocar {

const SpringKernels& spring_kernels() { return kernels_of_isa(kSpringKernelsAvx2, kSpringKernelsAvx512); }

}  // namespace trocar
