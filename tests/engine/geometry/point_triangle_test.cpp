#include "engine/geometry/point_triangle.hpp"

#include <gtest/gtest.h>

#include <random>

#include "engine/geometry/four_triangles.hpp"
#include "tests/engine/distance/closest_point_meshes.hpp"
#include "tests/reference/brute_force_distance.hpp"
namespace trocar {
namespace {

double distance_of(const TrianglePoint& t) { return std::sqrt(t.squared_distance); }

// A triangle of longest edge about 1 and 2 * area = aspect: a needle (one short edge) or a cap (three nearly
// collinear edges).
std::array<Vec3d, 3> random_sliver(std::mt19937_64& random, double aspect, bool cap) {
    std::uniform_real_distribution<double> unit(0, 1);
    const Vec3d u = random_direction(random), w = random_direction(random);
    const Vec3d v = (w - w.dot(u) * u).normalized();
    const Vec3d a(unit(random), unit(random), unit(random));
    return {a, a + u, a + (cap ? 0.2 + 0.6 * unit(random) : aspect * unit(random)) * u + aspect * v};
}

// Fails if the normal ignores its rounding errors, if a needle's tip is tested by planes only, or if a cap is
// tested by its sides only.
TEST(PointTriangle, DistanceIsExactForAspectsDownTo1e10) {
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> unit(0, 1);
    for (int i = 0; i < 40000; ++i) {
        const double aspect = std::pow(10.0, -10 * unit(random));
        const auto t = random_sliver(random, aspect, i & 1);
        const double s = unit(random), r = unit(random) * (1 - s);
        const double reach = std::pow(10.0, -9 * unit(random));
        const Vec3d on = t[0] + s * (t[1] - t[0]) + r * (t[2] - t[0]);
        const Vec3d p = i % 3 == 0 ? Vec3d(t[i % 2] + reach * random_direction(random)) : Vec3d(on + reach * random_direction(random));
        const double exact = exact_triangle_distance(p, t[0], t[1], t[2]);
        const TrianglePoint got = closest_point_on_triangle(p, t[0], t[1], t[2]);
        ASSERT_NEAR(distance_of(got), exact, 4e-15) << "aspect " << aspect << " reach " << reach << " case " << i;
        ASSERT_NEAR(got.offset.norm(), exact, 4e-15) << "aspect " << aspect;
    }
}

TEST(PointTriangle, BeyondTheTipOfANeedleIsNotOnItsFace) {
    for (const double aspect : {1e-3, 1e-5, 1e-7, 1e-9}) {
        const Vec3d a(0.1, 0.2, 0.3), u = Vec3d(3, 2, 1).normalized(), v = Vec3d(-2, 3, 0).normalized();
        const Vec3d b = a + u, c = a + u + aspect * v;
        for (const double beyond : {1e-12, 1e-9, 1e-6, 1e-3}) {
            const Vec3d p = a - beyond * (b - a + c - a).normalized();
            const TrianglePoint got = closest_point_on_triangle(p, a, b, c);
            EXPECT_NEAR(distance_of(got), exact_triangle_distance(p, a, b, c), 4e-16) << aspect << " " << beyond;
            EXPECT_EQ(got.feature, Feature::kVertex0) << aspect << " " << beyond;
        }
    }
}

TEST(PointTriangle, EveryFeatureIsNamed) {
    const Vec3d a(0, 0, 0), b(4, 0, 0), c(0, 4, 0);
    const auto feature = [&](double x, double y) { return closest_point_on_triangle({x, y, 1}, a, b, c).feature; };
    EXPECT_EQ(feature(1, 1), Feature::kFace);
    EXPECT_EQ(feature(-1, -1), Feature::kVertex0);
    EXPECT_EQ(feature(6, -1), Feature::kVertex1);
    EXPECT_EQ(feature(-1, 6), Feature::kVertex2);
    EXPECT_EQ(feature(2, -1), Feature::kEdge0);
    EXPECT_EQ(feature(3, 3), Feature::kEdge1);
    EXPECT_EQ(feature(-1, 2), Feature::kEdge2);
    EXPECT_EQ(closest_point_on_triangle({1, 1, 1}, a, b, c).height, 1);
    EXPECT_EQ(closest_point_on_triangle({1, 1, -2}, a, b, c).height, -2);
}

// G08: two triangles that share an edge or a vertex must agree to the last bit; otherwise noise would decide
// ties.
TEST(PointTriangle, G08_SharedFeaturesGiveTheSameBits) {
    std::mt19937_64 random(12);
    for (int i = 0; i < 2000; ++i) {
        const Vec3d a = random_direction(random), b = random_direction(random), p = 3 * random_direction(random);
        const TrianglePoint s = closest_point_on_triangle(p, a, b, a), t = closest_point_on_triangle(p, b, a, b);
        ASSERT_NEAR(s.squared_distance, t.squared_distance, 4e-15);
        if (s.feature < Feature::kEdge0) {
            ASSERT_EQ(s.squared_distance, t.squared_distance);
        }
    }
}

// G09, G10: thin triangles against the distance to the segment they nearly are.
TEST(PointTriangle, G09_G10_SliversEqualTheirSegment) {
    for (const double width : {1e-4, 1e-6, 1e-7}) {
        const Vec3d a(0, 0, 0), b(1, 0, 0), c(0.5, width, 0);
        for (const double z : {1e-3, 0.1, 2.0}) {
            const Vec3d p(0.3, 0, z);
            for (const auto& t : {std::array{a, b, c}, std::array{b, c, a}, std::array{c, a, b}, std::array{b, a, c}, std::array{a, c, b},
                                  std::array{c, b, a}})
                EXPECT_NEAR(distance_of(closest_point_on_triangle(p, t[0], t[1], t[2])), z, 4e-16) << width;
        }
    }
}

TEST(PointTriangle, G11_CollinearCornersAreASegment) {
    const Vec3d a(0, 0, 0), b(1, 1, 1), c(3, 3, 3);
    for (const auto& t : {std::array{a, b, c}, std::array{b, c, a}, std::array{c, a, b}}) {
        const TrianglePoint got = closest_point_on_triangle({2, 2, 3}, t[0], t[1], t[2]);
        EXPECT_NEAR(distance_of(got), std::sqrt(2.0 / 3.0), 4e-16);
        EXPECT_NE(got.feature, Feature::kFace);
    }
    EXPECT_EQ(triangle_normal(a, b, c).norm(), 0);
}

TEST(PointTriangle, G12_EqualCornersAreAPoint) {
    const Vec3d a(1, 2, 3);
    const TrianglePoint got = closest_point_on_triangle({1, 2, 7}, a, a, a);
    EXPECT_EQ(distance_of(got), 4);
    EXPECT_EQ(got.feature, Feature::kVertex0);
}

TEST(PointTriangle, G28_G29_ScaleDoesNotMatter) {
    std::mt19937_64 random(13);
    for (int i = 0; i < 2000; ++i) {
        const auto t = random_sliver(random, i & 1 ? 1.0 : 1e-6, i & 2);
        const Vec3d p = t[0] + 0.1 * random_direction(random);
        const double one = distance_of(closest_point_on_triangle(p, t[0], t[1], t[2]));
        for (const double s : {0x1p-30, 0x1p-20, 0x1p20, 0x1p30}) {
            const TrianglePoint got = closest_point_on_triangle(s * p, s * t[0], s * t[1], s * t[2]);
            ASSERT_EQ(distance_of(got), s * one) << "scale " << s;
        }
    }
}

// Four at a time give the same bits as one at a time: triangles of all shapes down to points, queries next to
// every feature, on it, and far away, lanes in any mixture. Breaks when an operation differs or is fused with
// another.
TEST(FourTriangles, GiveTheBitsOfOneByOne) {
    std::mt19937_64 random(17);
    std::uniform_real_distribution<double> unit(0, 1);
    std::array<size_t, 7> features{};
    for (int i = 0; i < 60000; ++i) {
        std::array<std::array<Vec3d, 3>, 4> t;
        for (size_t lane = 0; lane < 4; ++lane) {
            const int kind = (i + static_cast<int>(lane)) % 5;
            t[lane] = random_sliver(random, kind == 0 ? 1.0 : std::pow(10.0, -12 * unit(random)), kind & 1);
            if (kind == 2) t[lane][2] = t[lane][0] + unit(random) * (t[lane][1] - t[lane][0]);  // in a line, to rounding
            if (kind == 3 && i % 7 == 0) t[lane][1] = t[lane][0];
            if (kind == 4 && i % 11 == 0) t[lane][1] = t[lane][2] = t[lane][0];
        }
        const auto& near = t[static_cast<size_t>(i % 4)];
        const double s = 1.4 * unit(random) - 0.2, r = 1.4 * unit(random) - 0.2;
        Vec3d p =
            near[0] + s * (near[1] - near[0]) + r * (near[2] - near[0]) + std::pow(10.0, -9 * unit(random)) * random_direction(random);
        if (i % 13 == 0) p = near[i % 3];
        const auto corners = [&](size_t k) { return side_by_side(to_vec4(t[0][k]), to_vec4(t[1][k]), to_vec4(t[2][k]), to_vec4(t[3][k])); };
        const Vec4d got = squared_distances({all_lanes(p.x()), all_lanes(p.y()), all_lanes(p.z())}, {corners(0), corners(1), corners(2)});
        for (size_t lane = 0; lane < 4; ++lane) {
            const TrianglePoint wanted = closest_point_on_triangle(p, t[lane][0], t[lane][1], t[lane][2]);
            ++features[static_cast<size_t>(wanted.feature)];
            ASSERT_EQ(got[lane], wanted.squared_distance)
                << "case " << i << " lane " << lane << " feature " << static_cast<int>(wanted.feature);
        }
    }
    for (const size_t count : features) EXPECT_GT(count, 500u);
}

}  // namespace
}  // namespace trocar
