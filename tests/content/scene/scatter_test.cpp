#include "content/scene/scatter.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "content/scene/build_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "engine/base/error.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

SceneFile scene_of(const std::string& text, const std::vector<Override>& overrides = {}) {
    const std::filesystem::path path = std::filesystem::path(testing::TempDir()) / "scatter_test.toml";
    std::ofstream(path) << text;
    return read_scene_file(path, overrides);
}

std::string refusal(const std::string& text, const std::vector<Override>& overrides = {}) {
    try {
        scene_of(text, overrides);
    } catch (const InputError& error) {
        return error.what();
    }
    return "read";
}

const std::string kBalls = R"(
[parameters]
count = 10
seed = 3
resolution = 80
jitter = 0.0

[[body]]
name = "ball"
shape = "sphere"
triangles = "$resolution"
motion = "deformable"
position = [1.0, 2.0, 3.0]
[body.scatter]
count = "$count"
seed = "$seed"
jitter = "$jitter"
columns = [3, 2]
spacing = [0.1, 0.2, 0.5]
)";

TEST(Scatter, FillsTheLatticeLayerOnLayer) {
    const SceneFile scene = scene_of(kBalls);
    ASSERT_EQ(scene.bodies.size(), 10u);
    EXPECT_EQ(scene.bodies[7].name, "ball_7");
    EXPECT_EQ(scene.bodies[7].triangles, 80u);
    // three along x, two along y, then up; centred about the position in x and y
    EXPECT_LT((scene.bodies[0].position - Vec3d(0.9, 1.9, 3.0)).norm(), 1e-15);
    EXPECT_LT((scene.bodies[5].position - Vec3d(1.1, 2.1, 3.0)).norm(), 1e-15);
    EXPECT_LT((scene.bodies[7].position - Vec3d(1.0, 1.9, 3.5)).norm(), 1e-15);
    const SceneFile cube = scene_of(kBalls, {{"ball.scatter.columns", "[0, 0]"}, {"count", "27"}});
    EXPECT_LT((cube.bodies[13].position - Vec3d(1, 2, 3)).norm(), 1e-15) << "the middle of a cube of 27";
    EXPECT_LT((cube.bodies[26].position - Vec3d(1.1, 2.2, 3.5)).norm(), 1e-15);
}

TEST(Scatter, JitterStaysInItsShareAndFollowsTheSeedAlone) {
    const SceneFile still = scene_of(kBalls, {{"count", "300"}});
    const SceneFile moved = scene_of(kBalls, {{"count", "300"}, {"jitter", "0.3"}}), fewer = scene_of(kBalls, {{"jitter", "0.3"}});
    const SceneFile other = scene_of(kBalls, {{"jitter", "0.3"}, {"seed", "4"}});
    Vec3d least = Vec3d::Constant(1), most = -least;
    for (size_t i = 0; i < 300; ++i) {
        const Vec3d off = (moved.bodies[i].position - still.bodies[i].position).cwiseQuotient(Vec3d(0.1, 0.2, 0.5));
        least = least.cwiseMin(off), most = most.cwiseMax(off);
    }
    for (int k = 0; k < 3; ++k) {
        // of 300 uniform numbers in [-0.3, 0.3], the probability that none is in the last twentieth is 2e-7
        EXPECT_GE(least[k], -0.3 - 1e-12);
        EXPECT_LT(least[k], -0.27);
        EXPECT_LE(most[k], 0.3 + 1e-12);
        EXPECT_GT(most[k], 0.27);
    }
    for (size_t i = 0; i < 10; ++i) {
        EXPECT_EQ(fewer.bodies[i].position, moved.bodies[i].position);
        EXPECT_NE(fewer.bodies[i].position, other.bodies[i].position);
    }
}

