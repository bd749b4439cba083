// Solids cut from a lattice against closed forms of elasticity: the oracles themselves, and what the engine's tetrahedra miss.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "content/scene/make_solid.hpp"
#include "tests/reference/embedded_statics.hpp"
#include "tests/reference/hexahedra.hpp"
#include "tests/systems/advance/advance_scene.hpp"
#include "tests/systems/advance/tissue/heavy_column.hpp"
namespace trocar {
namespace {

using reference::ElasticCase;
using reference::kCaseModulus;

Eigen::Matrix3d hooke(const ElasticCase& what, double nu, const Vec3d& at, double step) {
    Eigen::Matrix3d gradient;
    for (int k = 0; k < 3; ++k)
        gradient.col(k) = (what.displacement(at + step * Vec3d::Unit(k)) - what.displacement(at - step * Vec3d::Unit(k))) / (2 * step);
    const double mu = kCaseModulus / (2 * (1 + nu)), lambda = 2 * mu * nu / (1 - 2 * nu);
    return lambda * gradient.trace() * Eigen::Matrix3d::Identity() + mu * (gradient + gradient.transpose());
}

// Stresses of an exact solution are those of its displacement and in equilibrium, by differences.
TEST(ClosedForms, AreExactSolutions) {
    const double nu = 0.3;
    for (const ElasticCase& what : {reference::blown_sphere(0.02, 0.04, nu, 4), reference::punched_half_space(0.02, 0.05, nu, 4),
                                    reference::half_space_under_ball(0.02, 0.05, nu, 4)}) {
        for (const Vec3d& at : {Vec3d(0.01, 0.012, -0.022), Vec3d(0.025, -0.004, -0.019), Vec3d(0.003, 0.028, -0.008)}) {
            const double step = 1e-5;
            const Eigen::Matrix3d stress = what.stress(at);
            EXPECT_LT((stress - hooke(what, nu, at, step)).norm(), 1e-4 * stress.norm()) << what.name;
            Vec3d divergence = Vec3d::Zero();
            for (int k = 0; k < 3; ++k)
                divergence += (what.stress(at + step * Vec3d::Unit(k)) - what.stress(at - step * Vec3d::Unit(k))).col(k) / (2 * step);
            EXPECT_LT(divergence.norm(), 1e-4 * stress.norm() / 0.02) << what.name;
        }
    }
    // the depth of the punch, and of the ball
    const double force = 1e-3, mu = kCaseModulus / (2 * (1 + nu));
    EXPECT_NEAR(reference::punched_half_space(0.02, 0.05, nu, 4).displacement(Vec3d(0.01, 0, 0)).z(), -force * (1 - nu) / (4 * mu * 0.02),
                1e-12);
    const ElasticCase ball = reference::half_space_under_ball(0.02, 0.05, nu, 4);
    for (const double r : {0.001, 0.005, 0.015})
        EXPECT_NEAR(ball.displacement(Vec3d(r, 0, -2e-9)).z() / ball.displacement(Vec3d(r, 0, 0)).z(), 1, 3e-3) << r;
    // the vertices carry the whole force
    for (const ElasticCase& what : {ball, reference::punched_half_space(0.02, 0.05, nu, 4)}) {
        double sum = 0;
        for (const Vec3d& p : what.shape.position) sum -= what.push(p).z();
        EXPECT_NEAR(sum, what.name.ends_with("punch") ? force : 2 * std::numbers::pi / 3 * 4e-4, 1e-9) << what.name;
    }
}

// The reference of Cook's membrane: a thin one has the value of plane stress (23.96 for a modulus of 1, nu of 1/3, a force of 1; Bergan,
// Felippa, CMAME 50, 1985), and a thick one converges.
TEST(ClosedForms, TheReferenceOfCooksMembraneConverges) {
    const auto cook = [](int along, int across, double thick, double nu) {
        std::array<Vec3d, 8> corner;
        for (int i = 0; i < 8; ++i) corner[i] = Vec3d((i & 1) * thick, i >= 4 ? 44 + (i & 2 ? 16 : 0) : (i & 2 ? 44 : 0), i >= 4 ? 48 : 0);
        return reference::push_hexahedron(corner, {across, along, along}, 1, nu, Vec3d(0, 1.0 / 16, 0));
    };
    const double thin = cook(8, 1, 0.5, 1.0 / 3);
    std::printf("[   figure ] Cook's membrane, thin: %.3f (plane stress 23.96)\n", thin);
    EXPECT_NEAR(thin, 23.96, 0.003 * 23.96);
    const double coarse = cook(4, 2, 16, 0.3), fine = cook(6, 2, 16, 0.3);
    EXPECT_NEAR(coarse, fine, 5e-3 * fine);
}

double compliance(const ElasticCase& what, double cells, double nu) {
    AdvanceScene s;
    const Prototype made = make_solid(s.meshes, s.springs, s.solids, what.shape, {}, {.cells = cells, .skin = true, .filled = true});
    return reference::load_surface(s.meshes, s.springs, s.solids, made.row, TissueLaw::kNeoHookean, nu, what).compliance;
}

// Energy at 6 and 12 cells along the longest side; all too stiff. The edge of a flat punch and the corner of a held face have stresses
// without bound, where even cells converge in first order.
TEST(ClosedForms, SolidsConvergeToThem) {
    struct Bound {
        ElasticCase what;
        double coarse, fine, order;
    };
    const double nu = 0.3;
    const Bound bounds[] = {{reference::blown_sphere(0.02, 0.04, nu, 30), 0.17, 0.053, 1.6},
                            {reference::half_space_under_ball(0.02, 0.05, nu, 20), 0.175, 0.06, 1.5},
                            {reference::punched_half_space(0.02, 0.05, nu, 20), 0.22, 0.11, 0.95},
                            {reference::cooks_membrane(nu, 20), 0.08, 0.033, 1.2}};
    for (const Bound& b : bounds) {
        const double coarse = compliance(b.what, 6, nu), fine = compliance(b.what, 12, nu), order = std::log2(std::abs(coarse / fine));
        std::printf("[   figure ] %s: %+.2f, %+.2f %%, order %.2f\n", b.what.name.c_str(), 100 * coarse, 100 * fine, order);
        EXPECT_LT(std::abs(coarse), b.coarse) << b.what.name;
        EXPECT_LT(std::abs(fine), b.fine) << b.what.name;
        EXPECT_GT(order, b.order) << b.what.name;
    }
}

// The weight under which a column buckles.
TEST(ClosedForms, AColumnBucklesUnderItsOwnWeight) {
    const HeavyColumn slender{0.001, 0.3}, column{0.025, 0.3};
    EXPECT_NEAR(slender.critical_weight() * std::pow(HeavyColumn::kLength, 3) / slender.bending(), 7.8373, 5e-3) << "Greenhill";
    EXPECT_NEAR(slender.critical_weight(true) * std::pow(HeavyColumn::kLength, 3) / slender.bending(), 7.8373, 1e-3);
    const double off = column.measured_weight(12, TissueLaw::kNeoHookean) / column.critical_weight() - 1;
    std::printf("[   figure ] column a quarter as wide as high, 12 cells: buckles at %+.1f %%\n", 100 * off);
    EXPECT_LT(std::abs(off), 0.12);
}

}  // namespace
}  // namespace trocar
