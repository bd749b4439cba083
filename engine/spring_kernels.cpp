#include "engine/spring_kernels.hpp"

#include <cstring>

#include "engine/closest_point.hpp"
namespace trocar {

const SpringKernels& spring_kernels() {
    return std::strcmp(instruction_set(), "avx512") == 0 ? kSpringKernelsAvx512 : kSpringKernelsAvx2;
}

}  // namespace trocar
