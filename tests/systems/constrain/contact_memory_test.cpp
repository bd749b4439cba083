#include "systems/constrain/contact_memory.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace {
using namespace trocar;

struct Constraint {
    uint32_t body, other;
    std::array<uint32_t, 2> vertex;
    float along = 0;
    Vec3d impulse = Vec3d::Zero(), warm_start = Vec3d::Zero();
    uint32_t third = kNone;
    double distance = 0;
    uint32_t contact = 0;
};
ContactConstraints constraints_of(const std::vector<Constraint>& list) {
    ContactConstraints constraints;
    for (const Constraint& r : list) {
        constraints.contact.push_back(r.contact);
        constraints.body.push_back(r.body);
        constraints.other.push_back(r.other);
        constraints.vertex.push_back(r.vertex);
        constraints.along.push_back(r.along);
        constraints.third.push_back(r.third);
        constraints.distance.push_back(r.distance);
        constraints.impulse.push_back(r.impulse);
        constraints.warm_start.push_back(r.warm_start);
    }
    return constraints;
}
Vec3d force(double x) { return {x, 0, 1}; }

// Every point gets its own warm-start impulse: sides of a pair, vertex and edge, two points of one edge, an
// edge that slid on, and crossing edges, out of order. Zero impulses are forgotten, except of edge contacts.
TEST(ContactMemory, RowsFindWhatTheirPointsCarried) {
    const Vec3d some(0, 0, 1e-3);
    ContactMemory memory;
    remember_contacts(constraints_of({{0, 1, {5, 5}, 0, some, force(1)},
                                      {0, 1, {6, 6}, 0, Vec3d::Zero(), Vec3d::Zero()},
                                      {0, 1, {5, 9}, 0.2f, some, force(2)},
                                      {0, 1, {5, 9}, 0.7f, some, force(3)},
                                      {0, 1, {7, 9}, 0.5f, Vec3d::Zero(), Vec3d::Zero()},
                                      {0, 1, {7, 9}, 0.5f, some, force(9), 11},
                                      {1, 0, {5, 5}, 0, some, force(4)},
                                      {0, 2, {5, 5}, 0, some, force(5)},
                                      {0, 1, {1, 2}, 0.5f, some, force(6)},
                                      {0, 1, {2, 3}, 0.5f, some, force(7), kNone, 1e-3, kNone},
                                      {0, 1, {3, 4}, 0.5f, Vec3d::Zero(), Vec3d::Zero(), kNone, 1e-3, kNone}}),
                      memory);
    EXPECT_EQ(memory.body.size(), 8u);

    ContactConstraints now = constraints_of({{0, 1, {4, 4}},
                                             {0, 1, {5, 5}},
                                             {0, 1, {6, 6}},
                                             {0, 1, {5, 9}, 0.75f},
                                             {0, 1, {5, 9}, 0.45f},
                                             {0, 1, {7, 9}, 0.5f},
                                             {0, 1, {7, 9}, 0.5f, Vec3d::Zero(), Vec3d::Zero(), 11},
                                             {1, 0, {5, 5}},
                                             {0, 2, {5, 5}},
                                             {1, 2, {5, 5}},
                                             {0, 1, {1, 2}, 0.52f},
                                             {0, 1, {5, 5}, 0, Vec3d::Zero(), Vec3d::Zero(), kNone, -1e-4}});
    ContactMemoryScratch scratch;
    ContactMemoryOrder order;
    order_memory(memory, scratch, order);
    recall_contacts(memory, order, now);
    const std::vector<double> expected{0, 1, 0, 3, 0, 0, 0, 4, 5, 0, 6, 0};
    ASSERT_EQ(now.warm_start.size(), expected.size());
    for (size_t i = 0; i < expected.size(); ++i) {
        EXPECT_EQ(now.warm_start[i], expected[i] == 0 ? Vec3d(0, 0, 0) : force(expected[i])) << i;
    }
    recall_contacts({}, order, now);
    for (const Vec3d& f : now.warm_start) EXPECT_EQ(f, Vec3d(0, 0, 0));
}

// Thousands of constraints, shared by several threads, get the result of a full search; in order, and
// followed by those of crossing edges, which are out of order (some ascend, some do not), in memory too.
TEST(ContactMemory, LongListsFindTheSameAsASearch) {
    std::vector<Constraint> before, after;
    for (uint32_t a = 0; a < 40; ++a)
        for (uint32_t b = a + 1; b < a + 4; ++b)
            for (uint32_t v = 0; v < 50; ++v) {
                const Vec3d some(0, 0, 1e-3);
                if (v % 3 != 0) before.push_back({a, b, {v, v}, 0, some, force(a + 0.01 * b + 1e-4 * v)});
                if (v % 4 != 0) after.push_back({a, b, {v, v}});
            }
    for (uint32_t i = 0; i < 30; ++i) {
        before.push_back({i, i + 1, {i, i + 7}, 0.5f, Vec3d(1, 0, 0), force(100 + i)});
        after.push_back({29 - i, 30 - i, {29 - i, 36 - i}, 0.52f});
    }
    for (uint32_t i = 0; i < 29; ++i) {
        before.push_back({90 - i, 91 - i, {i, i + 7}, 0.5f, Vec3d(1, 0, 0), force(200 + i)});
        after.push_back({62 + i, 63 + i, {28 - i, 35 - i}, 0.5f});
    }
    ContactMemory memory;
    remember_contacts(constraints_of(before), memory);
    ContactConstraints now = constraints_of(after);
    ContactMemoryScratch scratch;
    ContactMemoryOrder order;
    order_memory(memory, scratch, order);
    recall_contacts(memory, order, now);
    uint32_t found = 0;
    for (size_t i = 0; i < after.size(); ++i) {
        const auto same = [&](const Constraint& r) {
            return r.body == after[i].body && r.other == after[i].other && r.vertex == after[i].vertex;
        };
        const auto at = std::find_if(before.begin(), before.end(), same);
        found += at != before.end();
        EXPECT_EQ(now.warm_start[i], at != before.end() ? at->warm_start : Vec3d(0, 0, 0)) << i;
    }
    EXPECT_EQ(found, 120u * 25 + 30 + 29);
}

}  // namespace
