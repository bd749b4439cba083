#include "engine/mesh/mass_properties.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "engine/mesh/mesh_topology.hpp"
#include "engine/motion/free_rotation.hpp"
#include "reference/sample_meshes.hpp"

// Mass, centre and inertia of closed meshes, and free rotation, against closed forms.
namespace {
using namespace trocar;

SolidMoments moments_of(const Mesh& mesh) {
    Meshes meshes;
    return solid_moments(mesh_view(meshes, add_prototype(meshes, mesh, Admission::kSolid)));
}

Mesh turned(Mesh mesh, const Quat& q, const Vec3d& shift) {
    for (Vec3d& p : mesh.position) p = rotate(q, p) + shift;
    return mesh;
}

// Torus around z with n x n corners.
Mesh make_torus(double big, double small, uint32_t n) {
    Mesh m;
    const double step = 2 * std::numbers::pi / n;
    for (uint32_t i = 0; i < n; ++i) {
        for (uint32_t j = 0; j < n; ++j) {
            const double r = big + small * std::cos(j * step);
            m.position.push_back({r * std::cos(i * step), r * std::sin(i * step), small * std::sin(j * step)});
        }
    }
    for (uint32_t i = 0; i < n; ++i) {
        for (uint32_t j = 0; j < n; ++j) {
            const uint32_t a = i * n + j, b = (i + 1) % n * n + j, c = (i + 1) % n * n + (j + 1) % n, d = i * n + (j + 1) % n;
            m.triangle.insert(m.triangle.end(), {{a, b, c}, {a, c, d}});
        }
    }
    return m;
}

// A box of any size at any position, also far from the origin of its frame. Breaks when a term of the tensor
// or of the shift to the centre of mass has a wrong sign or factor.
TEST(MassProperties, BoxIsExactWhereverItLies) {
    const Vec3d size(0.3, 0.02, 0.11);
    for (const double far : {0.0, 1.0, 1000.0}) {
        const Vec3d low(far, -0.4 * far, 0.07);
        const SolidMoments m = moments_of(reference::make_box(low, low + size));
        const double volume = size.prod();
        EXPECT_NEAR(m.volume, volume, 1e-13 * (1 + far) * volume / 0.02);
        EXPECT_LT((m.centre - low - 0.5 * size).norm(), 1e-14 + 1e-15 * far);
        for (int i = 0; i < 3; ++i) {
            const double a = size[(i + 1) % 3], b = size[(i + 2) % 3], exact = volume * (a * a + b * b) / 12;
            EXPECT_NEAR(m.inertia[i], exact, 1e-10 * (1 + far) * exact);
            EXPECT_NEAR(m.inertia[3 + i], 0, 1e-10 * (1 + far) * exact);
        }
    }
}

// The tensor of a rotated box is R I R^T: products of inertia have the right sign.
TEST(MassProperties, TurnedBoxHasATurnedTensor) {
    const Vec3d size(1, 2, 3);
    const Quat q = from_rotation_vector({0.3, -0.8, 0.5});
    const SolidMoments m = moments_of(turned(reference::make_box(-0.5 * size, 0.5 * size), q, {4, 5, 6}));
    const Vec3d principal = 6.0 / 12 * Vec3d(4 + 9, 1 + 9, 1 + 4);
    const auto entry = [&](int i, int j) {
        double sum = 0;
        for (int k = 0; k < 3; ++k) sum += principal[k] * rotate(q, Vec3d::Unit(k))[i] * rotate(q, Vec3d::Unit(k))[j];
        return sum;
    };
    const double expected[6] = {entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)};
    for (int i = 0; i < 6; ++i) EXPECT_NEAR(m.inertia[i], expected[i], 1e-12);
}

