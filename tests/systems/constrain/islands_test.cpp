#include "systems/constrain/islands.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>
namespace trocar {
namespace {

ContactConstraints constraints_between(const std::vector<std::array<uint32_t, 2>>& bodies) {
    ContactConstraints constraints;
    for (const auto& [body, other] : bodies) {
        constraints.body.push_back(body);
        constraints.other.push_back(other);
    }
    return constraints;
}
std::vector<std::vector<uint32_t>> slices(const std::vector<Range>& ranges, const std::vector<uint32_t>& items) {
    std::vector<std::vector<uint32_t>> out;
    for (const Range& r : ranges) out.emplace_back(items.begin() + r.first, items.begin() + r.end());
    return out;
}

using Lists = std::vector<std::vector<uint32_t>>;

// Breaks when a static body joins two islands, a hand is left out, or an order is lost.
TEST(Islands, JoinedByRowsNotByStaticBodies) {
    Bodies bodies;
    bodies.motion = {Motion::kDeformable, Motion::kStatic,     Motion::kDeformable, Motion::kHand,
                     Motion::kKinematic,  Motion::kDeformable, Motion::kDeformable};
    const ContactConstraints constraints = constraints_between({{0, 1}, {1, 2}, {3, 5}, {4, 6}, {5, 3}, {6, 4}, {0, 1}});
    IslandsScratch scratch;
    Islands islands;
    for (int pass = 0; pass < 2; ++pass) {
        find_islands(bodies, constraints, scratch, islands);
        EXPECT_EQ(slices(islands.bodies, islands.body), (Lists{{0}, {2}, {3, 5}, {6}}));
        EXPECT_EQ(slices(islands.constraints, islands.constraint), (Lists{{0, 6}, {1}, {2, 4}, {3, 5}}));
    }
    find_islands(bodies, constraints_between({}), scratch, islands);
    EXPECT_EQ(slices(islands.bodies, islands.body), (Lists{{0}, {2}, {3}, {5}, {6}}));
    EXPECT_TRUE(islands.constraint.empty());
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
        find_islands(bodies, constraints_between(list), scratch, islands);

        std::vector<int> label(count, -1);
        Lists want_bodies, wanted;
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
            wanted.emplace_back();
        }
        for (uint32_t constraint = 0; constraint < list.size(); ++constraint) {
            wanted[label[joins(list[constraint][0]) ? list[constraint][0] : list[constraint][1]]].push_back(constraint);
        }
        EXPECT_EQ(slices(islands.bodies, islands.body), want_bodies);
        EXPECT_EQ(slices(islands.constraints, islands.constraint), wanted);
    }
}

}  // namespace
}  // namespace trocar
