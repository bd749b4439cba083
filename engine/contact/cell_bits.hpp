#pragma once
#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "engine/mesh/contact_kernels.hpp"
namespace trocar {

// A grid with one bit per cell: finds the cells shared by several objects without key look-ups. Bits run
// along the third axis, lines of words along the second, so that bit order is the order of packed keys.
struct CellBits {
    uint32_t rows = 0, words = 0;             // lines along the second axis, words per line
    std::vector<uint64_t> own, any, several;  // cells of the present object, of the earlier ones, of two or more
    std::vector<uint32_t> first;              // per word with bits in `several`: number of bits set before it
};

// Clears cells up to `last` on each axis. False, without effect, if that takes more than `most_words` words.
inline bool clear_cells(const std::array<uint32_t, 4>& last, uint64_t most_words, CellBits& bits) {
    const uint64_t words = last[2] / 64 + 1, rows = last[1] + uint64_t{1}, planes = last[0] + uint64_t{1};
    if (words * rows > most_words || words * rows * planes > most_words) return false;
    bits.words = uint32_t(words);
    bits.rows = uint32_t(rows);
    for (auto* layer : {&bits.own, &bits.any, &bits.several}) layer->assign(words * rows * planes, 0);
    bits.first.resize(words * rows * planes);
    return true;
}

// Calls visit(word, mask) for the words of a range of cells, ascending; the mask has the range's bits in it.
template <typename Visit>
void for_each_word(const CellBits& bits, const CellRange& cells, const Visit& visit) {
    const uint32_t from = cells.first[2] / 64, to = cells.last[2] / 64;
    const uint64_t low = ~uint64_t{0} << cells.first[2] % 64, high = ~uint64_t{0} >> (63 - cells.last[2] % 64);
    for (uint32_t i = cells.first[0]; i <= cells.last[0]; ++i) {
        for (uint32_t j = cells.first[1]; j <= cells.last[1]; ++j) {
            const uint32_t row = (i * bits.rows + j) * bits.words;
            for (uint32_t w = from; w <= to; ++w) {
                visit(row + w, (w == from ? low : ~uint64_t{0}) & (w == to ? high : ~uint64_t{0}));
            }
        }
    }
}

// Ends an object whose cells are all in the range: cells that an earlier object also has become shared.
inline void end_object(const CellRange& all, CellBits& bits) {
    for_each_word(bits, all, [&](uint32_t word, uint64_t) {
        bits.several[word] |= bits.any[word] & bits.own[word];
        bits.any[word] |= bits.own[word];
        bits.own[word] = 0;
    });
}

// Counts the shared cells and writes their keys, ascending.
inline void rank_shared_cells(CellBits& bits, std::vector<uint64_t>& key) {
    key.clear();
    for (uint32_t word = 0; word < bits.several.size(); ++word) {
        uint64_t left = bits.several[word];
        if (left == 0) continue;
        bits.first[word] = uint32_t(key.size());
        const uint32_t row = word / bits.words;
        for (; left != 0; left &= left - 1) {
            key.push_back(pack_cell(row / bits.rows, row % bits.rows, word % bits.words * 64 + uint32_t(std::countr_zero(left))));
        }
    }
}

// Calls visit(rank) for the shared cells of a range, ascending; rank = index in the keys of
// rank_shared_cells.
template <typename Visit>
void for_each_shared_cell(const CellBits& bits, const CellRange& cells, const Visit& visit) {
    for_each_word(bits, cells, [&](uint32_t word, uint64_t mask) {
        const uint64_t several = bits.several[word];
        if ((several & mask) == 0) return;
        const uint32_t begin = bits.first[word] + uint32_t(std::popcount(several & ((mask & (0 - mask)) - 1)));
        const uint32_t end = begin + uint32_t(std::popcount(several & mask));
        for (uint32_t rank = begin; rank < end; ++rank) visit(rank);
    });
}

}  // namespace trocar
