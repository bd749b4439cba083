#include "engine/geometry/predicates.hpp"

#include <gtest/gtest.h>

#include <array>
#include <random>

#include "tests/reference/big_integer.hpp"

namespace trocar {
namespace {

using reference::BigInteger;

int exact_orient3d(const std::array<Vec3d, 4>& p, int shift) {
    BigInteger m[3][3];
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) m[i][k] = reference::scaled(p[i + 1][k], shift) - reference::scaled(p[0][k], shift);
    }
    BigInteger det;
    for (int k = 0; k < 3; ++k) {
        const int l = (k + 1) % 3, n = (k + 2) % 3;
        det = det + m[2][k] * (m[0][l] * m[1][n] - m[0][n] * m[1][l]);
    }
    return reference::sign_of(det);
}

int exact_orient2d(const std::array<double, 6>& x, int shift) {
    BigInteger b[6];
    for (int i = 0; i < 6; ++i) b[i] = reference::scaled(x[i], shift);
    return reference::sign_of((b[0] - b[4]) * (b[3] - b[5]) - (b[1] - b[5]) * (b[2] - b[4]));
}

TEST(Predicates, SignConvention) {
    const Vec3d o(0, 0, 0), x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
    EXPECT_EQ(orient3d(o, x, y, z), 1);
    EXPECT_EQ(orient3d(o, y, x, z), -1);
    EXPECT_EQ(orient3d(o, x, y, x + y), 0);
    EXPECT_EQ(orient2d(0, 0, 1, 0, 0, 1), 1);
    EXPECT_EQ(orient2d(0, 0, 0, 1, 1, 0), -1);
}

// Points within a few last bits of a common plane, far from the origin and with differences that a double
// cannot represent: a filter that ignores rounding, or a dropped low-order term, gets thousands of these
// wrong.
TEST(Predicates, NearlyCoplanarPointsAgreeWithBigIntegers) {
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::uniform_int_distribution<int> ulps(-2, 2), power(-30, 20);
    int by_sign[3] = {0, 0, 0};
    for (int trial = 0; trial < 30000; ++trial) {
        std::array<Vec3d, 4> p;
        const Vec3d offset = std::ldexp(1.0, power(random)) * Vec3d(unit(random), unit(random), unit(random));
        for (int i = 0; i < 3; ++i) p[i] = offset + Vec3d(unit(random), unit(random), unit(random));
        const double s = unit(random), t = trial % 4 == 0 ? 0.0 : unit(random);
        p[3] = p[0] + s * (p[1] - p[0]) + t * (p[2] - p[0]);
        for (int k = 0; k < 3; ++k) {
            for (int n = ulps(random); n != 0; n += n > 0 ? -1 : 1) p[3][k] = std::nextafter(p[3][k], n > 0 ? 1e30 : -1e30);
        }
        const int expected = exact_orient3d(p, 200);
        ++by_sign[expected + 1];
        ASSERT_EQ(orient3d(p[0], p[1], p[2], p[3]), expected) << "trial " << trial;
        ASSERT_EQ(orient3d(p[1], p[0], p[2], p[3]), -expected) << "trial " << trial;
        ASSERT_EQ(orient3d_exact(p[2], p[3], p[0], p[1]), expected) << "trial " << trial;
    }
    EXPECT_GT(by_sign[0], 2500);
    EXPECT_GT(by_sign[2], 2500);
}

TEST(Predicates, NearlyCollinearPointsAgreeWithBigIntegers) {
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::uniform_int_distribution<int> ulps(-1, 1), power(-30, 20);
    int zeros = 0;
    for (int trial = 0; trial < 50000; ++trial) {
        std::array<double, 6> x;
        for (int i = 0; i < 4; ++i) x[i] = std::ldexp(unit(random), power(random));
        const double t = trial % 3 == 0 ? 0.5 : unit(random);
        // every third: exact midpoints of floats, so that true zeros occur
        for (int i = 0; i < 4 && trial % 3 == 0; ++i) x[i] = static_cast<float>(x[i]);
        for (int k = 0; k < 2; ++k) {
            x[4 + k] = x[k] + t * (x[2 + k] - x[k]);
            for (int n = ulps(random); n != 0; n += n > 0 ? -1 : 1) x[4 + k] = std::nextafter(x[4 + k], n > 0 ? 9e9 : -9e9);
        }
        const int expected = exact_orient2d(x, 200);
        zeros += expected == 0;
        ASSERT_EQ(orient2d(x[0], x[1], x[2], x[3], x[4], x[5]), expected) << "trial " << trial;
        ASSERT_EQ(orient2d(x[4], x[5], x[2], x[3], x[0], x[1]), -expected) << "trial " << trial;
    }
    EXPECT_GT(zeros, 100);
}

// G28, G29: signs at scales whose triple products exceed the range of a double. Without the scaling of the
// exact stage the first flushes to zero and the second overflows.
TEST(Predicates, G28_G29_TinyAndHugeCoordinates) {
    for (const int power : {-500, -330, 0, 330, 600}) {
        const double s = std::ldexp(1.0, power);
        const Vec3d a(0, 0, 0), b(s, 0, s), c(0, s, s), above(s / 2, s / 2, std::nextafter(s, 2 * s));
        EXPECT_EQ(orient3d(a, b, c, Vec3d(s / 2, s / 2, s)), 0) << power;
        EXPECT_EQ(orient3d(a, b, c, above), 1) << power;
        EXPECT_EQ(orient2d(0, 0, s, s, s / 2, std::nextafter(s / 2, s)), 1) << power;
    }
}

}  // namespace
}  // namespace trocar
