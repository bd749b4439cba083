#include "engine/base/cpu.hpp"

#include <atomic>
namespace trocar {
namespace {

std::atomic<bool>& avx2_forced() {
    static std::atomic<bool> forced{false};
    return forced;
}

}  // namespace

Isa isa() {
    static const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                                   __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    return has_avx512 && !avx2_forced().load(std::memory_order_relaxed) ? Isa::kAvx512 : Isa::kAvx2;
}

const char* instruction_set() { return isa() == Isa::kAvx512 ? "avx512" : "avx2"; }

void force_avx2(bool on) { avx2_forced().store(on, std::memory_order_relaxed); }

}  // namespace trocar
