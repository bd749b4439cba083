#include "systems/island_memory.hpp"

#include <algorithm>
#include <numeric>
namespace trocar {

void pick_large_islands(std::span<const uint32_t> size, uint32_t threads, std::vector<uint32_t>& order, std::vector<uint32_t>& own) {
    constexpr uint32_t kSmall = 2048;  // particles: a scratch of 2 MB
    const uint32_t count = uint32_t(size.size());
    own.assign(count, kNone);
    if (threads < 2) return;
    order.resize(count);
    std::iota(order.begin(), order.end(), 0u);
    const uint32_t looked_at = std::min(count, threads + 1);
    std::partial_sort(order.begin(), order.begin() + looked_at, order.end(),
                      [&](uint32_t a, uint32_t b) { return size[a] != size[b] ? size[a] > size[b] : a < b; });
    const uint32_t left = std::max(kSmall, count > threads ? size[order[threads]] : 0);
    for (uint32_t k = 0; k < looked_at && size[order[k]] > 2 * left; ++k) own[order[k]] = k;
}

}  // namespace trocar
