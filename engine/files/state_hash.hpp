#pragma once
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>
namespace trocar {

// 64-bit hash of a sequence of plain values; equal bits give equal hashes on every machine of the same byte order.
struct StateHash {
    static constexpr size_t kLongRow = 256;     // bytes
    static constexpr size_t kWideRow = 4096;    // bytes, from this size on data are hashed in blocks
    static constexpr size_t kBlock = 1u << 18;  // bytes per block
    uint64_t value = 0x9e3779b97f4a7c15ull;

    // splitmix64 finaliser (Steele, Lea, Flood, OOPSLA 2014, figure 13) over a running state
    static uint64_t mix(uint64_t state, uint64_t word) {
        uint64_t z = state ^ word;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        return (z ^ (z >> 31)) + 0x9e3779b97f4a7c15ull;
    }
    void add_word(uint64_t word) { value = mix(value, word); }
    void add_bytes(const void* data, size_t size) {
        if (size >= kWideRow) {
            add_blocks(data, size);
            return;
        }
        const unsigned char* p = static_cast<const unsigned char*>(data);
        if (size >= kLongRow) {
            // each step depends on the preceding one: four parallel chains keep the multipliers busy
            uint64_t lane[4] = {mix(value, 1), mix(value, 2), mix(value, 3), mix(value, 4)}, word[4];
            for (; size >= sizeof word; p += sizeof word, size -= sizeof word) {
                std::memcpy(word, p, sizeof word);
                for (int i = 0; i < 4; ++i) lane[i] = mix(lane[i], word[i]);
            }
            for (const uint64_t l : lane) add_word(l);
        }
        for (; size >= 8; p += 8, size -= 8) {
            uint64_t word;
            std::memcpy(&word, p, 8);
            add_word(word);
        }
        if (size > 0) {
            uint64_t word = 0;
            std::memcpy(&word, p, size);
            add_word(word);
        }
    }
    template <typename T>
    void add(const T& v) {
        static_assert(std::has_unique_object_representations_v<T> || std::is_floating_point_v<T> || std::is_enum_v<T>,
                      "padding bytes would be hashed");
        add_bytes(&v, sizeof v);
    }

 private:
    // Data of kWideRow bytes and more: blocks of kBlock bytes are hashed separately, on all threads of the
    // caller's pool, and their hashes added in order. A block has 32 chains: word i is hashed into chain i %
    // 32; the bytes after the last whole 32 words follow the chains. The bits depend neither on threads nor
    // on the instruction set.
    void add_blocks(const void* data, size_t size);
};

}  // namespace trocar
