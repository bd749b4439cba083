#include "systems/contact_rows.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "engine/nose_first.hpp"
#include "tests/systems/contact_scene.hpp"
namespace trocar::test {
namespace {

ContactScene pressed() {
    ContactScene scene({{make_noisy_sphere(12, 0.1, 0.05, 0), Motion::kDeformable, Vec3d(1, 2, 3), {}},
                        {make_noisy_sphere(9, 0.07, 0.05, 1), Motion::kHand, Vec3d(1.12, 2.03, 3.01), turn({1, 2, 0}, 1)}});
    scene.bodies.tissue[0].friction = 0.05;
    scene.bodies.tissue[1].friction = 0.3;
    return scene;
}

uint32_t count_nose_first(const ContactScene& scene) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) count += leaves_nose_first(scene.surfaces(), scene.contacts, i);
    return count;
}

// A row is its contact, with the plane through `closest`: breaks on wrong weights, a normal in the wrong frame, a lost
// row.
TEST(ContactRows, PlaneGoesThroughTheClosestPoint) {
    ContactScene scene = pressed();
    scene.run();
    const ContactRows& rows = scene.rows;
    ASSERT_EQ(rows.body.size() + count_nose_first(scene), scene.contacts.pair.size());
    ASSERT_GT(rows.body.size(), 50u);
    EXPECT_TRUE(std::is_sorted(rows.contact.begin(), rows.contact.end()));
    for (uint32_t i = 0; i < rows.body.size(); ++i) {
        const uint32_t c = rows.contact[i];
        EXPECT_EQ(rows.weight[i][0] + rows.weight[i][1] + rows.weight[i][2], 1.0f);
        Vec3d p = Vec3d::Zero();
        for (int k = 0; k < 3; ++k) {
            EXPECT_GE(rows.weight[i][k], 0);
            p += double(rows.weight[i][k]) * vertex_position(scene.surfaces(), rows.other[i], rows.triangle[i][k]);
        }
        EXPECT_LT((p - scene.contacts.closest[c]).norm(), 1e-8);  // 2^-23 of an edge
        EXPECT_EQ(rows.distance[i], scene.contacts.distance[c]);
        const Vec3d normal = direction_to_world(scene.surfaces(), rows.other[i], rows.normal[i]);
        EXPECT_LT((normal - scene.contacts.normal[c]).norm(), 1e-12);
        EXPECT_EQ(rows.friction[i], 0.3f);
        EXPECT_EQ(rows.impulse[i], Vec3d(Vec3d::Zero()));
    }
}

// Thesis 4.2: inside points share the pair's direction, opposite for the two bodies, with projected depths.
TEST(ContactRows, ThesisDirectionProjectsTheDepths) {
    ContactScene scene = pressed();
    scene.settings.contact.direction = ResponseDirection::kThesis;
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    const Vec3d way = scene.penetrations.direction[0];
    uint32_t shortened = 0;
    for (uint32_t i = 0; i < scene.rows.body.size(); ++i) {
        const double depth = -scene.contacts.distance[i];
        const Vec3d normal = direction_to_world(scene.surfaces(), scene.rows.other[i], scene.rows.normal[i]);
        if (depth <= 0) {
            EXPECT_LT((normal - scene.contacts.normal[i]).norm(), 1e-12);
            continue;
        }
        const Vec3d out = scene.rows.body[i] == 1 ? way : Vec3d(-way);
        EXPECT_LT((normal - out).norm(), 1e-12);
        EXPECT_NEAR(-scene.rows.distance[i], depth * std::max(0.0, scene.contacts.normal[i].dot(out)), 1e-15);
        shortened += -scene.rows.distance[i] < 0.99 * depth;
    }
    EXPECT_GT(shortened, 5u);
    EXPECT_NEAR(-scene.rows.distance[scene.penetrations.witness[0]], scene.penetrations.depth[0], 1e-15);
}

