#include "engine/contact/insert_contacts.hpp"

#include <gtest/gtest.h>

#include <random>

#include "engine/mesh/contact_kernels.hpp"

namespace {
using namespace trocar;

// Contacts whose columns all contain the element's number.
Contacts numbered(uint32_t count) {
    Contacts c;
    resize_contacts(c, count);
    for (uint32_t i = 0; i < count; ++i) {
        c.pair[i] = c.body[i] = c.other[i] = c.third[i] = c.triangle[i] = i;
        c.vertex[i] = {i, i};
        c.along[i] = c.across[i] = float(i);
        c.point[i] = c.closest[i] = c.normal[i] = Vec3d::Constant(i);
        c.distance[i] = i;
    }
    return c;
}
bool tells(const Contacts& c, size_t slot, uint32_t i) {
    const Vec3d at = Vec3d::Constant(i);
    return c.pair[slot] == i && c.body[slot] == i && c.other[slot] == i && c.vertex[slot][0] == i && c.vertex[slot][1] == i &&
           c.along[slot] == float(i) && c.third[slot] == i && c.across[slot] == float(i) && c.point[slot] == at && c.closest[slot] == at &&
           c.normal[slot] == at && c.distance[slot] == i && c.triangle[slot] == i;
}

// Old elements keep their values and order. Every new one is inserted at its index: at the front, at the end,
// several at one index, none; with few elements and with so many that several threads share the columns.
TEST(OpenRows, EveryColumnMakesRoom) {
    std::mt19937 random(1);
    for (const uint32_t count : {0u, 1u, 7u, 5000u}) {
        for (const uint32_t added : {0u, 1u, 3u, 900u}) {
            std::vector<uint32_t> before(added);
            for (uint32_t& slot : before) slot = random() % (count + 1);
            if (added > 1) before[0] = 0, before[1] = count;
            std::sort(before.begin(), before.end());
            Contacts contacts = numbered(count);
            open_rows(before, contacts);
            ASSERT_EQ(contacts.pair.size(), count + added);
            uint32_t next = 0;
            for (uint32_t old = 0; old < count; ++old) {
                while (next < added && before[next] <= old) ++next;
                EXPECT_TRUE(tells(contacts, old + next, old)) << count << " " << added << " " << old;
            }
        }
    }
}

}  // namespace
