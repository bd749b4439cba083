#include "systems/app/player/player_code.hpp"

#include <bit>
namespace trocar {
namespace {

template <typename Bits>
void put_bits(std::vector<uint8_t>& out, Bits bits) {
    for (size_t i = 0; i < sizeof bits; ++i) out.push_back(static_cast<uint8_t>(bits >> 8 * i));
}

void pass_numbers(const uint8_t*& at, uint32_t count) {
    for (; count > 0; ++at) count -= *at < 128;
}

}  // namespace

void put_float(std::vector<uint8_t>& out, double value) { put_bits(out, std::bit_cast<uint32_t>(static_cast<float>(value))); }
void put_double(std::vector<uint8_t>& out, double value) { put_bits(out, std::bit_cast<uint64_t>(value)); }

std::vector<uint8_t> join_moves(std::span<const uint8_t> first, std::span<const uint8_t> second, std::span<const uint32_t> coordinates) {
    std::vector<uint8_t> out;
    const uint8_t *a = first.data(), *b = second.data();
    for (const uint32_t count : coordinates) {
        const bool a_moves = take_number(a) & 1;
        const uint64_t state = take_number(b);
        const bool b_moves = state & 1;
        put_number(out, state | a_moves);
        if (a_moves && b_moves) {
            for (uint32_t i = 0; i < count; ++i) put_signed(out, take_signed(a) + take_signed(b));
            continue;
        }
        const uint8_t*& moving = a_moves ? a : b;
        const uint8_t* const begin = moving;
        if (a_moves || b_moves) pass_numbers(moving, count);
        out.insert(out.end(), begin, moving);
    }
    return out;
}

}  // namespace trocar
