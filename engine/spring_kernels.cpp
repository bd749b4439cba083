#include "engine/spring_kernels.hpp"

#include <cstring>

#include "engine/closest_point.hpp"
#include "engine/implicit_kernels.hpp"
namespace trocar {

const SpringKernels& spring_kernels() { return std::strcmp(instruction_set(), "avx512") == 0 ? kSpringKernelsAvx512 : kSpringKernelsAvx2; }

const ImplicitKernels& implicit_kernels() {
    return std::strcmp(instruction_set(), "avx512") == 0 ? kImplicitKernelsAvx512 : kImplicitKernelsAvx2;
}

}  // namespace trocar
