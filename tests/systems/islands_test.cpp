#include "systems/islands.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>
namespace trocar {
namespace {

ContactRows rows_between(const std::vector<std::array<uint32_t, 2>>& bodies) {
    ContactRows rows;
    for (const auto& [body, other] : bodies) {
        rows.body.push_back(body);
        rows.other.push_back(other);
    }
    return rows;
}
std::vector<std::vector<uint32_t>> slices(const std::vector<Range>& ranges, const std::vector<uint32_t>& items) {
    std::vector<std::vector<uint32_t>> out;
    for (const Range& r : ranges) out.emplace_back(items.begin() + r.first, items.begin() + r.end());
    return out;
}

using Lists = std::vector<std::vector<uint32_t>>;

// Breaks when a static body ties two islands together, a hand is left out, or an order is lost.
TEST(Islands, JoinedByRowsNotByStaticBodies) {
    Bodies bodies;
    bodies.motion = {Motion::kDeformable, Motion::kStatic,     Motion::kDeformable, Motion::kHand,
                     Motion::kKinematic,  Motion::kDeformable, Motion::kDeformable};
    const ContactRows rows = rows_between({{0, 1}, {1, 2}, {3, 5}, {4, 6}, {5, 3}, {6, 4}, {0, 1}});
    IslandsScratch scratch;
    Islands islands;
    for (int pass = 0; pass < 2; ++pass) {
        find_islands(bodies, rows, scratch, islands);
        EXPECT_EQ(slices(islands.bodies, islands.body), (Lists{{0}, {2}, {3, 5}, {6}}));
        EXPECT_EQ(slices(islands.rows, islands.row), (Lists{{0, 6}, {1}, {2, 4}, {3, 5}}));
    }
    find_islands(bodies, rows_between({}), scratch, islands);
    EXPECT_EQ(slices(islands.bodies, islands.body), (Lists{{0}, {2}, {3}, {5}, {6}}));
    EXPECT_TRUE(islands.row.empty());
}

// Against flood fill on random graphs.
TEST(Islands, EqualFloodFill) {
    std::mt19937 random(3);
    IslandsScratch scratch;
    Islands islands;
    for (int trial = 0; trial < 50; ++trial) {
        const uint32_t count = 1 + random() % 60;
        Bodies bodies;
        for (uint32_t i = 0; i < count; ++i) bodies.motion.push_back(Motion(random() % 4));
        const auto joins = [&](uint32_t i) { return bodies.motion[i] == Motion::kDeformable || bodies.motion[i] == Motion::kHand; };
        std::vector<std::array<uint32_t, 2>> list;
        for (uint32_t i = random() % 80; i > 0; --i) list.push_back({uint32_t(random() % count), uint32_t(random() % count)});
        std::erase_if(list, [&](const auto& r) { return r[0] == r[1] || (!joins(r[0]) && !joins(r[1])); });
        find_islands(bodies, rows_between(list), scratch, islands);

        std::vector<int> label(count, -1);
        Lists want_bodies, want_rows;
        for (uint32_t start = 0; start < count; ++start) {
            if (label[start] >= 0 || !joins(start)) continue;
            std::set<uint32_t> members{start};
            for (bool grew = true; grew;) {
                grew = false;
                for (const auto& [a, b] : list) {
                    if (!joins(a) || !joins(b) || members.count(a) == members.count(b)) continue;
                    members.insert(a);
                    members.insert(b);
                    grew = true;
                }
            }
            for (const uint32_t m : members) label[m] = int(want_bodies.size());
            want_bodies.emplace_back(members.begin(), members.end());
            want_rows.emplace_back();
        }
        for (uint32_t row = 0; row < list.size(); ++row) {
            want_rows[label[joins(list[row][0]) ? list[row][0] : list[row][1]]].push_back(row);
        }
        EXPECT_EQ(slices(islands.bodies, islands.body), want_bodies);
        EXPECT_EQ(slices(islands.rows, islands.row), want_rows);
    }
}

}  // namespace
}  // namespace trocar
