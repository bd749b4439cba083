#include "engine/geometry/triangle_triangle.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "tests/reference/meet_by_differences.hpp"

namespace trocar {
namespace {

using namespace reference;

Vec3d to_vec(const Point& p) { return Vec3d(double(p[0]), double(p[1]), double(p[2])); }
Corners to_corners(const std::vector<Point>& t) { return {to_vec(t[0]), to_vec(t[1]), to_vec(t[2])}; }

struct Sampler {
    std::mt19937_64 random;
    int64_t range;
    Point point() {
        std::uniform_int_distribution<int64_t> u(-range, range);
        return {u(random), u(random), u(random)};
    }
    std::vector<Point> points(int count) {
        std::vector<Point> out;
        for (int i = 0; i < count; ++i) out.push_back(point());
        return out;
    }
};

struct Tally {
    int count[3] = {0, 0, 0};
    void add(Meeting m) { ++count[static_cast<int>(m)]; }
};

// Every corner order and both triangle orders must give the oracle's result.
void check_pair(const std::vector<Point>& a, const std::vector<Point>& b, int trial, Tally& tally) {
    const Meeting expected = meet_by_differences(a, b);
    tally.add(expected);
    std::array<int, 3> order{0, 1, 2};
    int turned = trial % 6;  // one of the six orders of b in each trial, all six of a
    std::array<int, 3> b_order{0, 1, 2};
    while (turned-- > 0) std::next_permutation(b_order.begin(), b_order.end());
    const Corners tb = to_corners({b[b_order[0]], b[b_order[1]], b[b_order[2]]});
    do {
        const Corners ta = to_corners({a[order[0]], a[order[1]], a[order[2]]});
        ASSERT_EQ(meet_triangles(ta, tb), expected) << "trial " << trial;
        ASSERT_EQ(meet_triangles(tb, ta), expected) << "trial " << trial;
    } while (std::next_permutation(order.begin(), order.end()));
}

// On a grid of seven or three steps per axis most pairs share planes, lines or corners, and many have zero
// area.
TEST(TriangleTriangle, DegenerateGridPairsAgreeWithOracle) {
    for (const int64_t range : {1, 3}) {
        Sampler sampler{std::mt19937_64(10 + range), range};
        Tally tally;
        for (int trial = 0; trial < 25000 && !HasFatalFailure(); ++trial) {
            const auto a = sampler.points(3), b = sampler.points(3);
            check_pair(a, b, trial, tally);
        }
        for (const int n : tally.count) EXPECT_GT(n, 1000) << "range " << range;
    }
}

TEST(TriangleTriangle, CoplanarPairsAgreeWithOracle) {
    Sampler sampler{std::mt19937_64(20), 3};
    Tally tally;
    for (int trial = 0; trial < 12000 && !HasFatalFailure(); ++trial) {
        // a slanted common plane: z = x - 2 y
        auto a = sampler.points(3), b = sampler.points(3);
        for (auto* t : {&a, &b}) {
            for (Point& p : *t) p[2] = p[0] - 2 * p[1];
        }
        check_pair(a, b, trial, tally);
    }
    for (const int n : tally.count) EXPECT_GT(n, 1000);
}

TEST(TriangleTriangle, PairsThatShareCornersAgreeWithOracle) {
    Sampler sampler{std::mt19937_64(30), 4};
    Tally tally;
    for (int trial = 0; trial < 15000 && !HasFatalFailure(); ++trial) {
        auto a = sampler.points(3), b = sampler.points(3);
        b[0] = a[1];
        if (trial % 2 == 0) b[2] = a[0];
        check_pair(a, b, trial, tally);
    }
    EXPECT_EQ(tally.count[0], 0);  // they always share that corner
    for (int k : {1, 2}) EXPECT_GT(tally.count[k], 1000);
}

TEST(TriangleTriangle, RandomPairsAgreeWithOracle) {
    Sampler sampler{std::mt19937_64(40), 1 << 20};
    Tally tally;
    for (int trial = 0; trial < 30000 && !HasFatalFailure(); ++trial) {
        const auto a = sampler.points(3), b = sampler.points(3);
        check_pair(a, b, trial, tally);
    }
    EXPECT_GT(tally.count[0], 1000);
    EXPECT_GT(tally.count[2], 1000);
}

TEST(TriangleTriangle, SegmentsAgreeWithOracle) {
    for (const int64_t range : {1, 2, 4, 1 << 20}) {
        Sampler sampler{std::mt19937_64(50 + range), range};
        Tally tally;
        for (int trial = 0; trial < 12000; ++trial) {
            const auto s = sampler.points(2), t = sampler.points(3);
            const Meeting expected = meet_by_differences(s, t);
            tally.add(expected);
            std::array<int, 3> order{0, 1, 2};
            do {
                const Corners corners = to_corners({t[order[0]], t[order[1]], t[order[2]]});
                ASSERT_EQ(meet_segment_triangle(to_vec(s[0]), to_vec(s[1]), corners), expected) << "trial " << trial;
                ASSERT_EQ(meet_segment_triangle(to_vec(s[1]), to_vec(s[0]), corners), expected) << "trial " << trial;
            } while (std::next_permutation(order.begin(), order.end()));
        }
        EXPECT_GT(tally.count[0], 1000) << range;
        EXPECT_GT(tally.count[2], 100) << range;
    }
}

// One last bit decides at a distance of 1e4 sizes: a test with rounding errors would report touching.
TEST(TriangleTriangle, OneLastBitDecides) {
    const double far = 1e4;
    const Corners floor{Vec3d(far, far, far), Vec3d(far + 1, far, far), Vec3d(far, far + 1, far)};
    const Vec3d foot(far + 0.25, far + 0.25, far);
    const Vec3d up(0, 0, 1), side(0.1, 0, 0);
    const auto standing = [&](double z) {
        Vec3d tip = foot;
        tip.z() = z;
        return Corners{tip, foot + up, foot + up + side};
    };
    EXPECT_EQ(meet_triangles(floor, standing(far)), Meeting::kTouching);
    EXPECT_EQ(meet_triangles(floor, standing(std::nextafter(far, 2 * far))), Meeting::kDisjoint);
    EXPECT_EQ(meet_triangles(floor, standing(std::nextafter(far, 0.0))), Meeting::kCrossing);
}

}  // namespace
}  // namespace trocar
