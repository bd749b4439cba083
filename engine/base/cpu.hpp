#pragma once
namespace trocar {

// Instruction set that the kernels of this process run with; both give the same bits. force_avx2() is for tests and benches.
enum class Isa { kAvx2, kAvx512 };
Isa isa();
const char* instruction_set();  // its name: "avx2" or "avx512"
void force_avx2(bool on);

template <typename Kernels>
const Kernels& kernels_of_isa(const Kernels& avx2, const Kernels& avx512) {
    return isa() == Isa::kAvx512 ? avx512 : avx2;
}

}  // namespace trocar
