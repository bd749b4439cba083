#pragma once
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>
namespace trocar {

// 64-bit hash of a sequence of plain values; equal bits give equal hashes on every machine of the same byte order.
struct StateHash {
    uint64_t value = 0x9e3779b97f4a7c15ull;

    void add_word(uint64_t word) {
        // splitmix64 finaliser (Steele, Lea, Flood, OOPSLA 2014, figure 13) over a running state
        uint64_t z = value ^ word;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        value = (z ^ (z >> 31)) + 0x9e3779b97f4a7c15ull;
    }
    void add_bytes(const void* data, size_t size) {
        const unsigned char* p = static_cast<const unsigned char*>(data);
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
};

}  // namespace trocar
