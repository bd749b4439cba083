#include "engine/open_rows.hpp"

#include <gtest/gtest.h>

#include <random>

#include "engine/geometry/contact_kernels.hpp"

namespace {
using namespace trocar;

// Contacts whose columns all tell the row's number.
Contacts numbered(uint32_t rows) {
    Contacts c;
    resize_contacts(c, rows);
    for (uint32_t i = 0; i < rows; ++i) {
        c.pair[i] = c.body[i] = c.other[i] = c.third[i] = c.triangle[i] = i;
        c.vertex[i] = {i, i};
        c.along[i] = c.across[i] = float(i);
        c.point[i] = c.closest[i] = c.normal[i] = Vec3d::Constant(i);
        c.distance[i] = i;
    }
    return c;
}
bool tells(const Contacts& c, size_t row, uint32_t i) {
    const Vec3d at = Vec3d::Constant(i);
    return c.pair[row] == i && c.body[row] == i && c.other[row] == i && c.vertex[row][0] == i && c.vertex[row][1] == i &&
           c.along[row] == float(i) && c.third[row] == i && c.across[row] == float(i) && c.point[row] == at && c.closest[row] == at &&
           c.normal[row] == at && c.distance[row] == i && c.triangle[row] == i;
}

// Old rows keep what they hold and their order; every new row has its place: at the front, at the end, several in one place,
// none; few rows and so many that several threads share the columns.
TEST(OpenRows, EveryColumnMakesRoom) {
    std::mt19937 random(1);
    for (const uint32_t rows : {0u, 1u, 7u, 5000u}) {
        for (const uint32_t added : {0u, 1u, 3u, 900u}) {
            std::vector<uint32_t> before(added);
            for (uint32_t& row : before) row = random() % (rows + 1);
            if (added > 1) before[0] = 0, before[1] = rows;
            std::sort(before.begin(), before.end());
            Contacts contacts = numbered(rows);
            open_rows(before, contacts);
            ASSERT_EQ(contacts.pair.size(), rows + added);
            uint32_t next = 0;
            for (uint32_t old = 0; old < rows; ++old) {
                while (next < added && before[next] <= old) ++next;
                EXPECT_TRUE(tells(contacts, old + next, old)) << rows << " " << added << " " << old;
            }
        }
    }
}

}  // namespace