// Ball and torus: errors against the smooth shape fall fourfold when edges are halved.
TEST(MassProperties, BallAndTorusConvergeInSecondOrder) {
    const double r = 0.02, ring = 0.05;
    double before[2] = {0, 0};
    for (int level = 3; level <= 5; ++level) {
        const SolidMoments ball = moments_of(reference::make_sphere({0.1, 0.2, 0.3}, r, level));
        const SolidMoments torus = moments_of(make_torus(ring, r, 8u << level));
        const double ball_volume = 4.0 / 3 * std::numbers::pi * r * r * r;
        const double torus_volume = 2 * std::numbers::pi * std::numbers::pi * ring * r * r;
        const double about = torus_volume * (ring * ring + 0.75 * r * r);
        const double across = torus_volume * (0.5 * ring * ring + 0.625 * r * r);
        const double error[2] = {std::abs(ball.inertia[1] / (0.4 * ball_volume * r * r) - 1),
                                 std::max(std::abs(torus.inertia[2] / about - 1), std::abs(torus.inertia[0] / across - 1))};
        for (int i = 0; i < 2; ++i) {
            if (level > 3) {
                EXPECT_NEAR(before[i] / error[i], 4, 0.3) << i;
            }
            before[i] = error[i];
        }
    }
    EXPECT_LT(std::max(before[0], before[1]), 5e-3);
}

TEST(MassProperties, OpenInwardAndFlatSurfacesHaveNoMass) {
    Meshes meshes;
    Bodies bodies;
    Particles particles;
    Mesh inward = reference::make_box({0, 0, 0}, {1, 1, 1});
    for (Triangle& t : inward.triangle) std::swap(t[1], t[2]);
    Mesh flat = reference::make_box({0, 0, 0}, {1, 1, 0});
    const uint32_t rows[] = {add_prototype(meshes, reference::make_sheet(2), Admission::kSheet),
                             add_prototype(meshes, inward, Admission::kSolid), add_prototype(meshes, flat, Admission::kWinding),
                             add_prototype(meshes, reference::make_box({0, 0, 0}, {0.1, 0.2, 0.3}), Admission::kSolid)};
    for (const uint32_t row : rows) {
        bodies.mesh.push_back(row), bodies.tissue.push_back({}), bodies.inv_mass.push_back(0);
    }
    for (uint32_t body = 0; body < 3; ++body) EXPECT_FALSE(set_rigid_mass(meshes, body, 0, bodies, particles)) << body;
    ASSERT_TRUE(set_rigid_mass(meshes, 3, 0, bodies, particles));
    EXPECT_NEAR(find_rigid_mass(bodies, 3)->mass, 1050 * 0.006, 1e-12);
    ASSERT_TRUE(set_rigid_mass(meshes, 3, 2, bodies, particles));
    ASSERT_EQ(bodies.rigid_mass.size(), 1u);
    EXPECT_DOUBLE_EQ(bodies.inv_mass[3], 0.5);
    EXPECT_EQ(find_rigid_mass(bodies, 2), nullptr);
}

