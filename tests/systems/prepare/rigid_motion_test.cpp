#include "systems/prepare/rigid_motion.hpp"

#include <gtest/gtest.h>

#include "engine/geometry/quaternion.hpp"
#include "engine/motion/keyframe_path.hpp"
namespace trocar {
namespace {

// Two paths and a body without one. Breaks on mixed-up indices, or when the third body is written.
TEST(RigidMotion, BodiesFollowTheirPaths) {
    Paths paths;
    paths.body = {2, 0};
    paths.keys = {{0, 2}, {2, 2}};
    paths.key = {{0, {0, 0, 0}, {}, 0}, {2, {4, 0, 0}, from_rotation_vector({0, 0, 1}), 0}, {1, {7, 7, 7}, {}, 0}, {3, {7, 9, 7}, {}, 0}};
    Poses poses;
    poses.origin.assign(3, Vec3d::Constant(-1));
    poses.orientation.resize(3);
    poses.velocity.assign(3, Vec3d::Zero());
    poses.angular_velocity.assign(3, Vec3d::Zero());
    follow_paths(paths, 1.0, {}, poses);
    EXPECT_LT((poses.origin[2] - Vec3d(2, 0, 0)).norm(), 1e-14);
    EXPECT_LT((poses.velocity[2] - Vec3d(3, 0, 0)).norm(), 1e-14);
    EXPECT_LT((poses.angular_velocity[2] - Vec3d(0, 0, 0.75)).norm(), 1e-12);
    EXPECT_LT((rotation_vector({}, poses.orientation[2]) - Vec3d(0, 0, 0.5)).norm(), 1e-12);
    EXPECT_EQ(poses.origin[0], Vec3d(7, 7, 7));
    EXPECT_EQ(poses.origin[1], Vec3d::Constant(-1));
    follow_paths(paths, 10, {}, poses);
    EXPECT_EQ(poses.origin[0], Vec3d(7, 9, 7));
    EXPECT_EQ(poses.velocity[0], Vec3d::Zero());
}

}  // namespace
}  // namespace trocar
