#include "engine/base/ring.hpp"

#include <gtest/gtest.h>

#include <array>
#include <thread>
namespace trocar {
namespace {

TEST(Ring, GivesBackInOrderAndCountsWhatFoundNoRoom) {
    Ring<int> ring(3);  // rounded up to 4
    int value = 0;
    EXPECT_FALSE(ring.pop(value));
    for (int round = 0; round < 5; ++round) {
        for (int k = 0; k < 4; ++k) EXPECT_TRUE(ring.push(10 * round + k));
        EXPECT_FALSE(ring.push(-1));
        EXPECT_EQ(ring.lost(), static_cast<uint64_t>(round + 1));
        for (int k = 0; k < 4; ++k) {
            ASSERT_TRUE(ring.pop(value));
            EXPECT_EQ(value, 10 * round + k);
        }
        EXPECT_FALSE(ring.pop(value));
    }
}

// A writer and a reader at full speed: no value is torn, repeated or out of order, and missing ones were
// counted.
TEST(Ring, TwoThreadsLoseNothingUncounted) {
    using Block = std::array<uint64_t, 8>;
    constexpr uint64_t kValues = 200'000;
    Ring<Block> ring(64);
    uint64_t offered = 0;
    std::thread writer([&] {
        for (uint64_t k = 1; k <= kValues; ++k) {
            Block block;
            block.fill(k);
            // every second value is offered until it is accepted
            while (++offered, !ring.push(block) && k % 2 == 0) std::this_thread::yield();
        }
    });
    uint64_t seen = 0;
    bool whole = true, ordered = true, even_missed = false;
    for (Block block{}, last{}; last[0] < kValues; last = block) {
        while (!ring.pop(block)) std::this_thread::yield();
        for (const uint64_t n : block) whole = whole && n == block[0];
        ordered = ordered && block[0] > last[0];
        even_missed = even_missed || (block[0] - 1) / 2 > last[0] / 2;
        ++seen;
    }
    writer.join();
    EXPECT_TRUE(whole);
    EXPECT_TRUE(ordered);
    EXPECT_FALSE(even_missed);
    EXPECT_EQ(seen + ring.lost(), offered);
}

}  // namespace
}  // namespace trocar
