#include "engine/motion/keyframe_path.hpp"

#include <gtest/gtest.h>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

std::vector<Keyframe> example() {
    return {{0, {0, 0, 0}, {}, 0},
            {1, {1, 2, 0}, from_rotation_vector({0, 0, 1.5}), 0},
            {1.5, {3, 2, -1}, from_rotation_vector({0.5, 0, 1.5}), 0},
            {4, {4, -1, -1}, from_rotation_vector({0.5, -2, 1.5}), 0},
            {5, {9, 9, 9}, {}, 1},
            {6, {9, 9, 8}, {}, 0}};
}

TEST(KeyframePath, PassesThroughKeysAndHoldsTheEnds) {
    const auto keys = example();
    for (const Keyframe& key : keys) {
        EXPECT_LT((sample_path(keys, key.time).position - key.position).norm(), 1e-14);
        const Vec3d turn = rotation_vector(sample_path(keys, key.time).orientation, key.orientation);
        EXPECT_LT(turn.norm(), 1e-7);
    }
    EXPECT_EQ(sample_path(keys, -1).position, keys.front().position);
    EXPECT_EQ(sample_path(keys, 99).position, keys.back().position);
    EXPECT_EQ(sample_path(keys, 99).velocity, Vec3d::Zero());
}

// A spline without the monotone rule overshoots at the corner (y) of the example.
TEST(KeyframePath, NeverLeavesTheIntervalBetweenKeys) {
    const auto keys = example();
    for (size_t k = 0; k + 1 < keys.size(); ++k) {
        for (double u = 0; u < 1; u += 0.01) {
            const Vec3d p = sample_path(keys, keys[k].time + u * (keys[k + 1].time - keys[k].time)).position;
            for (int i = 0; i < 3; ++i) {
                EXPECT_GE(p[i], std::min(keys[k].position[i], keys[k + 1].position[i]) - 1e-12);
                EXPECT_LE(p[i], std::max(keys[k].position[i], keys[k + 1].position[i]) + 1e-12);
            }
        }
    }
}

// Velocities are the derivatives of positions and continuous across keys. Breaks when a Hermite weight is
// wrong.
TEST(KeyframePath, VelocitiesAreDerivatives) {
    const auto keys = example();
    const double h = 1e-6;
    for (double t = 0.05; t < 3.9; t += 0.0371) {
        const PathPoint a = sample_path(keys, t - h), b = sample_path(keys, t + h), at = sample_path(keys, t);
        EXPECT_LT(((b.position - a.position) / (2 * h) - at.velocity).norm(), 1e-5) << t;
        EXPECT_LT((rotation_vector(a.orientation, b.orientation) / (2 * h) - at.angular_velocity).norm(), 1e-5) << t;
    }
    for (const double t : {1.0, 1.5}) {
        EXPECT_LT((sample_path(keys, t - 1e-9).velocity - sample_path(keys, t + 1e-9).velocity).norm(), 1e-6);
    }
}

TEST(KeyframePath, JumpsArriveAtOnce) {
    const auto keys = example();
    EXPECT_EQ(sample_path(keys, 4.999999).position, keys[3].position);
    EXPECT_EQ(sample_path(keys, 5).position, keys[4].position);
    EXPECT_TRUE(path_jumps(keys, 4.99, 5));
    EXPECT_FALSE(path_jumps(keys, 5, 5.5));
    EXPECT_FALSE(path_jumps(keys, 0, 4));
}

}  // namespace
}  // namespace trocar
