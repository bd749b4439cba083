#include "systems/constrain/contact_constraints.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "engine/mesh/inverted_contact.hpp"
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

ContactScene pressed() {
    ContactScene scene({{make_noisy_sphere(12, 0.1, 0.05, 0), Motion::kDeformable, Vec3d(1, 2, 3), {}},
                        {make_noisy_sphere(9, 0.07, 0.05, 1), Motion::kHand, Vec3d(1.12, 2.03, 3.01), turn({1, 2, 0}, 1)}});
    scene.bodies.tissue[0].friction = 0.05;
    scene.bodies.tissue[1].friction = 0.3;
    return scene;
}

uint32_t count_inverted(const ContactScene& scene) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) count += leaves_inverted(scene.surfaces(), scene.contacts, i);
    return count;
}

// A constraint is its contact with the plane through `closest`. Breaks on wrong weights, a normal in the
// wrong frame, a lost constraint.
TEST(ContactConstraints, PlaneGoesThroughTheClosestPoint) {
    ContactScene scene = pressed();
    scene.run();
    const ContactConstraints& constraints = scene.contact_constraints;
    ASSERT_EQ(constraints.body.size() + count_inverted(scene), scene.contacts.pair.size());
    ASSERT_GT(constraints.body.size(), 50u);
    EXPECT_TRUE(std::is_sorted(constraints.contact.begin(), constraints.contact.end()));
    for (uint32_t i = 0; i < constraints.body.size(); ++i) {
        const uint32_t c = constraints.contact[i];
        EXPECT_EQ(constraints.weight[i][0] + constraints.weight[i][1] + constraints.weight[i][2], 1.0f);
        Vec3d p = Vec3d::Zero();
        for (int k = 0; k < 3; ++k) {
            EXPECT_GE(constraints.weight[i][k], 0);
            p += double(constraints.weight[i][k]) * vertex_position(scene.surfaces(), constraints.other[i], constraints.triangle[i][k]);
        }
        EXPECT_LT((p - scene.contacts.closest[c]).norm(), 1e-8);  // 2^-23 of an edge
        EXPECT_EQ(constraints.distance[i], scene.contacts.distance[c]);
        const Vec3d normal = direction_to_world(scene.surfaces(), constraints.other[i], constraints.normal[i]);
        EXPECT_LT((normal - scene.contacts.normal[c]).norm(), 1e-12);
        EXPECT_EQ(constraints.friction[i], 0.3f);
        EXPECT_EQ(constraints.impulse[i], Vec3d(Vec3d::Zero()));
    }
}

// Thesis 4.2: inside points share the pair's direction, opposite for the two bodies, with projected depths.
TEST(ContactConstraints, ThesisDirectionProjectsTheDepths) {
    ContactScene scene = pressed();
    scene.settings.contact.direction = ResponseDirection::kThesis;
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    const Vec3d direction = scene.penetrations.direction[0];
    uint32_t shortened = 0;
    for (uint32_t i = 0; i < scene.contact_constraints.body.size(); ++i) {
        const double depth = -scene.contacts.distance[i];
        const Vec3d normal = direction_to_world(scene.surfaces(), scene.contact_constraints.other[i], scene.contact_constraints.normal[i]);
        if (depth <= 0) {
            EXPECT_LT((normal - scene.contacts.normal[i]).norm(), 1e-12);
            continue;
        }
        const Vec3d out = scene.contact_constraints.body[i] == 1 ? direction : Vec3d(-direction);
        EXPECT_LT((normal - out).norm(), 1e-12);
        EXPECT_NEAR(-scene.contact_constraints.distance[i], depth * std::max(0.0, scene.contacts.normal[i].dot(out)), 1e-15);
        shortened += -scene.contact_constraints.distance[i] < 0.99 * depth;
    }
    EXPECT_GT(shortened, 5u);
    EXPECT_NEAR(-scene.contact_constraints.distance[scene.penetrations.witness[0]], scene.penetrations.depth[0], 1e-15);
}

// P27: all vertices inside and too few constraints: the deepest stay, the loss is counted, the other body
// keeps its own.
TEST(ContactConstraints, P27_TheShallowestAreDroppedAndCounted) {
    ContactScene scene({{make_noisy_sphere(12, 0.1, 0.05, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(8, 0.05, 0.05, 1), Motion::kDeformable, Vec3d(0.01, 0, 0), {}},
                        {make_noisy_sphere(4, 0.03, 0, 1), Motion::kDeformable, Vec3d(-0.095, 0, 0), {}}});
    scene.settings.contact.constraint_capacity = 70;
    scene.run();
    std::vector<std::vector<double>> all(3), kept(3);
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) all[scene.contacts.body[i]].push_back(scene.contacts.distance[i]);
    for (uint32_t i = 0; i < scene.contact_constraints.body.size(); ++i)
        kept[scene.contact_constraints.body[i]].push_back(scene.contact_constraints.distance[i]);
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
    EXPECT_TRUE(std::is_sorted(scene.contact_constraints.contact.begin(), scene.contact_constraints.contact.end()));
}

class ThroughAWall : public testing::TestWithParam<Motion> {};
INSTANTIATE_TEST_SUITE_P(ContactConstraints, ThroughAWall, testing::Values(Motion::kHand, Motion::kFree),
                         [](const auto& motion) { return motion.param == Motion::kHand ? "InTheHand" : "Free"; });

// A ball has passed the middle of a thin deformable wall: there the nearest surface is the wall's far side,
// to which inverted contacts would push the ball. Those have no constraint; all others lead back. Breaks when
// the wall holds the ball from both sides, and when points short of the middle lose theirs.
TEST_P(ThroughAWall, NothingLeadsOnThroughAThinWall) {
    constexpr double kRadius = 0.05, kPast = 1.4e-3;  // m; the wall is 2e-3 thick, its near side at z = 0
    ContactScene scene({{make_box({0.2, 0.2, 2e-3}, {20, 20, 1}), Motion::kDeformable, Vec3d(0, 0, -1e-3), {}},
                        {make_noisy_sphere(24, kRadius, 0, 0), GetParam(), Vec3d(0, 0, kRadius - kPast), turn({1, 2, 0}, 1)}});
    scene.run();
    const Contacts& contacts = scene.contacts;
    const auto is_past = [&](uint32_t i) {
        return contacts.body[i] == 1 && contacts.vertex[i][0] == contacts.vertex[i][1] && contacts.point[i].z() < -1.05e-3;
    };
    const std::set<uint32_t> kept(scene.contact_constraints.contact.begin(), scene.contact_constraints.contact.end());
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
    EXPECT_TRUE(std::is_sorted(scene.contact_constraints.contact.begin(), scene.contact_constraints.contact.end()));
}

// If all inside contacts of a pair are inverted, as of a ball in the middle of a larger one, the constraints
// stay: leaving on any side is better than none.
TEST(ContactConstraints, PointsThatAllLeadOnKeepTheirRows) {
    ContactScene scene({{make_noisy_sphere(12, 0.1, 0, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(8, 0.03, 0, 0), Motion::kHand, Vec3d(1e-3, 0, 0), turn({1, 2, 0}, 1)}});
    scene.run();
    ASSERT_GT(scene.contacts.pair.size(), 100u);
    ASSERT_EQ(count_inverted(scene), scene.contacts.pair.size());
    EXPECT_EQ(scene.contact_constraints.body.size(), scene.contacts.pair.size());
}

}  // namespace
}  // namespace trocar::test
