#include "engine/tissue/tet_forces.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <random>

#include "tests/reference/solid_double.hpp"
namespace trocar {
namespace {

// Tetrahedra between random nodes, most of them inverted or crushed, with padding; slots as add_solid makes them.
struct RandomTets {
    static constexpr unsigned kNodes = 64, kTets = 90, kPadded = 96;
    std::vector<Float4> offset;
    std::vector<unsigned> corner[4], column, slot;
    std::vector<float> rest, per_rest, force[3];
    std::vector<Float4> corner_force;
    TetStep step{};

    explicit RandomTets(unsigned seed) {
        std::mt19937 random(seed);
        std::uniform_real_distribution<float> unit(-1, 1);
        for (unsigned i = 0; i < kNodes; ++i) offset.push_back({unit(random), unit(random), unit(random), 1});
        std::vector<std::vector<unsigned>> slots(kNodes);
        for (unsigned t = 0; t < kPadded; ++t) {
            for (unsigned k = 0; k < 4; ++k) {
                corner[k].push_back(t < kTets ? random() % kNodes : 0);
                if (t < kTets) slots[corner[k][t]].push_back(k * kPadded + t);
            }
            rest.push_back(t < kTets ? 0.3f + 0.2f * unit(random) : 0.0f);
            per_rest.push_back(t < kTets ? 1 / rest[t] : 0.0f);
        }
        column.push_back(0);
        for (unsigned slice = 0; slice < kNodes / 16; ++slice) {
            size_t columns = 0;
            for (unsigned lane = 0; lane < 16; ++lane) columns = std::max(columns, slots[16 * slice + lane].size());
            for (unsigned c = 0; c < columns; ++c) {
                for (unsigned lane = 0; lane < 16; ++lane) {
                    const auto& list = slots[16 * slice + lane];
                    slot.push_back(c < list.size() ? list[c] : 4 * kPadded);
                }
            }
            column.push_back(column.back() + static_cast<unsigned>(columns));
        }
        corner_force.resize(4 * kPadded + 1);
        for (auto& f : force) f.assign(kNodes, 0.0f);
    }
    const TetStep& bind() {
        step.offset = &offset[0].x;
        step.corner0 = corner[0].data(), step.corner1 = corner[1].data();
        step.corner2 = corner[2].data(), step.corner3 = corner[3].data();
        step.rest = rest.data(), step.per_rest = per_rest.data();
        step.bulk = 300, step.crush = 900, step.squeeze = 500, step.yield = 0.8f, step.tetrahedra = kPadded;
        step.corner_force = &corner_force[0].x;
        step.slot_column = column.data(), step.slot = slot.data();
        step.force_x = force[0].data(), step.force_y = force[1].data(), step.force_z = force[2].data();
        return step;
    }
    Vec3d position_of(unsigned node) const { return Vec3d(offset[node].x, offset[node].y, offset[node].z); }
    double energy(const std::vector<Vec3d>& p) const {
        double sum = 0;
        for (unsigned t = 0; t < kTets; ++t) {
            sum += tet_energy({0, 300, 900, 500, double{0.8f}}, rest[t],
                              six_volumes(p[corner[0][t]], p[corner[1][t]], p[corner[2][t]], p[corner[3][t]]));
        }
        return sum;
    }
};

TEST(TetForces, Avx2AndAvx512GiveTheSameBits) {
    if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512dq")) GTEST_SKIP() << "no AVX-512 here";
    for (unsigned seed = 1; seed <= 20; ++seed) {
        RandomTets a(seed), b(seed);
        std::vector<float> least_a(16, 1.0f), least_b(16, 1.0f);
        kTetKernelsAvx2.press(&a.bind(), 0, RandomTets::kPadded / 16, least_a.data());
        kTetKernelsAvx2.gather(&a.step, 0, RandomTets::kNodes / 16);
        kTetKernelsAvx512.press(&b.bind(), 0, RandomTets::kPadded / 16, least_b.data());
        kTetKernelsAvx512.gather(&b.step, 0, RandomTets::kNodes / 16);
        EXPECT_EQ(0, std::memcmp(a.corner_force.data(), b.corner_force.data(), a.corner_force.size() * sizeof(Float4)));
        for (int i = 0; i < 3; ++i) EXPECT_EQ(a.force[i], b.force[i]);
        EXPECT_EQ(least_a, least_b);
        std::vector<float> measured_a(16, 1.0f), measured_b(16, 1.0f);
        kTetKernelsAvx2.measure(&a.step, 0, RandomTets::kPadded / 16, measured_a.data());
        kTetKernelsAvx512.measure(&b.step, 0, RandomTets::kPadded / 16, measured_b.data());
        EXPECT_EQ(measured_a, measured_b);
    }
}

// Central differences of the energy in double, node by node, for any shape including crushed and inverted
// ones.
TEST(TetForces, AreTheGradientOfTheEnergy) {
    for (unsigned seed = 1; seed <= 5; ++seed) {
        RandomTets tets(seed);
        const float least = add_tet_forces(tets.bind(), RandomTets::kNodes / 16);
        EXPECT_LT(least, 0.0f) << "no tetrahedron was inverted: nothing was tested";
        std::vector<Vec3d> p;
        for (unsigned i = 0; i < RandomTets::kNodes; ++i) p.push_back(tets.position_of(i));
        double scale = 0;
        for (unsigned i = 0; i < RandomTets::kNodes; ++i) scale = std::max(scale, std::abs(double{tets.force[0][i]}));
        for (unsigned i = 0; i < RandomTets::kNodes; ++i) {
            for (int axis = 0; axis < 3; ++axis) {
                const double step = 1e-6;
                p[i][axis] += step;
                const double up = tets.energy(p);
                p[i][axis] -= 2 * step;
                const double down = tets.energy(p);
                p[i][axis] += step;
                EXPECT_NEAR(tets.force[axis][i], -(up - down) / (2 * step), 2e-6 * scale) << i;
            }
        }
    }
}

// For stiffened and removed tetrahedra, half a step earlier: one by one in double.
TEST(TetForces, TheEnergyIsTheSumOverThoseThatAreLeft) {
    for (unsigned seed = 1; seed <= 5; ++seed) {
        RandomTets tets(seed);
        std::vector<float> factor, velocity[3];
        for (unsigned t = 0; t < RandomTets::kPadded; ++t) factor.push_back(0.5f + 0.125f * static_cast<float>(t % 9));
        for (unsigned axis = 0; axis < 3; ++axis)
            for (unsigned i = 0; i < RandomTets::kNodes; ++i) velocity[axis].push_back(std::sin(static_cast<float>(3 * i + axis + seed)));
        for (const unsigned lost : {3u, 17u, 40u}) tets.rest[lost] = tets.per_rest[lost] = 0;
        const double back = 0.01;
        const auto position_of = [&](unsigned node) {
            return Vec3d(tets.position_of(node) - back * Vec3d(velocity[0][node], velocity[1][node], velocity[2][node]));
        };
        double wanted = 0, least = 1;
        for (unsigned t = 0; t < RandomTets::kTets; ++t) {
            if (tets.rest[t] == 0) continue;
            const Vec3d p = position_of(tets.corner[0][t]);
            const double six =
                (position_of(tets.corner[1][t]) - p).dot((position_of(tets.corner[2][t]) - p).cross(position_of(tets.corner[3][t]) - p));
            wanted += double{factor[t]} * tet_energy({0, 300, 900, 500, double{0.8f}}, tets.rest[t], six);
            least = std::min(least, six_volumes(tets.position_of(tets.corner[0][t]), tets.position_of(tets.corner[1][t]),
                                                tets.position_of(tets.corner[2][t]), tets.position_of(tets.corner[3][t])) /
                                        tets.rest[t]);
        }
        tets.bind();
        tets.step.factor = factor.data();
        TetEnergyScratch scratch;
        const double found = tet_energy(tets.step, RandomTets::kNodes, {0, 300, 900, 500, double{0.8f}},
                                        {velocity[0].data(), velocity[1].data(), velocity[2].data()}, back, scratch);
        EXPECT_NEAR(found, wanted, 1e-12 * wanted) << seed;
        EXPECT_NEAR(least_volume_ratio(tets.step), least, 3e-6 * std::abs(least)) << seed;
    }
}

// Each volume in double; the measuring kernel and the force kernel give the same.
TEST(TetForces, LeastVolumeRatioIsThatOfTheWorstTetrahedron) {
    for (unsigned seed = 1; seed <= 20; ++seed) {
        RandomTets tets(seed);
        double least = 1;
        for (unsigned t = 0; t < RandomTets::kTets; ++t) {
            const Vec3d p = tets.position_of(tets.corner[0][t]), a = tets.position_of(tets.corner[1][t]) - p,
                        b = tets.position_of(tets.corner[2][t]) - p, c = tets.position_of(tets.corner[3][t]) - p;
            least = std::min(least, a.dot(b.cross(c)) / tets.rest[t]);
        }
        ASSERT_LT(least, 0);
        const float works_by_energy = least_volume_ratio(tets.bind());
        EXPECT_NEAR(works_by_energy, least, 3e-6 * std::abs(least)) << seed;
        EXPECT_EQ(works_by_energy, add_tet_forces(tets.bind(), RandomTets::kNodes / 16)) << seed;
    }
}

TEST(TetForces, AddUpToNothing) {
    RandomTets tets(3);
    add_tet_forces(tets.bind(), RandomTets::kNodes / 16);
    Vec3d force = Vec3d::Zero(), turning = Vec3d::Zero();
    double size = 0;
    for (unsigned i = 0; i < RandomTets::kNodes; ++i) {
        const Vec3d f(tets.force[0][i], tets.force[1][i], tets.force[2][i]);
        force += f, turning += tets.position_of(i).cross(f), size += f.norm();
    }
    EXPECT_LT(force.norm(), 1e-6 * size);
    EXPECT_LT(turning.norm(), 1e-6 * size);
}

// M04. A corner is pushed through the opposite face and beyond: the force on it points back to its own side
// throughout, never weaker than where the tetrahedron is at half its volume.
TEST(HardCases, M04_InvertedTetrahedronIsDrivenBack) {
    RandomTets tets(1);
    const std::vector<Vec3d> face{{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}};
    for (unsigned k = 0; k < 4; ++k) tets.corner[k].assign(RandomTets::kPadded, 0);
    std::fill(tets.rest.begin(), tets.rest.end(), 0.0f), std::fill(tets.per_rest.begin(), tets.per_rest.end(), 0.0f);
    tets.rest[0] = 1e-3f, tets.per_rest[0] = 1e3f;
    for (unsigned k = 0; k < 4; ++k) tets.corner[k][0] = k;
    for (unsigned k = 0; k < 3; ++k) tets.offset[k] = {float(face[k].x()), float(face[k].y()), float(face[k].z()), 1};
    float weakest = 0;
    for (const float height : {0.05f, 0.01f, 1e-6f, 0.0f, -1e-6f, -0.02f, -0.1f, -10.0f}) {
        tets.offset[3] = {0.03f, 0.02f, height, 1};
        float least[16];
        std::fill(least, least + 16, 1.0f);
        tet_kernels().press(&tets.bind(), 0, 1, least);
        const Float4 force = tets.corner_force[3 * RandomTets::kPadded];
        EXPECT_TRUE(std::isfinite(force.z)) << height;
        EXPECT_GE(force.z, weakest) << height;
        EXPECT_GT(force.z, 0.0f) << height;
        EXPECT_NEAR(least[0], height / 0.1f, 1e-5f * std::abs(height / 0.1f) + 1e-7f);
        weakest = force.z;
    }
    // all four in one point: there is no direction, and everything is finite
    for (unsigned k = 0; k < 4; ++k) tets.offset[k] = {0.1f, 0.2f, 0.3f, 1};
    float least[16] = {};
    tet_kernels().press(&tets.bind(), 0, 1, least);
    for (unsigned k = 0; k < 4; ++k) EXPECT_EQ(tets.corner_force[k * RandomTets::kPadded].x, 0.0f);
}

// The header's claims, from the energy of an affine strain of the lattice's inner part, in double: the spring
// constants in all directions, and lambda.
TEST(SolidModuli, LatticeIsIsotropic) {
    for (const double nu : {0.25, 0.35, 0.45, 0.49}) {
        std::vector<Vec3d> position;
        std::vector<std::array<uint32_t, 4>> all, kept;
        reference::lattice_box(4, 4, 4, 0.01, 0, position, all);
        // the tetrahedra of two central cells: whole periods of the lattice
        for (const auto& t : all) {
            Vec3d middle = Vec3d::Zero();
            for (const uint32_t node : t) middle += 0.25 * position[node];
            if ((middle - Vec3d::Constant(0.02)).cwiseAbs().maxCoeff() < 0.01 - 1e-9) kept.push_back(t);
        }
        reference::DoubleSolid s = reference::make_double_solid(position, kept);
        s.poisson = nu;
        const double mu = s.youngs_modulus / (2 * (1 + nu)), lambda = 2 * mu * nu / (1 - 2 * nu);
        double volume = 0;
        for (const auto& t : kept) volume += six_volumes(position[t[0]], position[t[1]], position[t[2]], position[t[3]]) / 6;
        std::mt19937 random(5);
        std::uniform_real_distribution<double> unit(-1, 1);
        for (int trial = 0; trial < 6; ++trial) {
            Eigen::Matrix3d strain;
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j <= i; ++j) strain(i, j) = strain(j, i) = 1e-5 * unit(random);
            for (size_t i = 0; i < position.size(); ++i) s.position[i] = position[i] + strain * position[i];
            const double expected = volume * (mu * strain.squaredNorm() + 0.5 * lambda * strain.trace() * strain.trace());
            EXPECT_NEAR(reference::spring_energy(s), expected, 2e-4 * expected) << nu;
        }
    }
}

}  // namespace
}  // namespace trocar