// The principal frame and moments reproduce the tensor.
TEST(MassProperties, PrincipalFrameGivesTheTensorBack) {
    Meshes meshes;
    Bodies bodies;
    Particles particles;
    for (int seed = 0; seed < 50; ++seed) {
        const Quat q = from_rotation_vector(Vec3d(std::sin(seed), std::cos(3.0 * seed), std::sin(7.0 * seed)) * 3);
        const Mesh mesh = turned(reference::make_box({0, 0, 0}, {1.0, 1.0 + seed % 3, 1.0 + seed % 5}), q, {1, 2, 3});
        bodies = {};
        bodies.mesh = {add_prototype(meshes, mesh, Admission::kSolid)};
        bodies.tissue = {{}}, bodies.inv_mass = {0};
        ASSERT_TRUE(set_rigid_mass(meshes, 0, 3, bodies, particles));
        const RigidMass& row = bodies.rigid_mass[0];
        const SolidMoments m = solid_moments(mesh_view(meshes, bodies.mesh[0]));
        const int index[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
        for (int i = 0; i < 3; ++i) {
            const Vec3d column = momentum_of(row.moments, row.axes, Vec3d::Unit(i));
            for (int j = 0; j < 3; ++j) EXPECT_NEAR(column[j], m.inertia[index[i][j]] * 3 / m.volume, 1e-11);
        }
    }
}

struct Tumble {
    double momentum_error = 0, first_energy_error = 0, last_energy_error = 0, period = 0;
};

// Rotates a free body and measures it: relative errors, and the period of the spin about the middle axis.
Tumble tumble(const Vec3d& moments, const Vec3d& start, double dt, int steps) {
    Quat q = from_rotation_vector({0.4, 1.1, -0.3});
    const Vec3d momentum = momentum_of(moments, q, rotate(q, start));
    Vec3d kept = momentum;
    const double energy = 0.5 * start.dot(start.cwiseProduct(moments));
    Tumble result;
    double before = start[1], first = -1, last = -1;
    int crossings = 0;
    for (int step = 1; step <= steps; ++step) {
        q = turn_freely(moments, kept, dt, q);
        const Vec3d spin = spin_of(moments, q, kept);
        kept = momentum_of(moments, q, spin);  // as bodies do: their state is the spin
        const double error = std::abs(0.5 * spin.dot(kept) / energy - 1), middle = rotate_back(q, spin)[1];
        double& worst = step <= steps / 2 ? result.first_energy_error : result.last_energy_error;
        worst = std::max(worst, error);
        if (before < 0 && middle >= 0) {
            last = dt * (step - middle / (middle - before));
            if (first < 0) first = last;
            ++crossings;
        }
        before = middle;
    }
    result.momentum_error = (kept - momentum).norm() / momentum.norm();
    result.period = (last - first) / std::max(1, crossings - 1);
    return result;
}

// Torque-free rotation near the middle axis: angular momentum within four ulp per step over a million steps,
// energy within (spin dt)^2 / 8 and no worse in the second half than in the first.
TEST(FreeRotation, KeepsMomentumAndEnergyOverAMillionSteps) {
    const double dt = 1e-3, rate = 20;
    const Tumble t = tumble({1e-4, 2e-4, 2.7e-4}, {0.02, rate, 0.01}, dt, 1000000);
    EXPECT_LT(t.momentum_error, 1e6 * 4 * std::numeric_limits<double>::epsilon());
    EXPECT_LT(t.first_energy_error, rate * rate * dt * dt / 8);
    EXPECT_GT(t.first_energy_error, 1e-9) << "the splitting has an error; none seen means nothing was measured";
    EXPECT_LT(t.last_energy_error, 1.01 * t.first_energy_error + 1e-12);
}

// The period of the tumbling about the middle axis is 4 K(k) / rate (Landau & Lifshitz, Mechanics, section
// 37), to second order of dt.
TEST(FreeRotation, MiddleAxisTumblesWithThePeriodOfTheEllipticIntegral) {
    const Vec3d i(1e-4, 2e-4, 2.7e-4), start(0.5, 20, 1.5);
    const double l2 = start.cwiseProduct(i).squaredNorm(), e2 = start.dot(start.cwiseProduct(i));
    ASSERT_GT(l2, e2 * i[1]);
    const double rate = std::sqrt((i[2] - i[1]) * (l2 - e2 * i[0]) / i.prod());
    const double k2 = (i[1] - i[0]) * (e2 * i[2] - l2) / ((i[2] - i[1]) * (l2 - e2 * i[0]));
    const double exact = 4 * std::comp_ellint_1(std::sqrt(k2)) / rate;
    double before = 0;
    for (const double dt : {4e-3, 2e-3, 1e-3}) {
        const double error = std::abs(tumble(i, start, dt, static_cast<int>(20 / dt)).period / exact - 1);
        EXPECT_LT(error, 20 * 20 * dt * dt);
        if (before > 0) {
            EXPECT_NEAR(before / error, 4, 0.4);
        }
        before = error;
    }
}

}  // namespace
