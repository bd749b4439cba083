// Elastic laws and relaxation of solids, through the engine's own steps, against closed forms.
#include <gtest/gtest.h>

#include <cstdio>

#include "engine/base/cpu.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "systems/prepare/sleep.hpp"
#include "tests/reference/dense.hpp"
#include "tests/systems/advance/tissue/law_block.hpp"
namespace trocar {
namespace {

const Prony kTwoTimes{{0.8, 0.5}, {0.05, 0.6}};

// A tetrahedral body of the law in double: energy and forces from F = present edges (rest edges)^-1.
struct DoubleLaw {
    NeoHookeanLaw law;
    std::vector<std::array<uint32_t, 4>> tetrahedron;
    std::vector<Eigen::Matrix3d> inverse;
    std::vector<double> volume;

    DoubleLaw(const LawBlock& block, double youngs_modulus, double poisson) : law(youngs_modulus, poisson) {
        const Solids& s = block.scene.solids;
        for (uint32_t t = 0; t < s.info[0].count; ++t) {
            tetrahedron.push_back({s.corner[0][t], s.corner[1][t], s.corner[2][t], s.corner[3][t]});
            const Eigen::Matrix3d edges = edges_of(block.rest, tetrahedron.back());
            inverse.push_back(edges.inverse());
            volume.push_back(edges.determinant() / 6);
        }
    }
    static Eigen::Matrix3d edges_of(const std::vector<Vec3d>& at, const std::array<uint32_t, 4>& t) {
        Eigen::Matrix3d edges;
        for (int k = 0; k < 3; ++k) edges.col(k) = at[t[k + 1]] - at[t[0]];
        return edges;
    }
    double energy(const std::vector<Vec3d>& at) const {
        double sum = 0;
        for (size_t t = 0; t < volume.size(); ++t) sum += volume[t] * law.energy(edges_of(at, tetrahedron[t]) * inverse[t]);
        return sum;
    }
    std::vector<Vec3d> forces(const std::vector<Vec3d>& at) const {
        std::vector<Vec3d> force(at.size(), Vec3d::Zero());
        for (size_t t = 0; t < volume.size(); ++t) {
            const Eigen::Matrix3d f = -volume[t] * law.stress(edges_of(at, tetrahedron[t]) * inverse[t]) * inverse[t].transpose();
            for (int k = 0; k < 3; ++k) force[tetrahedron[t][k + 1]] += f.col(k), force[tetrahedron[t][0]] -= f.col(k);
        }
        return force;
    }
};

// The stress is the derivative of the energy, and small strains give Lame's constants: the oracle itself.
TEST(NeoHookeanLaw, OracleIsConsistent) {
    for (const double nu : {0.25, 0.45, 0.49}) {
        const NeoHookeanLaw law(1e4, nu);
        Eigen::Matrix3d f;
        f << 1.2, 0.1, -0.2, 0.05, 0.8, 0.1, -0.1, 0.2, 1.1;
        for (int i = 0; i < 9; ++i) {
            Eigen::Matrix3d up = f, down = f;
            up(i) += 1e-5, down(i) -= 1e-5;
            EXPECT_NEAR(law.stress(f)(i), (law.energy(up) - law.energy(down)) / 2e-5, 1e-5 * 1e4);
        }
        constexpr double kSmall = 1e-5;
        const double across = law.across(1 + kSmall);
        EXPECT_NEAR(law.stress(Eigen::Vector3d(1 + kSmall, across, across).asDiagonal())(0, 0) / kSmall, 1e4, 2);
        EXPECT_NEAR((1 - across) / kSmall, nu, 1e-4);
    }
}

TEST(NeoHookean, StressOfEveryStretchAndShear) {
    for (const double nu : {0.25, 0.45, 0.49}) {
        for (const double jitter : {0.0, 0.15}) {
            LawBlock block(TissueLaw::kNeoHookean, {}, 1e4, nu, 3, jitter);
            const NeoHookeanLaw law(1e4, nu);
            double worst = 0;
            for (const double along : {0.6, 0.8, 0.9, 0.99, 1.01, 1.1, 1.2, 1.4}) {
                const double across = law.across(along);
                const Eigen::Matrix3d f = Eigen::Vector3d(along, across, across).asDiagonal();
                const double exact = law.stress(f)(0, 0);
                const Eigen::Matrix3d measured = block.stress(f);
                worst = std::max(worst, (measured - law.stress(f)).cwiseAbs().maxCoeff() / std::abs(exact));
                // the same where the sides find their own places
                const LawBlock::Uniaxial own = block.pull(along);
                EXPECT_NEAR(own.stress, exact, 2e-3 * std::abs(exact)) << "nu " << nu << ", stretch " << along;
                EXPECT_NEAR(own.across, across, 1e-4) << "nu " << nu << ", stretch " << along;
            }
            for (const double by : {0.01, 0.1, 0.2, 0.4}) {
                const Eigen::Matrix3d f = block.sheared(by), exact = law.stress(f);
                worst = std::max(worst, (block.stress(f) - exact).cwiseAbs().maxCoeff() / exact(0, 1));
            }
            std::printf("neo-Hookean, nu %.2f, jitter %.2f: stress within %.4f %%\n", nu, jitter, 100 * worst);
            EXPECT_LT(worst, 2e-3);
        }
    }
}

// Forces and energy in any shape, inside out too; rotations and both instruction sets.
TEST(NeoHookean, ForcesAreThoseOfTheEnergyInDouble) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (const double nu : {0.3, 0.45}) {
        LawBlock block(TissueLaw::kNeoHookean, {}, 1e4, nu, 3, 0.1);
        const DoubleLaw exact(block, 1e4, nu);
        const Eigen::Matrix3d turn = Eigen::AngleAxisd(2, Vec3d(1, 2, 3).normalized()).toRotationMatrix();
        for (const double shake : {0.0, 1e-3, 3e-3, 10e-3}) {
            for (uint32_t v = 0; v < block.rest.size(); ++v)
                block.place(v, turn * block.rest[v] + shake * Vec3d(unit(random), unit(random), unit(random)));
            std::vector<Vec3d> at;
            for (uint32_t v = 0; v < block.rest.size(); ++v) at.push_back(block.scene.offset(0, v));
            const std::vector<Vec3d> force = block.forces(), right = exact.forces(at);
            const double scale = 1e4 * 1e-4;  // modulus times the area of a face
            double worst = 0;
            for (size_t v = 0; v < at.size(); ++v) worst = std::max(worst, (force[v] - right[v]).norm());
            EXPECT_LT(worst, 2e-5 * scale * std::max(1.0, std::pow(shake / 3e-3, 3))) << shake;
            block.scene.particles.last_dt[0] = 0;
            for (auto* v : {&block.scene.particles.velocity_x, &block.scene.particles.velocity_y, &block.scene.particles.velocity_z})
                std::fill(v->begin(), v->end(), 0.0f);
            block.scene.measure();
            EXPECT_NEAR(block.scene.energy.elastic, exact.energy(at), 1e-5 * exact.energy(at) + 1e-7 * 1e4 * block.volume) << shake;
        }
    }
}

// The limit of the step holds in shapes far beyond what tissue takes, and is not far below what the shape at rest allows.
TEST(NeoHookean, StepsAreStableInEveryShape) {
    std::mt19937 random(2);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (const double nu : {0.25, 0.45, 0.49}) {
        LawBlock block(TissueLaw::kNeoHookean, {}, 1e4, nu, 2, 0.05);
        const DoubleLaw exact(block, 1e4, nu);
        const auto limit_at = [&](std::vector<Vec3d> at) {
            const Eigen::Index n = 3 * static_cast<Eigen::Index>(at.size());
            Eigen::MatrixXd hessian(n, n);
            for (Eigen::Index i = 0; i < n; ++i) {
                constexpr double kSmall = 1e-7;
                double& moved = at[static_cast<size_t>(i) / 3][i % 3];
                const double place = moved;
                moved = place + kSmall;
                const std::vector<Vec3d> up = exact.forces(at);
                moved = place - kSmall;
                const std::vector<Vec3d> down = exact.forces(at);
                moved = place;
                for (Eigen::Index j = 0; j < n; ++j) {
                    const float wi = block.scene.particles.offset[static_cast<size_t>(i) / 3].w;
                    const float wj = block.scene.particles.offset[static_cast<size_t>(j) / 3].w;
                    hessian(j, i) = (down[static_cast<size_t>(j) / 3][j % 3] - up[static_cast<size_t>(j) / 3][j % 3]) / (2 * kSmall) *
                                    std::sqrt(double{wi} * double{wj});
                }
            }
            return 2 / std::sqrt(reference::largest_eigenvalue(0.5 * (hessian + hessian.transpose())));
        };
        const double step = block.scene.bodies.stable_dt[0], at_rest = limit_at(block.rest);
        std::printf("nu %.2f: step %.3f of the limit at rest", nu, step / at_rest);
        EXPECT_LT(step, at_rest);
        EXPECT_GT(step, 0.6 * at_rest);
        for (const Vec3d& stretch : {Vec3d(2, 0.75, 0.75), Vec3d(1.4, 0.85, 0.85), Vec3d(1.3, 1.3, 0.6), Vec3d(0.5, 1.2, 1.2),
                                     Vec3d(0.5, 1, 1), Vec3d(0.1, 1, 1), Vec3d(-0.5, 1, 1), Vec3d(1.05, 1.05, 1.05)}) {
            std::vector<Vec3d> at;
            for (const Vec3d& p : block.rest)
                at.push_back(stretch.cwiseProduct(p) + 0.5e-3 * Vec3d(unit(random), unit(random), unit(random)) + Vec3d(0.3 * p.y(), 0, 0));
            const double limit = limit_at(at);
            std::printf(", %.3f", step / limit);
            EXPECT_LT(step, limit) << stretch.transpose();
        }
        std::printf(" in other shapes\n");
    }
}

// Springs are stiffer in tension, by what the bench shows; at small strain both laws are one material.
TEST(NeoHookean, AgreesWithSpringsAtSmallStrain) {
    for (const double nu : {0.3, 0.45}) {
        LawBlock springs(TissueLaw::kSprings, {}, 1e4, nu, 6), law(TissueLaw::kNeoHookean, {}, 1e4, nu, 6);
        const double a = springs.pull(1.01).stress, b = law.pull(1.01).stress;
        EXPECT_NEAR(a / b, 1, 0.02) << nu;
    }
}

TEST(Relaxation, ShearRelaxesAsTheSeries) {
    constexpr double kShear = 0.01;
    const double mu = 1e4 / (2 * 1.45);
    for (const TissueLaw law : {TissueLaw::kSprings, TissueLaw::kNeoHookean}) {
        LawBlock block(law, kTwoTimes, 1e4, 0.45);
        (void)block.stress(block.sheared(0));
        double worst = 0;
        for (int i = 0; i < 1500; ++i) {
            const double stress = block.stress(block.sheared(kShear))(0, 1);
            double exact = 1;
            for (int b = 0; b < 2; ++b) {  // sheared evenly during the first step
                const double s = LawBlock::kStep / kTwoTimes.time[b];
                exact += kTwoTimes.share[b] * (1 - std::exp(-s)) / s * std::exp(-i * s);
            }
            worst = std::max(worst, std::abs(stress / (mu * kShear * exact) - 1));
        }
        std::printf("relaxation, law %d: within %.4f %% of the closed form\n", static_cast<int>(law), 100 * worst);
        EXPECT_LT(worst, 0.002);
    }
}

// What is yet to relax: at once by what the springs are strained, and falling as the series does.
TEST(Relaxation, WhatIsYetToRelaxFollowsTheSeries) {
    const Prony one{{0.8}, {0.2}};
    LawBlock block(TissueLaw::kSprings, one, 1e4, 0.45);
    const AdvanceScene& s = block.scene;
    const auto left = [&] { return strain_to_relax(s.relaxation, s.relaxation.body[0], s.springs, s.bodies.mesh[0]); };
    Eigen::Matrix3d f = Eigen::Vector3d(1.01, 1.02, 0.97).asDiagonal();
    (void)block.stress(Eigen::Matrix3d::Identity());
    EXPECT_LT(left(), 1e-6);
    (void)block.stress(f);
    double sum = 0, ends = 0;  // both ends of every spring
    for (uint32_t v = 0; v < block.rest.size(); ++v) {
        const uint32_t* column = s.springs.slice_column.data() + s.springs.info[0].slices.first;
        for (uint32_t c = column[v / 16]; c < column[v / 16 + 1]; ++c) {
            const uint32_t other = s.springs.neighbour[16 * c + v % 16];
            if (other == v) continue;
            const Vec3d along = block.rest[other] - block.rest[v];
            sum += std::pow((f * along).norm() / along.norm() - 1, 2), ++ends;
        }
    }
    const double step = LawBlock::kStep / one.time[0], gain = one.share[0] * (1 - std::exp(-step)) / step;
    const double start = left();
    EXPECT_NEAR(start, gain * std::sqrt(sum / ends), 1e-4 * start);
    for (int i = 0; i < 400; ++i) (void)block.stress(f);
    EXPECT_NEAR(left(), start * std::exp(-400 * step), 2e-3 * left());
}

TEST(Relaxation, StorageAndLossModuli) {
    for (const TissueLaw law : {TissueLaw::kSprings, TissueLaw::kNeoHookean}) {
        for (const double omega : {2.0, 20.0, 100.0}) {
            const auto [storage, loss] = storage_and_loss(kTwoTimes, omega);
            const auto [measured, lost] = measured_storage_and_loss(law, kTwoTimes, omega);
            std::printf("law %d, %.0f rad/s: storage %.4f (%.4f), loss %.4f (%.4f)\n", static_cast<int>(law), omega, measured, storage,
                        lost, loss);
            EXPECT_NEAR(measured, storage, 0.005 * storage);
            EXPECT_NEAR(lost, loss, 0.005 * loss);
        }
    }
}

// A block rings until its Maxwell elements have taken the energy: what they took is booked. Leapfrog's own error of all that rings
// is of second order in the step, next to the limit some per mille: a quarter of the step leaves less than one.
TEST(Relaxation, EnergyIsAccountedFor) {
    for (const TissueLaw law : {TissueLaw::kSprings, TissueLaw::kNeoHookean}) {
        for (const AnchorFrame frame : {AnchorFrame::kWorld, AnchorFrame::kShape}) {
            double worst[2] = {}, start = 0, lost = 0;
            for (const uint32_t finer : {2u, 4u}) {
                LawBlock block(law, {{0.6, 0.3}, {0.02, 0.3}}, 1e4, 0.45, 3, 0, 0, frame);
                AdvanceScene& s = block.scene;
                s.params.account_energy = true;
                for (uint32_t v = 0; v < block.rest.size(); ++v) {
                    const Vec3d x = block.rest[v] - Vec3d::Constant(0.015);
                    s.set_velocity(0, v, 8 * Vec3d(2 * x.x() + x.y(), -x.y(), -x.z()));
                }
                s.open_energy_account();
                start = s.energy.kinetic;
                for (int i = 0; i < 60; ++i) {
                    s.advance(10, finer * substeps_for(10e-3, s.bodies.stable_dt[0], 1));
                    s.measure();
                    worst[finer / 4] = std::max(worst[finer / 4], std::abs(s.energy.balance));
                }
                lost = -s.energy.work_damping;
            }
            std::printf("law %d: %.3f mJ, of which %.3f lost to relaxation, balance %.4f, %.4f %% at half and a quarter of the step\n",
                        static_cast<int>(law), 1e3 * start, 1e3 * lost, 100 * worst[0] / start, 100 * worst[1] / start);
            EXPECT_LT(worst[1], 1e-3 * start);
            EXPECT_LT(worst[1], 0.3 * worst[0]) << "second order";
            EXPECT_GT(lost, 0.9 * start);
        }
    }
}

// A copy of the state goes on with the same bits; without what it has been through it goes on otherwise.
TEST(Relaxation, StateIsComplete) {
    LawBlock block(TissueLaw::kNeoHookean, kTwoTimes, 1e4, 0.45);
    for (uint32_t v = 0; v < block.rest.size(); ++v) block.scene.set_velocity(0, v, Vec3d(0, 10 * block.rest[v].x(), 0));
    AdvanceScene& s = block.scene;
    s.advance(5, 20);
    const Particles particles = s.particles;
    const Relaxation relaxation = s.relaxation;
    const uint64_t tick = s.params.tick;
    const auto go_on = [&] {
        s.params.tick = tick;
        s.advance(4, 16);
        return resource_hash(s, Resource::kParticles) ^ resource_hash(s, Resource::kRelaxation);
    };
    const uint64_t once = go_on();
    s.particles = particles, s.relaxation = relaxation;
    EXPECT_EQ(go_on(), once);
    s.particles = particles, s.relaxation = relaxation;
    std::fill(s.relaxation.overstretch.begin(), s.relaxation.overstretch.end(), 0.0f);
    EXPECT_NE(go_on(), once);
}

}  // namespace
}  // namespace trocar
