#include "systems/advance/islands.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
namespace trocar {
namespace {

std::vector<uint32_t> own_of(const std::vector<uint32_t>& size, uint32_t threads) {
    std::vector<uint32_t> order, own{7, 7, 7};  // results of an earlier call have no effect
    pick_large_islands(size, threads, order, own);
    return own;
}

// Breaks when a heap among single bodies is shared: every thread's scratch would grow to its size.
TEST(IslandMemory, AHeapAmongSingleBodiesHasItsOwn) {
    std::vector<uint32_t> size(200, 102);
    size[120] = 80'000;
    std::vector<uint32_t> expected(200, kNone);
    expected[120] = 0;
    for (const uint32_t threads : {2, 3, 16}) EXPECT_EQ(own_of(size, threads), expected) << threads;
}

TEST(IslandMemory, OneThreadSharesAll) { EXPECT_EQ(own_of({80'000, 102, 102}, 1), (std::vector<uint32_t>{kNone, kNone, kNone})); }

// Breaks when a hundred similar organs get a hundred scratches: a thread uses only one at a time.
TEST(IslandMemory, LikeIslandsShare) {
    EXPECT_EQ(own_of(std::vector<uint32_t>(100, 10'000), 4), std::vector<uint32_t>(100, kNone));
    EXPECT_EQ(own_of({10'000, 20'000, 10'000}, 2), (std::vector<uint32_t>{kNone, kNone, kNone})) << "no more than twice as large";
    EXPECT_EQ(own_of({10'000, 20'001, 10'000}, 2), (std::vector<uint32_t>{kNone, 0, kNone}));
}

TEST(IslandMemory, FewerIslandsThanThreads) {
    EXPECT_EQ(own_of({}, 4), std::vector<uint32_t>{});
    EXPECT_EQ(own_of({9'000, 100, 10'000, 0}, 4), (std::vector<uint32_t>{1, kNone, 0, kNone}));
    EXPECT_EQ(own_of({9'000, 9'000}, 2), (std::vector<uint32_t>{0, 1})) << "the first of equal ones comes first";
}

// The total size of all scratches is bounded by the islands and by twice the largest shared one, for any
// sizes. Breaks when a scratch is assigned twice, to a small island, or not to a large one.
TEST(IslandMemory, RoomIsBoundedByTheIslands) {
    std::mt19937 random(5);
    for (int trial = 0; trial < 2000; ++trial) {
        const uint32_t count = random() % 40, threads = 2 + random() % 8;
        std::vector<uint32_t> size(count);
        for (uint32_t& s : size) s = uint32_t(std::pow(10.0, 6.0 * double(random()) / double(std::mt19937::max())));
        const std::vector<uint32_t> own = own_of(size, threads);
        std::vector<uint32_t> sorted = size, used;
        std::sort(sorted.rbegin(), sorted.rend());
        const uint32_t left = std::max(2048u, count > threads ? sorted[threads] : 0u);
        for (uint32_t i = 0; i < count; ++i) {
            EXPECT_EQ(own[i] != kNone, size[i] > 2 * left) << "trial " << trial << " island " << i;
            if (own[i] == kNone) continue;
            used.push_back(own[i]);
            EXPECT_EQ(size[i], sorted[own[i]]);
        }
        std::sort(used.begin(), used.end());
        for (uint32_t k = 0; k < used.size(); ++k) EXPECT_EQ(used[k], k);
        EXPECT_LE(used.size(), threads);
    }
}

}  // namespace
}  // namespace trocar
