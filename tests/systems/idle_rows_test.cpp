#include "systems/idle_rows.hpp"

#include <gtest/gtest.h>

#include "tests/systems/contact_scene.hpp"

namespace trocar::test {
namespace {

constexpr double kPeriod = 1.0 / 60, kGap = 0.01;  // s, m

// A row of free balls, each kGap from the next, with a row of contact between neighbours.
struct Chain {
    ContactScene scene{std::vector<BodyInput>(6, {make_noisy_sphere(9, 0.05, 0, 0), Motion::kFree, Vec3d::Zero(), {}})};
    IdleRowsScratch scratch;
    std::vector<std::array<uint32_t, 2>> joined;
    std::vector<NodeDrive> drive;

    Chain() {
        for (uint32_t body = 0; body < 6; ++body) {
            RigidMass free;
            free.body = body;
            scene.bodies.rigid_mass.push_back(free);
        }
    }
    std::vector<uint32_t> kept(double first_gap = kGap) {
        ContactRows rows;
        for (uint32_t body = 0; body < 5; ++body) {
            rows.contact.push_back(body);
            rows.body.push_back(body), rows.other.push_back(body + 1);
            rows.vertex.push_back({0, 0}), rows.along.push_back(0), rows.third.push_back(kNone), rows.across.push_back(0);
            rows.triangle.push_back({}), rows.weight.push_back({1, 0, 0}), rows.normal.push_back(-Vec3d::UnitX());
            rows.distance.push_back(body == 0 ? first_gap : kGap), rows.friction.push_back(0), rows.impulse.push_back(Vec3d::Zero());
        }
        const Surfaces surfaces = scene.surfaces();
        drop_idle_rows({kPeriod, Vec3d(0, 0, -9.81), surfaces, {}, {}, joined, drive}, scratch, rows);
        return rows.contact;
    }
};

using Rows = std::vector<uint32_t>;

// What rests near others has no rows with them.
TEST(IdleRows, BodiesAtRestFarEnoughApartHaveNone) { EXPECT_EQ(Chain().kept(), Rows{}); }

// What one ball may do passes from neighbour to neighbour, less the gaps: twice a meter a second is 33 mm of way in a period
// of 1/60 s, three gaps of 10 mm, and the fourth row is out of reach. Breaks when only the hit body is looked at, or when ways
// pass one way along the rows.
TEST(IdleRows, AFastBodyReachesThroughItsNeighbours) {
    Chain chain;
    chain.scene.poses.velocity[0] = Vec3d(1, 0, 0);
    EXPECT_EQ(chain.kept(), (Rows{0, 1, 2}));
    chain.scene.poses.velocity[0].setZero();
    chain.scene.poses.velocity[5] = Vec3d(0, 0, -1);
    EXPECT_EQ(chain.kept(), (Rows{2, 3, 4}));
    chain.scene.poses.velocity[5].setZero();
    chain.scene.poses.angular_velocity[2] = Vec3d(10, 0, 0);  // 0.5 m/s at its surface
    EXPECT_EQ(chain.kept(), (Rows{1, 2}));
}

// Overlap that is pushed out moves bodies too, and a hand, a link or a drive any way.
TEST(IdleRows, OverlapHandsAndLinksMoveBodies) {
    EXPECT_EQ(Chain().kept(-0.008), (Rows{0, 1}));
    Chain held;
    held.scene.bodies.motion[5] = Motion::kHand;
    held.scene.bodies.rigid_mass.pop_back();
    EXPECT_EQ(held.kept().size(), 5u);
    Chain linked;
    linked.joined = {{1, 3}};
    EXPECT_EQ(linked.kept().size(), 5u);
    Chain driven;
    driven.drive.resize(1);
    driven.drive[0].body = 2;
    EXPECT_EQ(driven.kept().size(), 5u);
}

}  // namespace
}  // namespace trocar::test
