#include "engine/files/state_hash.hpp"

#include <gtest/gtest.h>

#include "engine/base/cpu.hpp"
#include "engine/jobs/thread_pool.hpp"
namespace {

using trocar::StateHash;

// Distinct words, cut to `size` bytes.
std::vector<unsigned char> noise(size_t size) {
    std::vector<unsigned char> bytes((size + 7) / 8 * 8);
    uint64_t word = 1;
    for (size_t i = 0; i < bytes.size() / 8; ++i) {
        word = StateHash::mix(word, i);
        std::memcpy(bytes.data() + 8 * i, &word, 8);
    }
    bytes.resize(size);
    return bytes;
}

uint64_t hash_of(const std::vector<unsigned char>& bytes, size_t from = 0) {
    StateHash hash;
    hash.add_bytes(bytes.data() + from, bytes.size() - from);
    return hash.value;
}

// Hashes at every threshold and on both sides of it, from a Python program written from the description
// alone. Fails when a constant, the order of chains or blocks, or the treatment of the rest of a block
// changes, and when an instruction set or a number of threads gives other bits.
TEST(StateHash, IsTheSameForEveryInstructionSetAndAnyThreads) {
    struct Row {
        size_t size;
        uint64_t hash;
    };
    constexpr Row kRows[] = {{0, 0x9e3779b97f4a7c15},      {5, 0x228f4b300d7a162b},     {255, 0xc9b9f589e2c42982},
                             {256, 0x4475d2ada1ed33db},    {300, 0x8cc9e41a7ff6411},    {4095, 0x4a4cbb54b69900e5},
                             {4096, 0x44fbccbf73f701da},   {4100, 0x36bff502b1d2aa24},  {262144, 0x187541bc89bf427b},
                             {262149, 0xe91a561b3ace7256}, {600001, 0xd5cf1a265f634b17}};
    for (const bool avx2 : {false, true}) {
        for (const uint32_t threads : {1u, 2u, 3u}) {
            trocar::force_avx2(avx2);
            trocar::ThreadPool pool(threads);
            pool.run([&] {
                for (const Row& row : kRows)
                    EXPECT_EQ(hash_of(noise(row.size)), row.hash) << row.size << " bytes, AVX2 " << avx2 << ", threads " << threads;
            });
        }
    }
    trocar::force_avx2(false);
}

// Fails when a byte of long data is skipped: at the end of a block, of a batch of 64 blocks, of the data.
TEST(StateHash, SeesEveryByteWhereBlocksMeet) {
    std::vector<unsigned char> bytes = noise(65 * StateHash::kBlock + 13);
    const uint64_t before = hash_of(bytes);
    for (const size_t edge : {size_t{0}, StateHash::kBlock, 64 * StateHash::kBlock, 65 * StateHash::kBlock, bytes.size()}) {
        for (size_t at = edge < 16 ? 0 : edge - 16; at < std::min(edge + 16, bytes.size()); ++at) {
            bytes[at] ^= 0x40;
            EXPECT_NE(hash_of(bytes), before) << "byte " << at;
            bytes[at] ^= 0x40;
        }
    }
}

// Fails when blocks or chains are combined regardless of their order: permuted contents would have the same
// hash.
TEST(StateHash, SeesWhatChangedPlaces) {
    const std::vector<unsigned char> bytes = noise(3 * StateHash::kBlock);
    const auto swapped = [&](size_t a, size_t b, size_t size) {
        std::vector<unsigned char> other = bytes;
        for (size_t i = 0; i < size; ++i) std::swap(other[a + i], other[b + i]);
        return hash_of(other);
    };
    EXPECT_NE(swapped(0, StateHash::kBlock, StateHash::kBlock), hash_of(bytes));
    EXPECT_NE(swapped(0, 8, 8), hash_of(bytes));
    EXPECT_NE(swapped(0, 256, 8), hash_of(bytes));
}

}  // namespace
