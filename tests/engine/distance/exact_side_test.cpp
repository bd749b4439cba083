#include "tests/reference/exact_side.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "engine/distance/closest_point.hpp"
#include "engine/geometry/winding_number.hpp"
#include "tests/engine/distance/closest_point_meshes.hpp"

// Sides within rounding of thin surfaces, against exact winding numbers.
namespace trocar {
namespace {

Eigen::Quaterniond any_turn(std::mt19937& random) {
    std::normal_distribution<double> normal;
    return Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random)).normalized();
}

// Two cones of slivers that alternate between two radii, base to base.
TestMesh make_fan(uint32_t n, double inner, double height, std::mt19937& random) {
    std::uniform_real_distribution<double> jitter(-0.05, 0.05);
    std::vector<Vec3d> position{{0, 0, height}, {0, 0, -height}};
    std::vector<Triangle> triangle;
    for (uint32_t i = 0; i < n; ++i) {
        const double angle = 2 * M_PI * i / n, r = i % 2 ? 1 : inner;
        position.push_back({r * std::cos(angle), r * std::sin(angle), jitter(random)});
        const uint32_t a = 2 + i, b = 2 + (i + 1) % n;
        triangle.push_back({0, a, b});
        triangle.push_back({1, b, a});
    }
    return TestMesh(position, triangle);
}

// Sheets and needles 1e-6 to 3e-12 thin and fans of slivers, at any angle.
std::vector<TestMesh> thin_meshes() {
    std::mt19937 random(44);
    std::vector<TestMesh> out;
    for (int i = 0; i < 8; ++i) {
        const double thin = std::pow(10, -6 - 0.8 * i);
        const Eigen::Quaterniond a = any_turn(random), b = any_turn(random), c = any_turn(random);
        out.push_back(make_icosphere(2).moved([&](const Vec3d& x) -> Vec3d { return a * Vec3d(x.x(), x.y(), thin * x.z()); }));
        out.push_back(make_icosphere(2).moved([&](const Vec3d& x) -> Vec3d { return b * Vec3d(thin * x.x(), thin * x.y(), x.z()); }));
        out.push_back(make_fan(40, 0.1 + 0.1 * i, 0.2 + 0.3 * i, random).moved([&](const Vec3d& x) -> Vec3d { return c * x; }));
    }
    return out;
}

// On corners, edges and faces as rounding leaves them, and 1e-17 to 1 away.
std::vector<Vec3d> points_at_features(const TestMesh& mesh, uint32_t count, std::mt19937& random) {
    std::uniform_real_distribution<double> share(0.01, 1), digits(-17, 0);
    std::normal_distribution<double> normal;
    std::vector<Vec3d> out;
    for (uint32_t i = 0; i < count; ++i) {
        const Triangle& t = mesh.triangle[random() % mesh.triangle.size()];
        double w[3] = {share(random), i % 3 < 2 ? share(random) : 0, i % 3 < 1 ? share(random) : 0};
        const double sum = w[0] + w[1] + w[2];
        Vec3d p = Vec3d::Zero();
        for (int k = 0; k < 3; ++k) p += w[k] / sum * mesh.position[t[k]];
        if (i % 2) p += std::pow(10, digits(random)) * Vec3d(normal(random), normal(random), normal(random));
        out.push_back(p);
    }
    return out;
}

TEST(ExactSide, RoundingNeverHidesTheSideOfThinSolids) {
    std::mt19937 random(45);
    uint32_t close = 0, inside = 0;
    for (const Admission admission : {Admission::kSolid, Admission::kWinding}) {
        uint32_t number = 0;
        for (TestMesh& mesh : thin_meshes()) {
            ++number;
            mesh.info.admission = admission;
            ClosestPointTree tree(mesh.view());
            tree.cross_check(true);
            const std::vector<Vec3d> points = points_at_features(mesh, 1000, random);
            const std::vector<double> radius(points.size(), INFINITY);
            std::vector<SurfacePoint> got(points.size());
            QueryCounters counters;
            tree.query(points, radius, {}, got, counters);
            for (size_t i = 0; i < points.size(); ++i) {
                int windings;
                if (!exact_windings(mesh.position, mesh.triangle, points[i], windings)) continue;
                if (got[i].distance == 0 && admission == Admission::kWinding) continue;
                ASSERT_EQ(std::signbit(got[i].distance), windings > 0)
                    << "mesh " << number << ", " << points[i].transpose() << ", distance " << got[i].distance << ", feature "
                    << int(got[i].feature);
                close += std::abs(got[i].distance) < 1e-15;
                inside += windings > 0;
            }
            EXPECT_EQ(counters.disagreements, 0u);
        }
    }
    EXPECT_GT(close, 1000u);
    EXPECT_GT(inside, 1000u);
}

// Solid angles add up to whole numbers inside needles, where the arctangent formula cancels.
TEST(ExactSide, SolidAnglesOfNeedlesAddUp) {
    std::mt19937 random(46);
    std::normal_distribution<double> normal;
    uint32_t inside = 0;
    for (int i = 0; i < 20; ++i) {
        const double thin = std::pow(10, -3 - 0.4 * i);
        const Eigen::Quaterniond turn = any_turn(random);
        const TestMesh mesh =
            make_icosphere(2).moved([&](const Vec3d& x) -> Vec3d { return turn * Vec3d(thin * x.x(), thin * x.y(), x.z()); });
        for (int k = 0; k < 100; ++k) {
            const Vec3d p = turn * Vec3d(thin * normal(random), thin * normal(random), 0.4 * normal(random));
            int windings;
            if (!exact_windings(mesh.position, mesh.triangle, p, windings)) continue;
            ASSERT_NEAR(winding_number(mesh.position, mesh.triangle, p), windings, 1e-3) << "1:" << 1 / thin << ", " << p.transpose();
            inside += windings == 1;
        }
    }
    EXPECT_GT(inside, 200u);
}

}  // namespace
}  // namespace trocar
