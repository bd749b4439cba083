#include "engine/distance/first_touch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "reference/sample_count.hpp"
#include "reference/sample_meshes.hpp"

// First touch of fast bodies against closed forms and brute force.
namespace {
using namespace trocar;

struct Solid {
    Meshes meshes;
    std::unique_ptr<ClosestPointTree> tree;
    explicit Solid(const Mesh& mesh) {
        add_prototype(meshes, mesh, Admission::kSolid);
        tree = std::make_unique<ClosestPointTree>(view());
    }
    MeshView view() const { return mesh_view(meshes, 0); }
};

constexpr double kNever = std::numeric_limits<double>::infinity();

// Time at which a point moving with v meets a triangle; infinity if it does not. Both sides count.
double point_meets_triangle(const Vec3d& p, const Vec3d& v, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d n = (b - a).cross(c - a);
    const double rate = n.dot(v);
    if (rate == 0) return kNever;
    const double t = n.dot(a - p) / rate;
    const Vec3d q = p + t * v;
    const bool in = (b - a).cross(q - a).dot(n) >= 0 && (c - b).cross(q - b).dot(n) >= 0 && (a - c).cross(q - c).dot(n) >= 0;
    return t >= 0 && in ? t : kNever;
}
// Time at which edge ab, moving with v, meets edge cd.
double edges_meet(const Vec3d& a, const Vec3d& b, const Vec3d& v, const Vec3d& c, const Vec3d& d) {
    const Vec3d e = b - a, f = d - c, n = e.cross(f);
    const double rate = n.dot(v);
    if (rate == 0) return kNever;
    const double t = n.dot(c - a) / rate;
    const Vec3d apart = c - a - t * v;
    const double along = apart.cross(f).dot(n) / n.squaredNorm(), other = apart.cross(e).dot(n) / n.squaredNorm();
    return t >= 0 && along >= 0 && along <= 1 && other >= 0 && other <= 1 ? t : kNever;
}
// Brute force for bodies that do not rotate: every vertex against every triangle in both directions, every
// edge against every edge.
double brute_force(const MeshView& a, const std::vector<Vec3d>& position, const Vec3d& v, const MeshView& b) {
    double best = kNever;
    for (const Triangle& t : b.triangle) {
        for (const Vec3d& p : position) {
            best = std::min(best, point_meets_triangle(p, v, b.position[t[0]], b.position[t[1]], b.position[t[2]]));
        }
    }
    for (const Triangle& t : a.triangle) {
        for (const Vec3d& p : b.position)
            best = std::min(best, point_meets_triangle(p, -v, position[t[0]], position[t[1]], position[t[2]]));
    }
    for (const auto& [i, j] : a.edge) {
        for (const auto& [k, l] : b.edge) best = std::min(best, edges_meet(position[i], position[j], v, b.position[k], b.position[l]));
    }
    return best;
}

// Random convex and thin shapes thrown at each other at up to 10 m/s, the speed of a tool, in one step of
// 1/60 s. No contact is missed or late, and the time is accurate to 1 % of the step plus the time in which
// the surfaces approach by two tolerances (a graze may be reported early).
void throw_around(uint32_t sweeps, uint32_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> in(-1, 1);
    const auto vector = [&] { return Vec3d(in(random), in(random), in(random)); };
    const std::vector<Mesh> shapes{
        reference::make_tetrahedron(Vec3d::Zero(), 0.03), reference::make_box({-0.02, -0.01, -0.01}, {0.02, 0.01, 0.01}),
        reference::make_box({-0.001, -0.001, -0.06}, {0.001, 0.001, 0.06}), reference::make_box({-0.1, -0.1, -0.0005}, {0.1, 0.1, 0.0005}),
        reference::make_sphere(Vec3d::Zero(), 0.02, 1)};
    std::vector<std::unique_ptr<Solid>> solids;
    for (const Mesh& mesh : shapes) solids.push_back(std::make_unique<Solid>(mesh));
    const double step = 1.0 / 60, tolerance = 1e-5;
    uint32_t touched = 0, early = 0;
    for (uint32_t i = 0; i < sweeps; ++i) {
        const Solid &a = *solids[random() % solids.size()], &b = *solids[random() % solids.size()];
        RigidSweep sweep;
        sweep.orientation = from_rotation_vector(3 * vector());
        sweep.position = 0.15 * vector();
        sweep.velocity = -sweep.position.normalized() * 10 * std::abs(in(random)) + 0.5 * vector();
        std::vector<Vec3d> position;
        for (const Vec3d& p : a.view().position) position.push_back(sweep.position + rotate(sweep.orientation, p));
        const double found = first_touch(a.view(), *a.tree, b.view(), *b.tree, sweep, step, tolerance);
        if (found == 0) continue;  // overlaps at the start
        const double exact = brute_force(a.view(), position, sweep.velocity, b.view());
        if (exact <= step) {
            ++touched;
            EXPECT_LE(found, exact) << "sweep " << i << " of seed " << seed << ": missed or late";
            early += found < exact - 0.01 * step;
        } else if (found <= step) {
            // reported as a touch: the surfaces must have come within two tolerances; the brute force
            // computes no distances, so only those that touch within the tolerance of a slightly longer step,
            // or graze, are allowed here
            ++early;
        }
    }
    EXPECT_GT(touched, sweeps / 10);
    EXPECT_LE(early, sweeps / 500) << "grazes seen early";
    std::printf("%u sweeps, %u touched, %u grazes early\n", sweeps, touched, early);
}

TEST(FirstTouch, P20_RandomSweepsAgainstBruteForce) { throw_around(sample_count(500, 5), 7); }
TEST(FirstTouch, LongTwentyThousandRandomSweeps) {
    throw_around(20000, 11);
    const uint32_t fresh = std::random_device{}();
    std::printf("fresh seed %u\n", fresh);
    throw_around(2000, fresh);
}

// P22. The tip of a rotating rod: it hits a wall at the angle whose sine is height over length.
TEST(FirstTouch, P22_TurningRodHitsAWall) {
    const Solid rod(reference::make_box({0, -1e-4, -1e-4}, {0.1, 1e-4, 1e-4})), wall(reference::make_box({-1, -1, -0.1}, {1, 1, 0}));
    for (const double height : {0.01, 0.03, 0.06}) {
        RigidSweep sweep;
        sweep.position = {0, 0, height};
        sweep.spin = {0, 50, 0};
        // the lower edge of the tip is 1e-4 below its axis and rotates with it
        const double length = std::hypot(0.1, 1e-4), exact = (std::asin(height / length) - std::atan2(1e-4, 0.1)) / 50;
        const double found = first_touch(rod.view(), *rod.tree, wall.view(), *wall.tree, sweep, 1.0 / 60, 1e-6);
        EXPECT_LE(found, exact + 1e-12);
        EXPECT_NEAR(found, exact, 1e-2 / 60);
    }
}

// P21. No motion: no touch, or at once when near.
TEST(FirstTouch, P21_AtRestAndSlidingInThePlane) {
    const Solid box(reference::make_box({-0.01, -0.01, -0.01}, {0.01, 0.01, 0.01})), wall(reference::make_box({-1, -1, -0.1}, {1, 1, 0}));
    RigidSweep sweep;
    sweep.position = {0, 0, 0.0101};
    EXPECT_EQ(first_touch(box.view(), *box.tree, wall.view(), *wall.tree, sweep, 0.02, 1e-5), kNever);
    sweep.velocity = {1, 0, 0};  // along the wall, farther than the tolerance
    EXPECT_EQ(first_touch(box.view(), *box.tree, wall.view(), *wall.tree, sweep, 0.005, 1e-5), kNever);
    sweep.position.z() = 0.01;
    EXPECT_EQ(first_touch(box.view(), *box.tree, wall.view(), *wall.tree, sweep, 0.1, 1e-5), 0);
}

}  // namespace
