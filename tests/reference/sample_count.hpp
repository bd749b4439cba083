#pragma once
#include <algorithm>
#include <cstdint>
#include <cstdio>
namespace trocar {

// Under a sanitizer everything takes five to twenty times as long; the bits are those of the optimised build.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

// Number of random cases a test tries: `optimised` in optimised builds, and one in `divisor` of that in
// unoptimised ones (`debug`), where each takes some twenty times as long. Prints the number.
inline uint32_t sample_count(uint32_t optimised, uint32_t divisor) {
#ifdef __OPTIMIZE__
    static_cast<void>(divisor);
    return optimised;
#else
    const uint32_t count = std::max(1u, optimised / divisor);
    std::printf("[   figure ] %u cases, %u where the code is optimised\n", count, optimised);
    return count;
#endif
}

}  // namespace trocar