// P27: all vertices inside and too few rows: the deepest stay, the count says how many went, the other body keeps its
// own.
TEST(ContactRows, P27_TheShallowestAreDroppedAndCounted) {
    ContactScene scene({{make_noisy_sphere(12, 0.1, 0.05, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(8, 0.05, 0.05, 1), Motion::kDeformable, Vec3d(0.01, 0, 0), {}},
                        {make_noisy_sphere(4, 0.03, 0, 1), Motion::kDeformable, Vec3d(-0.095, 0, 0), {}}});
    scene.settings.contact.row_capacity = 70;
    scene.run();
    std::vector<std::vector<double>> all(3), kept(3);
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) all[scene.contacts.body[i]].push_back(scene.contacts.distance[i]);
    for (uint32_t i = 0; i < scene.rows.body.size(); ++i) kept[scene.rows.body[i]].push_back(scene.rows.distance[i]);
    ASSERT_GT(all[1].size(), 300u);
    ASSERT_GT(all[2].size(), 5u);
    ASSERT_LT(all[2].size(), 70u);
    uint64_t dropped = 0;
    for (int body = 0; body < 3; ++body) {
        std::sort(all[body].begin(), all[body].end());
        std::sort(kept[body].begin(), kept[body].end());
        dropped += all[body].size() - kept[body].size();
        all[body].resize(std::min<size_t>(all[body].size(), 70));
        EXPECT_EQ(all[body], kept[body]) << body;
    }
    EXPECT_EQ(scene.report.dropped_contacts, dropped);
    EXPECT_TRUE(std::is_sorted(scene.rows.contact.begin(), scene.rows.contact.end()));
}

class ThroughAWall : public testing::TestWithParam<Motion> {};
INSTANTIATE_TEST_SUITE_P(ContactRows, ThroughAWall, testing::Values(Motion::kHand, Motion::kFree),
                         [](const auto& motion) { return motion.param == Motion::kHand ? "InTheHand" : "Free"; });

// A ball has passed the middle of a thin wall that deforms: there its nearest surface is the wall's far side, which the ball
// would leave nose first, on through the wall. Those points have no row; all others lead back. Breaks when the wall
// holds the ball from both sides, and when points short of the middle lose theirs.
TEST_P(ThroughAWall, NothingLeadsOnThroughAThinWall) {
    constexpr double kRadius = 0.05, kPast = 1.4e-3;  // m; the wall is 2e-3 thick, its near side at z = 0
    ContactScene scene({{make_box({0.2, 0.2, 2e-3}, {20, 20, 1}), Motion::kDeformable, Vec3d(0, 0, -1e-3), {}},
                        {make_noisy_sphere(24, kRadius, 0, 0), GetParam(), Vec3d(0, 0, kRadius - kPast), turn({1, 2, 0}, 1)}});
    scene.run();
    const Contacts& contacts = scene.contacts;
    const auto is_past = [&](uint32_t i) {
        return contacts.body[i] == 1 && contacts.vertex[i][0] == contacts.vertex[i][1] && contacts.point[i].z() < -1.05e-3;
    };
    const std::set<uint32_t> kept(scene.rows.contact.begin(), scene.rows.contact.end());
    uint32_t past = 0, short_of = 0;
    for (uint32_t i = 0; i < contacts.pair.size(); ++i) {
        if (!(contacts.distance[i] < 0) || contacts.body[i] == 0) continue;
        const bool leads_on = contacts.normal[i].z() < -0.9;
        EXPECT_TRUE(leads_on || !is_past(i));
        EXPECT_EQ(kept.count(i), leads_on ? 0u : 1u) << contacts.point[i].transpose();
        (leads_on ? past : short_of) += 1;
    }
    EXPECT_GT(past, 10u);
    EXPECT_GT(short_of, 5u);
    EXPECT_TRUE(std::is_sorted(scene.rows.contact.begin(), scene.rows.contact.end()));
}

// Where all that a pair has inside leaves nose first, as from a ball in the middle of a larger one, the rows stay: better out
// any side than held nowhere.
TEST(ContactRows, PointsThatAllLeadOnKeepTheirRows) {
    ContactScene scene({{make_noisy_sphere(12, 0.1, 0, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(8, 0.03, 0, 0), Motion::kHand, Vec3d(1e-3, 0, 0), turn({1, 2, 0}, 1)}});
    scene.run();
    ASSERT_GT(scene.contacts.pair.size(), 100u);
    ASSERT_EQ(count_nose_first(scene), scene.contacts.pair.size());
    EXPECT_EQ(scene.rows.body.size(), scene.contacts.pair.size());
}

}  // namespace
}  // namespace trocar::test
