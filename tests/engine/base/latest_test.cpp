#include "engine/base/latest.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>
#include <vector>
namespace trocar {
namespace {

TEST(Latest, NothingIsNewBeforeTheFirstValue) {
    Latest<int> mailbox;
    EXPECT_FALSE(mailbox.update());
    EXPECT_EQ(mailbox.front(), 0);
}

TEST(Latest, TheNewestValueWinsAndIsNewOnce) {
    Latest<int> mailbox;
    for (int k = 1; k <= 3; ++k) {
        mailbox.back() = k;
        mailbox.publish();
    }
    EXPECT_TRUE(mailbox.update());
    EXPECT_EQ(mailbox.front(), 3);
    EXPECT_FALSE(mailbox.update());
    EXPECT_EQ(mailbox.front(), 3);
    mailbox.back() = 4;
    EXPECT_EQ(mailbox.front(), 3);  // not handed over yet
    mailbox.publish();
    EXPECT_TRUE(mailbox.update());
    EXPECT_EQ(mailbox.front(), 4);
}

// The reader's value stays unchanged whatever the writer does, and the writer's slot is never the reader's.
TEST(Latest, TheReadersSlotIsItsOwn) {
    Latest<int> mailbox;
    int next = 0;
    for (int round = 0; round < 10; ++round) {
        for (int k = 0; k <= round % 3; ++k) {
            mailbox.back() = ++next;
            mailbox.publish();
        }
        ASSERT_TRUE(mailbox.update());
        const int held = mailbox.front();
        EXPECT_EQ(held, next);
        for (int k = 0; k < 5; ++k) {
            EXPECT_NE(&mailbox.back(), &mailbox.front());
            mailbox.back() = ++next;
            mailbox.publish();
            EXPECT_EQ(mailbox.front(), held);
        }
    }
}

// Every slot must return to the writer at some time: otherwise memory would grow.
TEST(Latest, SlotsKeepTheirCapacity) {
    Latest<std::vector<int>> mailbox;
    for (int k = 0; k < 6; ++k) {
        mailbox.back().assign(1000, k);
        mailbox.publish();
        mailbox.update();
    }
    for (int k = 0; k < 6; ++k) {
        EXPECT_GE(mailbox.back().capacity(), 1000u);
        mailbox.publish();
        mailbox.update();
    }
}

// A writer and a reader at full speed: values arrive whole and in order, and the last one arrives. Breaks
// (also under the thread sanitizer) when a value is torn or a slot is used by both threads at once.
TEST(Latest, TwoThreadsSeeWholeValuesInOrder) {
    struct Block {
        uint64_t number[64] = {};
    };
    constexpr uint64_t kValues = 200'000;
    Latest<Block> mailbox;
    std::thread writer([&] {
        for (uint64_t k = 1; k <= kValues; ++k) {
            std::fill(std::begin(mailbox.back().number), std::end(mailbox.back().number), k);
            mailbox.publish();
        }
    });
    uint64_t last = 0, seen = 0;
    bool whole = true, ordered = true;
    while (last < kValues) {
        if (!mailbox.update()) {
            std::this_thread::yield();
            continue;
        }
        const Block& block = mailbox.front();
        for (const uint64_t n : block.number) whole = whole && n == block.number[0];
        ordered = ordered && block.number[0] > last;
        last = block.number[0];
        ++seen;
    }
    writer.join();
    EXPECT_TRUE(whole);
    EXPECT_TRUE(ordered);
    EXPECT_EQ(last, kValues);
    EXPECT_GT(seen, 0u);
}

}  // namespace
}  // namespace trocar
