#include "systems/constrain/culled_constraints.hpp"

#include <gtest/gtest.h>

#include "tests/systems/detect/contact_scene.hpp"

namespace trocar::test {
namespace {

constexpr double kPeriod = 1.0 / 60, kGap = 0.01;  // s, m

// A line of free balls, each kGap from the next, with a constraint between neighbours.
struct Chain {
    ContactScene scene{std::vector<BodyInput>(6, {make_noisy_sphere(9, 0.05, 0, 0), Motion::kFree, Vec3d::Zero(), {}})};
    CulledConstraintsScratch scratch;
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
        ContactConstraints constraints;
        for (uint32_t body = 0; body < 5; ++body) {
            constraints.contact.push_back(body);
            constraints.body.push_back(body), constraints.other.push_back(body + 1);
            constraints.vertex.push_back({0, 0}), constraints.along.push_back(0), constraints.third.push_back(kNone),
                constraints.across.push_back(0);
            constraints.triangle.push_back({}), constraints.weight.push_back({1, 0, 0}), constraints.normal.push_back(-Vec3d::UnitX());
            constraints.distance.push_back(body == 0 ? first_gap : kGap), constraints.friction.push_back(0),
                constraints.impulse.push_back(Vec3d::Zero());
        }
        const Surfaces surfaces = scene.surfaces();
        cull_constraints({kPeriod, Vec3d(0, 0, -9.81), surfaces, {}, {}, joined, drive}, scratch, constraints);
        return constraints.contact;
    }
};

using Rows = std::vector<uint32_t>;

// Bodies at rest near others have no constraints with them.
TEST(CulledConstraints, BodiesAtRestFarEnoughApartHaveNone) { EXPECT_EQ(Chain().kept(), Rows{}); }

// A ball's displacement bound passes from neighbour to neighbour, less the separations: twice a meter a
// second is 33 mm in a period of 1/60 s, three separations of 10 mm, and the fourth constraint is out of reach.
// Breaks when only the hit body is considered, or when bounds are passed in one direction only.
TEST(CulledConstraints, AFastBodyReachesThroughItsNeighbours) {
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

// Overlap that is corrected moves bodies too, and a hand, a link or a drive without bound.
TEST(CulledConstraints, OverlapHandsAndLinksMoveBodies) {
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