// The mean of n uniformly distributed unit vectors has a length of about sqrt(1 / n); 4 times that has a
// probability of 1e-10.
TEST(Scatter, TurnsAreEvenOverAllRotations) {
    const SceneFile scene = scene_of(kBalls, {{"count", "2000"}, {"ball.scatter.turned", "true"}});
    Vec3d sum[3] = {Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero()};
    double squares = 0;
    for (const BodySpec& body : scene.bodies) {
        const Quat& q = body.orientation;
        EXPECT_NEAR(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z, 1, 1e-12);
        for (int k = 0; k < 3; ++k) sum[k] += rotate(q, Vec3d::Unit(k));
        squares += rotate(q, Vec3d::UnitX()).x() * rotate(q, Vec3d::UnitX()).x();
    }
    for (const Vec3d& s : sum) EXPECT_LT(s.norm() / 2000, 4 / std::sqrt(2000.0));
    EXPECT_NEAR(squares / 2000, 1.0 / 3, 4 * std::sqrt(4.0 / 45 / 2000)) << "the square of a coordinate has mean 1/3, variance 4/45";
}

TEST(Parameters, StandForValuesAndChangeByTheirName) {
    EXPECT_EQ(scene_of(kBalls).parameters.size(), 4u);
    const SceneFile scene = scene_of(kBalls, {{"count", "3"}, {"parameters.resolution", "500"}});
    EXPECT_EQ(scene.bodies.size(), 3u);
    EXPECT_EQ(scene.bodies[0].triangles, 500u);
}

// With a count of 0 the scene lacks the body, and runs if any body is left.
TEST(Scatter, ACountOfNoneIsASceneWithoutThem) {
    const SceneFile none = scene_of(kBalls + "\n[[body]]\nname = \"floor\"\nshape = \"box\"\ntriangles = 12\n", {{"count", "0"}});
    ASSERT_EQ(none.bodies.size(), 1u);
    EXPECT_EQ(none.bodies[0].name, "floor");
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(build_scene(none, Looks::kPlain).world, {});
        frame.step();
        EXPECT_EQ(frame.world().bodies.mesh.size(), 1u);
    });
}

TEST(Parameters, WhatIsWrongIsNamedWithItsPlace) {
    EXPECT_NE(refusal("[parameters]\ncount = 3\n\n[[body]]\nname = \"a\"\nshape = \"sphere\"\ntriangles = \"$cuont\"\n")
                  .find("7:13: no parameter \"cuont\" in [parameters]; did you mean \"count\"?"),
              std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"count", "-1"}}).find("count = -1 is outside 0 to"), std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"count", "\"many\""}}).find("count must be a number"), std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"cuont", "5"}}).find("unknown key \"cuont\"; did you mean \"count\"?"), std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"weightlessness", "5"}}).find("; parameters of the scene: count, jitter, resolution, seed"),
              std::string::npos)
        << refusal(kBalls, {{"weightlessness", "5"}});
    EXPECT_NE(refusal("secnods = 3\n" + kBalls).find("did you mean \"seconds\"?"), std::string::npos);
    EXPECT_NE(refusal("[[body]]\nname = \"a\"\nshape = \"sphere\"\n[body.scatter]\nseed = 3\n").find("[body.scatter] needs a count"),
              std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"ball.scatter.colums", "[1, 1]"}}).find("did you mean \"columns\"?"), std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"contact.edges_ahead", "true"}}).find("it is no longer a key: raise contact.rate"), std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"ball.lod.beyond", "0.1"}}).find("it is no longer a key: bodies that"), std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"ball.motion", "hand"}}).find("can neither be held"), std::string::npos);
    EXPECT_NE(refusal(kBalls, {{"ball.motion", "static"}, {"ball.scatter.rate", "5"}})
                  .find("only deformable bodies that do not break come and go"),
              std::string::npos);
    EXPECT_NE(refusal("parameters = 5\n").find("parameters must be a table"), std::string::npos);
    EXPECT_NE(refusal("[parameters]\na = [1, 2]\n").find("parameter \"a\" must be"), std::string::npos);
    EXPECT_NE(refusal(kBalls + "\n[[body]]\nname = \"ball_4\"\nshape = \"sphere\"\n").find("two bodies are named \"ball_4\""),
              std::string::npos);
}

}  // namespace
}  // namespace trocar
