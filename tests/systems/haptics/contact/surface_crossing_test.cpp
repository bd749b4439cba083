#include "systems/haptics/contact/surface_crossing.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <random>

#include "tests/reference/haptic_rig.hpp"
#include "tests/reference/local_patches.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using reference::make_patch;

constexpr double kSpan = 1e-3;  // s

struct Sweep {
    LocalContactModel model;
    NearSurface near;
    SurfaceCrossing crossing(const Vec3d& from, const Vec3d& to) {
        HandTool tool;
        tool.tip_radius = 3e-4;
        const double travel = model.fastest * kSpan;
        gather_near(model, {kSpan, Vec3d::Zero()}, tool, to, travel + (to - from).norm() + 1e-3, near);
        return first_crossing({0, Vec3d::Zero()}, from, to, travel, near);
    }
};

// Against small time steps, in each of which the side of the triangle's plane and the closest point are taken anew.
// Breaks on a lost coefficient of the volume, a root that is not the first, or the wrong direction.
TEST(SurfaceCrossing, AgreesWithSmallSteps) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(-1, 1);
    const auto vector = [&] { return Vec3d(any(random), any(random), any(random)); };
    constexpr int kSteps = 4000;
    uint32_t crossed = 0, free = 0, backwards = 0;
    for (int k = 0; k < 3000; ++k) {
        const bool sheet = k % 2 == 1;
        Mesh mesh;
        for (int v = 0; v < 3; ++v) mesh.position.push_back(3e-3 * vector());
        mesh.triangle.push_back({0, 1, 2});
        Sweep sweep{make_patch(mesh, sheet ? 1e-4 : 0), {}};
        const Vec3d going = 4 * vector();
        for (Vec3d& v : sweep.model.velocity) v = going + 2 * vector();
        group_triangles(sweep.model);
        const Vec3d from = 2e-3 * vector(), to = from + 2e-3 * vector();
        double wanted = 2, before = 0, doubt = 1;
        for (int n = 0; n <= kSteps && wanted > 1; ++n) {
            const double t = double(n) / kSteps;
            const auto corner = [&](int v) { return Vec3d(mesh.position[size_t(v)] + t * kSpan * sweep.model.velocity[size_t(v)]); };
            const Vec3d p = from + t * (to - from), a = corner(0), b = corner(1), c = corner(2), normal = (b - a).cross(c - a).normalized();
            const double side = normal.dot(p - a);
            if (n > 0 && side * before <= 0) {
                const TrianglePoint q = closest_point_on_triangle(p, a, b, c);
                const double beside = (q.offset - normal.dot(q.offset) * normal).norm();
                if (beside >= 1e-9) doubt = std::min(doubt, beside);
                if (beside < 1e-9 && (sheet || before > 0)) wanted = t;
                backwards += beside < 1e-9 && !sheet && before < 0;
            }
            before = side;
        }
        const SurfaceCrossing found = sweep.crossing(from, to);
        if (doubt < 1e-5) continue;  // past an edge within a step
        ASSERT_EQ(found.index != kNone, wanted <= 1) << k;
        (wanted <= 1 ? crossed : free)++;
        if (wanted <= 1) {
            ASSERT_NEAR(found.time, wanted, 2.0 / kSteps) << k;
        }
    }
    EXPECT_GT(crossed, 100u);
    EXPECT_GT(free, 300u);
    EXPECT_GT(backwards, 20u);
}

// A ball that passes over a point at any speed, exactly at a vertex, on an edge or in a face, never misses it, and leaves
// it just above its surface.
TEST(SurfaceCrossing, NothingSlipsThroughBetweenTriangles) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> any(-1, 1), size(-4, -1.5);
    const Mesh ball = reference::make_sphere(Vec3d::Zero(), 0.02, 3);
    for (int k = 0; k < 600; ++k) {
        const Triangle& t = ball.triangle[random() % ball.triangle.size()];
        const Vec3d target = k % 3 == 0   ? ball.position[t[0]]
                             : k % 3 == 1 ? Vec3d(0.5 * (ball.position[t[0]] + ball.position[t[1]]))
                                          : Vec3d((ball.position[t[0]] + ball.position[t[1]] + ball.position[t[2]]) / 3);
        const double way = std::pow(10, size(random));
        const Vec3d direction = (target.normalized() + 0.3 * Vec3d(any(random), any(random), any(random))).normalized();
        Sweep sweep{make_patch(ball), {}};
        for (Vec3d& v : sweep.model.velocity) v = way / kSpan * direction;
        group_triangles(sweep.model);
        const double when = 0.5 + 0.4 * any(random);
        const Vec3d point = target + when * way * direction;
        const SurfaceCrossing found = sweep.crossing(point, point);
        ASSERT_NE(found.index, kNone) << k;
        EXPECT_NEAR(found.time, when, 1e-5 + 1e-8 / way) << k;
        const Vec3d above = above_crossing(found, sweep.near), middle = way * direction;
        EXPECT_NEAR((above - target - middle).norm(), 0, 1e-5) << k;
        EXPECT_GT(above.x(), -1);
    }
}

}  // namespace
}  // namespace trocar
