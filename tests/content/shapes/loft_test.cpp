#include "content/shapes/loft.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "content/mend/admission.hpp"
#include "content/shapes/tube.hpp"
#include "tests/reference/closed_surface.hpp"
#include "tests/reference/profile_volume.hpp"
namespace trocar {
namespace {

CentreLine straight(double length) {
    return measure_curve([length](double t) { return Vec3d(0.1 + t * length * 0.6, 0.2, t * length * 0.8); });
}

TEST(Loft, TubeWithARoundProfileIsASphere) {
    const double r = 0.03;
    const CentreLine line = straight(2 * r);
    const RadiusProfile profile = make_profile({{0, 0}, {r, r}, {2 * r, 0}});
    const Mesh mesh = loft_surface(tube_loft(line, profile), 8000);
    const Vec3d centre(0.1 + r * 0.6, 0.2, r * 0.8);
    for (const Vec3d& p : mesh.position) ASSERT_NEAR((p - centre).norm(), r, 1e-9);
    EXPECT_NEAR(reference::profile_volume(profile), 4.0 / 3 * M_PI * r * r * r, 1e-12);
    const auto facts = reference::survey_surface(mesh);
    EXPECT_TRUE(facts.closed && facts.one_fan);
    EXPECT_EQ(facts.euler, 2);
    EXPECT_NEAR(facts.volume / reference::profile_volume(profile), 1, 2e-3);
    EXPECT_NEAR(double(mesh.triangle.size()), 8000, 80);
    EXPECT_GT(reference::survey_shape(mesh).min_angle, 25);
}

TEST(Loft, RingSweepIsATorus) {
    const double big = 0.05, small = 0.012;
    Loft loft;
    loft.ring = true;
    loft.point = [=](double u, double v) {
        const double a = 2 * M_PI * u, b = 2 * M_PI * v;
        return Vec3d((big + small * std::cos(a)) * std::cos(b), (big + small * std::cos(a)) * std::sin(b), small * std::sin(a));
    };
    for (const uint32_t wanted : {1000u, 10000u}) {
        const Mesh mesh = loft_surface(loft, wanted);
        // edge of an equilateral triangle, and the deficit of a polygon of such edges against the circle
        // around the tube
        const double edge = std::sqrt(4 * M_PI * M_PI * big * small / wanted / (std::sqrt(3.0) / 4));
        const double miss = edge * edge / (6 * small * small);
        const auto facts = reference::survey_surface(mesh);
        EXPECT_TRUE(facts.closed && facts.one_fan);
        EXPECT_EQ(facts.components, 1u);
        EXPECT_EQ(facts.euler, 0);
        EXPECT_NEAR((1 - facts.volume / (2 * M_PI * M_PI * big * small * small)) / miss, 1, 0.25);
        EXPECT_EQ(judge_mesh(mesh).admitted_as, Admission::kSolid);
        EXPECT_NEAR(double(mesh.triangle.size()), wanted, 0.03 * wanted);
    }
}

TEST(Loft, CornersAndCreasesAreVerticesHenceABlockIsExact) {
    Loft loft;
    loft.pieces = 3;  // cap, walls, cap
    loft.corner = {0, 0.25, 0.5, 0.75};
    loft.point = [](double u, double v) {
        const Vec3d corner[5] = {{-1, -2, 0}, {1, -2, 0}, {1, 2, 0}, {-1, 2, 0}, {-1, -2, 0}};
        const int side = std::min(3, int(4 * u));
        const Vec3d rim = corner[side] + (4 * u - side) * (corner[side + 1] - corner[side]);
        const double share = v < 1 ? v : v > 2 ? 3 - v : 1.0;
        return Vec3d(share * rim + Vec3d(0, 0, 3 * std::clamp(v - 1, 0.0, 1.0)));
    };
    for (const uint32_t wanted : {60u, 1000u}) {
        const auto facts = reference::survey_surface(loft_surface(loft, wanted));
        EXPECT_TRUE(facts.closed && facts.one_fan) << wanted;
        EXPECT_EQ(facts.euler, 2) << wanted;
        EXPECT_NEAR(facts.volume, 24, 1e-12) << wanted;
        EXPECT_NEAR(facts.area, 2 * 8 + 2 * 6 + 2 * 12, 1e-12) << wanted;
    }
}

TEST(Loft, CentreLineMeasuresLengthAndKeepsAxesPerpendicularAndUntwisted) {
    // two turns of a helix: length, and frames that rotate by the total torsion, not with the curve
    const double r = 0.02, pitch = 0.01;
    const CentreLine line =
        measure_curve([=](double t) { return Vec3d(r * std::cos(4 * M_PI * t), r * std::sin(4 * M_PI * t), 2 * pitch * t); });
    EXPECT_NEAR(line.length, 2 * std::hypot(2 * M_PI * r, pitch), 1e-6);
    for (double s = 0; s <= line.length; s += line.length / 37) {
        Vec3d along, x, y;
        const Vec3d p = line.at(s, along, x, y);
        EXPECT_NEAR(std::hypot(p.x(), p.y()), r, 1e-6);
        EXPECT_NEAR(along.dot(x), 0, 1e-12);
        EXPECT_NEAR(along.dot(y), 0, 1e-12);
        EXPECT_NEAR(x.norm(), 1, 1e-12);
        EXPECT_GT(along.cross(x).dot(y), 0.999);
    }
    // rotation minimising: the derivative of an axis has no component across the curve
    double twist = 0;
    for (size_t i = 0; i + 1 < line.point.size(); ++i) {
        const Vec3d y = (line.tangent[i] + line.tangent[i + 1]).cross(line.across[i] + line.across[i + 1]) / 4;
        twist += std::abs((line.across[i + 1] - line.across[i]).dot(y));
    }
    EXPECT_LT(twist, 1e-3);
}

TEST(Loft, CurvePassesThroughItsPointsAndProfileThroughItsKeysWithoutOvershoot) {
    const std::vector<Vec3d> points{{0, 0, 0}, {1, 2, 0}, {3, 1, -1}, {4, 4, 1}};
    const auto curve = curve_through(points);
    for (size_t i = 0; i < points.size(); ++i) EXPECT_LT((curve(i / 3.0) - points[i]).norm(), 1e-12);
    const std::vector<RadiusKey> keys{{0, 0}, {1, 2}, {2, 3}, {4, 1}, {5, 1.5}, {6, 1.5}, {7, 0}};
    const RadiusProfile profile = make_profile(keys);
    double sum = 0;
    const int steps = 700000;
    for (int i = 0; i < steps; ++i) {
        const double s = 7 * (i + 0.5) / steps, r = profile.radius(s);
        size_t k = 0;
        while (s > keys[k + 1].s) ++k;
        ASSERT_GE(r, std::min(keys[k].radius, keys[k + 1].radius) - 1e-12) << s;
        ASSERT_LE(r, std::max(keys[k].radius, keys[k + 1].radius) + 1e-12) << s;
        sum += M_PI * r * r * 7 / steps;
    }
    EXPECT_NEAR(reference::profile_volume(profile), sum, 1e-6);
}

TEST(Loft, TextureRunsAWholeNumberOfTimesAroundWithoutAJump) {
    const CentreLine line = straight(0.3);
    Loft loft = tube_loft(line, make_profile({{0, 0}, {0.02, 0.02}, {0.28, 0.02}, {0.3, 0}}));
    loft.tile = 0.03;
    const Mesh mesh = loft_surface(loft, 5000);
    // circumference 0.126: 4 repeats around; length about 0.3 plus a little: both scales are known
    double most_u = 0, most_v = 0;
    for (const auto& uv : mesh.uv) {
        for (int k = 0; k < 3; ++k) {
            EXPECT_LT(std::abs(uv[k].u - uv[(k + 1) % 3].u), 0.7);
            most_u = std::max(most_u, double(uv[k].u));
            most_v = std::max(most_v, double(uv[k].v));
        }
    }
    EXPECT_GE(most_u, 4 - 1e-6);
    EXPECT_LT(most_u, 4.5);
    EXPECT_NEAR(most_v, std::round(most_v), 1e-5);
    EXPECT_NEAR(most_v, 0.31 / 0.03, 1);
}

}  // namespace
}  // namespace trocar
