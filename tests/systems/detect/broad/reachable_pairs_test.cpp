#include "systems/detect/broad/reachable_pairs.hpp"

#include <gtest/gtest.h>

#include <random>

#include "systems/detect/broad/body_boxes.hpp"
#include "systems/detect/broad/broad_phase_pairs.hpp"
namespace trocar {
namespace {

constexpr double kPeriod = 1.0 / 60;

// Bodies of eight loose vertices, the corners of cubes; a minimal world for boxes and pairs.
struct Cubes {
    Meshes meshes;
    Bodies bodies;
    Poses poses;
    Particles particles;
    BodyBoxes boxes;
    BroadPhasePairs pairs;
    ReachablePairsScratch scratch;
    std::vector<ExternalDisplacement> external;

    explicit Cubes(double half) {
        MeshInfo info;
        info.vertices = {0, 8};
        info.mean_edge = half;
        info.radius = half * std::sqrt(3.0);
        meshes.info.push_back(info);
        for (int i = 0; i < 8; ++i) meshes.position.emplace_back(i & 1 ? half : -half, i & 2 ? half : -half, i & 4 ? half : -half);
    }
    uint32_t add(Motion motion, const Vec3d& at, const Vec3d& velocity) {
        const uint32_t body = static_cast<uint32_t>(bodies.mesh.size());
        bodies.mesh.push_back(0);
        bodies.motion.push_back(motion);
        bodies.thickness.push_back(0);
        bodies.particles.push_back({});
        poses.origin.push_back(at);
        poses.orientation.push_back({});
        poses.velocity.push_back(Vec3d::Zero());
        poses.angular_velocity.push_back(Vec3d::Zero());
        if (motion != Motion::kDeformable) return body;
        bodies.particles[body] = {static_cast<uint32_t>(particles.offset.size()), 8};
        for (const Vec3d& p : meshes.position) {
            particles.offset.push_back({float(p.x()), float(p.y()), float(p.z()), 1});
            particles.velocity_x.push_back(float(velocity.x()));
            particles.velocity_y.push_back(float(velocity.y()));
            particles.velocity_z.push_back(float(velocity.z()));
        }
        return body;
    }
    Surfaces surfaces() const { return {meshes, bodies, poses, particles}; }
    bool has(uint32_t a, uint32_t b) const {
        for (size_t i = 0; i < pairs.a.size(); ++i)
            if (pairs.a[i] == a && pairs.b[i] == b) return true;
        return false;
    }
    void find(const Vec3d& gravity = Vec3d(0, 0, -9.81)) {
        BroadPhaseScratch s;
        compute_body_boxes({kPeriod, surfaces()}, boxes);
        find_broad_phase_pairs(bodies, boxes, {}, s, pairs);
        drop_unreachable_pairs(kPeriod, gravity, surfaces(), boxes, scratch, pairs, external);
    }
};

TEST(ReachablePairs, SideBySideIsDroppedAndWhatComesNearerStays) {
    Cubes c(0.02);
    const Vec3d down(0, 0, -2);
    const uint32_t a = c.add(Motion::kDeformable, Vec3d(0, 0, 0), down), b = c.add(Motion::kDeformable, Vec3d(0.05, 0, 0), down);
    c.find();
    EXPECT_TRUE(c.pairs.a.empty()) << "1 cm apart, 3.3 cm a period, but together";
    // approach at 1 m/s: 16.7 mm in the period, more than the 10 mm between them
    for (uint32_t i = 0; i < 8; ++i) c.particles.velocity_x[c.bodies.particles[b].first + i] = -1;
    c.find();
    EXPECT_TRUE(c.has(a, b));
    for (uint32_t i = 0; i < 8; ++i) c.particles.velocity_x[c.bodies.particles[b].first + i] = 1;
    c.find();
    EXPECT_FALSE(c.has(a, b)) << "parting";
}

TEST(ReachablePairs, WhoMayBeTouchedOtherwiseKeepsItsPairs) {
    Cubes c(0.02);
    const Vec3d down(0, 0, -2);
    const uint32_t floor = c.add(Motion::kStatic, Vec3d(0, 0, -0.06), Vec3d::Zero());
    const uint32_t low = c.add(Motion::kDeformable, Vec3d(0, 0, 0), down), above = c.add(Motion::kDeformable, Vec3d(0, 0, 0.06), down);
    const uint32_t top = c.add(Motion::kDeformable, Vec3d(0, 0, 0.12), down);
    c.find();
    EXPECT_TRUE(c.has(floor, low));
    EXPECT_TRUE(c.has(low, above)) << "the floor may stop the lower one";
    EXPECT_FALSE(c.has(above, top));
}

// Free bodies side by side, as soft ones. A rotating one reaches as far as its corners. Breaks when balls'
// radii, spins or the others' velocities are left out, or a static body keeps its pairs.
TEST(ReachablePairs, FreeBodiesKeepTheirVelocity) {
    Cubes c(0.02);
    const Vec3d down(0, 0, -2);
    const uint32_t a = c.add(Motion::kFree, Vec3d(0, 0, 0), down), b = c.add(Motion::kFree, Vec3d(0.08, 0, 0), down);
    const uint32_t wall = c.add(Motion::kStatic, Vec3d(-0.1, 0, 0), Vec3d::Zero()),
                   soft = c.add(Motion::kDeformable, Vec3d(0, 0.08, 0), down);
    for (const uint32_t body : {a, b}) c.poses.velocity[body] = down;
    c.poses.origin[wall] = Vec3d(-0.13, 0, 0);
    c.find();
    EXPECT_FALSE(c.has(a, b)) << "the balls are 10.7 mm apart";
    EXPECT_FALSE(c.has(a, soft)) << "and the ball and the box 25";
    EXPECT_FALSE(c.has(b, soft));
    EXPECT_FALSE(c.has(a, wall)) << "75 mm from the ball, which goes 33";
    c.poses.origin[wall] = Vec3d(-0.07, 0, 0);
    c.find();
    EXPECT_TRUE(c.has(a, wall)) << "15 mm from it";
    EXPECT_FALSE(c.has(b, soft)) << "what only the wall may touch";
    c.poses.origin[wall] = Vec3d(-1, 0, 0);
    c.poses.angular_velocity[b] = Vec3d(0, 0, 30);  // 17 mm per period
    c.find();
    EXPECT_TRUE(c.has(a, b));
    c.poses.angular_velocity[b].setZero();
    c.poses.velocity[b].x() = -1;
    c.find();
    EXPECT_TRUE(c.has(a, b));
    c.poses.velocity[b] = down;
    const uint32_t hand = c.add(Motion::kHand, Vec3d(0.0, -0.07, 0), Vec3d::Zero());
    c.find();
    EXPECT_TRUE(c.has(a, hand)) << "a hand does as it likes";
    EXPECT_TRUE(c.has(a, b)) << "and may push a into b";
}

// Low falls 33 mm in the period and hits the floor after 20: a body that falls with it may come nearer by the
// remainder. Side by side no body has a jolt.
TEST(ReachablePairs, WhoIsStoppedIsJoltedByWhatIsLeftOfItsWay) {
    Cubes c(0.02);
    const Vec3d down(0, 0, -2), up = Vec3d::UnitZ();
    const uint32_t floor = c.add(Motion::kStatic, Vec3d(0, 0, -0.06), Vec3d::Zero());
    const uint32_t low = c.add(Motion::kDeformable, Vec3d(0, 0, 0), down), above = c.add(Motion::kDeformable, Vec3d(0, 0, 0.06), down);
    c.find();
    const double fall = 0.5 * 9.81 * kPeriod * kPeriod, left = 2 * kPeriod + fall - 0.02;
    EXPECT_NEAR(external_displacement_along(c.external, low, up), left, 1e-6);
    EXPECT_NEAR(external_displacement_along(c.external, low, Vec3d(0.6, 0, 0.8)), 0.8 * left, 1e-6);
    EXPECT_EQ(external_displacement_along(c.external, floor, -up), 0) << "nothing moves a static body";
    for (const Vec3d& direction : {Vec3d(-up), Vec3d::UnitX().eval()})
        EXPECT_EQ(external_displacement_along(c.external, low, direction), 0);
    for (const Vec3d& direction : {up, Vec3d(-up)}) EXPECT_EQ(external_displacement_along(c.external, above, direction), 0);
    EXPECT_EQ(external_displacement_along({}, low, up), 0);
    // two cubes that overlap on every axis approach along the line between their centres
    Cubes two(0.02);
    const uint32_t a = two.add(Motion::kDeformable, Vec3d(0, 0, 0), Vec3d(0.3, 0, 0)),
                   b = two.add(Motion::kDeformable, Vec3d(0.03, 0.03, 0), Vec3d::Zero());
    two.find();
    const Vec3d direction = Vec3d(1, 1, 0).normalized();
    const double in = 0.3 * kPeriod * direction.x() + fall;
    EXPECT_NEAR(external_displacement_along(two.external, a, -direction), in, 1e-6);
    EXPECT_NEAR(external_displacement_along(two.external, b, direction), in, 1e-6);
    EXPECT_EQ(external_displacement_along(two.external, a, direction), 0);
}

// A sleeping body's drift is that of when it fell asleep: not read again in this sleep, but in the next.
// Breaks when it is never forgotten, or never kept.
TEST(ReachablePairs, SleepersAreLookedAtOnce) {
    Cubes c(0.02);
    const uint32_t a = c.add(Motion::kDeformable, Vec3d(0, 0, 0), Vec3d(1, 0, 0)),
                   b = c.add(Motion::kDeformable, Vec3d(0.05, 0, 0), Vec3d(-0.1, 0, 0));
    std::vector<uint64_t> sleep = {1, 0}, seen = {0, 0};
    const auto go = [&](float speed) {
        for (uint32_t i = 0; i < 8; ++i) c.particles.velocity_x[c.bodies.particles[a].first + i] = speed;
    };
    BroadPhaseScratch s;
    BroadPhasePairs all;
    compute_body_boxes({kPeriod, c.surfaces()}, c.boxes);
    find_broad_phase_pairs(c.bodies, c.boxes, {}, s, all);
    ASSERT_EQ(all.a.size(), 1u);
    const auto find = [&] {
        c.pairs = all;
        drop_unreachable_pairs(kPeriod, Vec3d::Zero(), c.surfaces(), c.boxes, c.scratch, c.pairs, c.external, {sleep, seen});
        return c.has(a, b);
    };
    const auto still = [&] { return are_at_rest(c.surfaces(), c.scratch, {sleep, seen}); };
    EXPECT_FALSE(still()) << "nothing was asked yet";
    go(0);
    EXPECT_FALSE(find());
    EXPECT_FALSE(still()) << "b is awake";
    sleep[b] = 1;
    EXPECT_FALSE(still()) << "not yet seen in this sleep";
    find();
    EXPECT_TRUE(still());
    sleep[b] = 0;
    go(1);
    EXPECT_FALSE(find()) << "not read while it sleeps";
    sleep[a] = 2;
    EXPECT_TRUE(find()) << "another sleep";
    sleep[a] = 0;
    EXPECT_TRUE(find()) << "awake";
}

// No pair is dropped whose vertices can meet: vertices moved on straight lines with their own velocities, one
// body under gravity and the other not, at many times of the period.
TEST(ReachablePairs, NothingThatCouldMeetIsDropped) {
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> position(-0.15, 0.15), speed(-2, 2), little(-0.3, 0.3);
    uint64_t dropped = 0;
    for (int round = 0; round < 60; ++round) {
        Cubes c(0.02);
        for (int i = 0; i < 20; ++i) {
            const double x = position(random), y = position(random), z = position(random), u = speed(random), v = speed(random),
                         w = speed(random);
            c.add(Motion::kDeformable, Vec3d(x, y, z), Vec3d(u, v, w));
        }
        for (auto* field : {&c.particles.velocity_x, &c.particles.velocity_y, &c.particles.velocity_z})
            for (float& v : *field) v += static_cast<float>(little(random));
        BroadPhaseScratch s;
        compute_body_boxes({kPeriod, c.surfaces()}, c.boxes);
        find_broad_phase_pairs(c.bodies, c.boxes, {}, s, c.pairs);
        const BroadPhasePairs all = c.pairs;
        drop_unreachable_pairs(kPeriod, Vec3d(0, 0, -9.81), c.surfaces(), c.boxes, c.scratch, c.pairs, c.external);
        for (size_t i = 0; i < all.a.size(); ++i) {
            if (c.has(all.a[i], all.b[i])) continue;
            ++dropped;
            for (int step = 0; step <= 20; ++step) {
                const double t = kPeriod * step / 20;
                Box box[2];
                for (const int side : {0, 1}) {
                    const uint32_t body = side ? all.b[i] : all.a[i];
                    for (uint32_t v = 0; v < 8; ++v) {
                        const Vec3d p = vertex_position(c.surfaces(), body, v) + t * vertex_velocity(c.surfaces(), body, v) +
                                        (side ? Vec3d(0, 0, -0.5 * 9.81 * t * t) : Vec3d::Zero());
                        box[side].min = box[side].min.cwiseMin(p), box[side].max = box[side].max.cwiseMax(p);
                    }
                }
                EXPECT_FALSE((box[0].min.array() <= box[1].max.array()).all() && (box[1].min.array() <= box[0].max.array()).all())
                    << round << " " << i;
            }
        }
    }
    EXPECT_GT(dropped, 100u);
}

TEST(ReachablePairs, LostVelocitiesAndNoBodiesAreHarmless) {
    Cubes none(0.02);
    none.find();
    EXPECT_TRUE(none.pairs.a.empty());
    Cubes c(0.02);
    const uint32_t a = c.add(Motion::kDeformable, Vec3d(0, 0, 0), Vec3d::Zero()),
                   b = c.add(Motion::kDeformable, Vec3d(0.041, 0, 0), Vec3d::Zero());
    c.particles.velocity_x[3] = std::nanf("");
    c.find();
    EXPECT_TRUE(c.has(a, b));
}

}  // namespace
}  // namespace trocar
