#include "engine/files/state_hash.hpp"

#include <algorithm>
#include <array>

#include "engine/base/cpu.hpp"
#include "engine/files/state_hash_kernels.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

using MixRows = void (*)(unsigned long*, const unsigned char*, unsigned long);

uint64_t hash_of_block(MixRows mix_rows, const unsigned char* p, size_t size) {
    constexpr size_t kRow = kHashLanes * sizeof(uint64_t);
    unsigned long lane[kHashLanes];
    for (unsigned i = 0; i < kHashLanes; ++i) lane[i] = StateHash::mix(StateHash{}.value, i + 1);
    mix_rows(lane, p, size / kRow);
    StateHash hash;
    for (const unsigned long l : lane) hash.add_word(l);
    hash.add_bytes(p + size / kRow * kRow, size % kRow);
    return hash.value;
}

}  // namespace

void StateHash::add_blocks(const void* data, size_t size) {
    const MixRows mix_rows = isa() == Isa::kAvx512 ? mix_rows_avx512 : mix_rows_avx2;
    const unsigned char* p = static_cast<const unsigned char*>(data);
    std::array<uint64_t, kMostChunks> block;
    while (size > 0) {
        const size_t part = std::min(size, block.size() * kBlock);
        const uint32_t blocks = static_cast<uint32_t>((part + kBlock - 1) / kBlock);
        parallel_for(blocks, 1, [&](uint32_t begin, uint32_t end) {
            for (uint32_t b = begin; b < end; ++b) block[b] = hash_of_block(mix_rows, p + b * kBlock, std::min(kBlock, part - b * kBlock));
        });
        for (uint32_t b = 0; b < blocks; ++b) add_word(block[b]);
        p += part, size -= part;
    }
}

}  // namespace trocar
