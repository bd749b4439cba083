#pragma once
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>
namespace trocar {

// Integers of few bytes (LEB128: seven bits a byte, lowest first), signed ones zigzag: small values of either sign take one byte.
inline void put_number(std::vector<uint8_t>& out, uint64_t value) {
    for (; value > 127; value >>= 7) out.push_back(static_cast<uint8_t>(value | 128));
    out.push_back(static_cast<uint8_t>(value));
}
inline void put_signed(std::vector<uint8_t>& out, int64_t value) {
    put_number(out, static_cast<uint64_t>(value) << 1 ^ static_cast<uint64_t>(value >> 63));
}
void put_float(std::vector<uint8_t>& out, double value);  // as four bytes
void put_double(std::vector<uint8_t>& out, double value);

inline uint64_t take_number(const uint8_t*& at) {
    uint64_t value = 0;
    for (int shift = 0;; shift += 7) {
        const uint8_t byte = *at++;
        value |= static_cast<uint64_t>(byte & 127) << shift;
        if (byte < 128) return value;
    }
}
inline int64_t take_signed(const uint8_t*& at) {
    const uint64_t value = take_number(at);
    return static_cast<int64_t>(value >> 1) ^ -static_cast<int64_t>(value & 1);
}

// Moves between two frames hold for every body twice its state, plus one if it moved, and then a signed number per coordinate:
// its step. Returns `first` followed by `second` as one. `coordinates`: per body.
std::vector<uint8_t> join_moves(std::span<const uint8_t> first, std::span<const uint8_t> second, std::span<const uint32_t> coordinates);

}  // namespace trocar
