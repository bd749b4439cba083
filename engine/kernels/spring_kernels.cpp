#include "engine/kernels/spring_kernels.hpp"

#include "engine/base/cpu.hpp"
#include "engine/kernels/implicit_kernels.hpp"
namespace trocar {

const SpringKernels& spring_kernels() { return kernels_of_isa(kSpringKernelsAvx2, kSpringKernelsAvx512); }

const ImplicitKernels& implicit_kernels() { return kernels_of_isa(kImplicitKernelsAvx2, kImplicitKernelsAvx512); }

}  // namespace trocar
