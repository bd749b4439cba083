#pragma once
#include <cstdint>
#include <vector>

namespace trocar {

// Sets of indices, 64 per word; the caller sizes the words.
inline void set_bit(std::vector<uint64_t>& bits, uint32_t i) { bits[i >> 6] |= uint64_t{1} << (i & 63); }
inline bool has_bit(const std::vector<uint64_t>& bits, uint32_t i) { return bits[i >> 6] >> (i & 63) & 1; }

// Calls visit(index) for every member, ascending.
template <typename Visit>
void for_each_bit(const std::vector<uint64_t>& bits, const Visit& visit) {
    for (uint32_t word = 0; word < bits.size(); ++word) {
        for (uint64_t left = bits[word]; left != 0; left &= left - 1) {
            visit(word * 64 + uint32_t(__builtin_ctzll(left)));
        }
    }
}

}  // namespace trocar
