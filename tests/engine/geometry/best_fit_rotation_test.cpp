#include "engine/geometry/best_fit_rotation.hpp"

#include <gtest/gtest.h>

#include <random>

#include "engine/geometry/quaternion.hpp"
#include "tests/reference/dense.hpp"
namespace trocar {
namespace {

using Eigen::Matrix3d;

Matrix3d matrix(const std::array<Vec3d, 3>& rows) {
    Matrix3d m;
    for (int i = 0; i < 3; ++i) m.row(i) = rows[i];
    return m;
}

// Oracle: the proper rotation from Eigen's singular vectors. A wrong sign of a torque or of the Hessian does not
// converge.
TEST(BestFitRotation, AgreesWithSingularVectors) {
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    for (int trial = 0; trial < 500; ++trial) {
        Vec3d turn(normal(random), normal(random), normal(random));
        if (turn.norm() > 2.5) turn *= 2.5 / turn.norm();
        const Matrix3d rotation = matrix(rotation_rows(from_rotation_vector(turn)));
        // shapes from round to needle-like, sheared
        Matrix3d stretch = Matrix3d::Identity() * std::pow(10.0, normal(random));
        stretch(0, 0) *= 1 + 1e3 * (trial % 3 == 1);
        stretch += 0.1 * stretch.norm() * (trial % 2) * Matrix3d::Random();
        if (stretch.determinant() <= 1e-6 * std::pow(stretch.norm(), 3)) continue;
        const Matrix3d a = rotation * stretch;
        if (a.determinant() < 0) continue;
        const Matrix3d expected = reference::nearest_rotation(a);
        const Quat q = best_fit_rotation({a.row(0), a.row(1), a.row(2)}, {});
        EXPECT_LT((matrix(rotation_rows(q)) - expected).norm(), 1e-9) << trial;
    }
}

TEST(BestFitRotation, KeepsTheStartWhereNothingIsToBeFitted) {
    const Quat start = from_rotation_vector({0.1, 0.2, 0.3});
    const Quat zero = best_fit_rotation({Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero()}, start);
    const Quat bad = best_fit_rotation({Vec3d::Constant(std::nan("")), Vec3d::Zero(), Vec3d::Zero()}, start);
    EXPECT_EQ(zero.w, start.w);
    EXPECT_EQ(bad.x, start.x);
}

TEST(BestFitRotation, SolvesSymmetricSystems) {
    Vec3d x;
    ASSERT_TRUE(solve_symmetric({4, 5, 6, 1, -1, 2}, {1, 2, 3}, x));
    EXPECT_NEAR(4 * x[0] + 1 * x[1] - 1 * x[2], 1, 1e-14);
    EXPECT_NEAR(1 * x[0] + 5 * x[1] + 2 * x[2], 2, 1e-14);
    EXPECT_NEAR(-1 * x[0] + 2 * x[1] + 6 * x[2], 3, 1e-14);
    EXPECT_FALSE(solve_symmetric({1, 1, 1, 2, 0, 0}, {1, 2, 3}, x));
}

}  // namespace
}  // namespace trocar
