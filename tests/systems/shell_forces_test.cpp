#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cstring>

#include "content/plain_shapes.hpp"
#include "engine/error.hpp"
#include "engine/thread_pool.hpp"
#include "tests/systems/advance_scene.hpp"

// Forces of shells besides springs and anchors: inner pressure.
namespace trocar {
namespace {

double volume_of(const MeshView& mesh, const std::vector<Vec3d>& place) {
    double six = 0;
    for (const Triangle& t : mesh.triangle) six += place[t[0]].dot(place[t[1]].cross(place[t[2]]));
    return six / 6;
}
std::vector<Vec3d> places(const AdvanceScene& s, uint32_t body) {
    std::vector<Vec3d> place;
    for (uint32_t v = 0; v < s.meshes.info[s.bodies.mesh[body]].vertices.count; ++v) place.push_back(s.offset(body, v));
    return place;
}
double volume_now(const AdvanceScene& s, uint32_t body) {
    return volume_of(mesh_view(s.meshes, s.bodies.mesh[body]), places(s, body));
}
// What the engine finds, with the gradient as vectors.
struct Found {
    double volume;
    std::vector<Vec3d> gradient;
};
Found find(const AdvanceScene& s, uint32_t body) {
    const Range rows = s.range(body);
    std::vector<float> g(size_t{3} * rows.count);
    std::vector<double> sums;
    Found found{find_volume_gradient(s.springs, s.bodies.mesh[body], &s.particles.offset[rows.first], sums, g.data(),
                                     g.data() + rows.count, g.data() + 2 * rows.count),
                {}};
    for (uint32_t v = 0; v < rows.count; ++v) found.gradient.push_back({g[v], g[v + rows.count], g[v + 2 * rows.count]});
    return found;
}
Tissue balloon(double modulus) {
    Tissue tissue;
    tissue.youngs_modulus = 1e-3, tissue.wall = 1e-6, tissue.damping = 0;
    tissue.pressure_modulus = modulus;
    return tissue;
}

// A dropped triangle, a swapped corner or a wrong factor breaks it.
TEST(Pressure, GradientIsThatOfTheVolume) {
    AdvanceScene s;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 2, 0.2)), Motion::kDeformable, Vec3d::Zero(), balloon(1e4));
    for (uint32_t v = 0; v < 162; ++v) s.particles.offset[v].x += 0.3f + 0.2f * s.particles.offset[v].y;
    const MeshView mesh = mesh_view(s.meshes, 0);
    std::vector<Vec3d> place = places(s, body);
    const Found found = find(s, body);
    EXPECT_NEAR(found.volume, volume_of(mesh, place), 1e-6 * found.volume);
    for (uint32_t v = 0; v < place.size(); ++v) {
        for (int axis = 0; axis < 3; ++axis) {
            const double h = 1e-4, x = place[v][axis];
            place[v][axis] = x + h;
            const double up = volume_of(mesh, place);
            place[v][axis] = x - h;
            const double down = volume_of(mesh, place);
            place[v][axis] = x;  // the volume is linear in one coordinate: the difference is exact but for rounding
            EXPECT_NEAR(found.gradient[v][axis], (up - down) / (2 * h), 1e-6 * found.gradient[v].norm() + 1e-12);
        }
    }
}

TEST(Pressure, ForcesAndTorquesAddUpToNothing) {
    AdvanceScene s;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 3, 0.2)), Motion::kDeformable, Vec3d::Zero(), balloon(1e4));
    for (uint32_t v = 0; v < 642; ++v) s.particles.offset[v].z *= 1.4f;
    const Found found = find(s, body);
    Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();
    double size = 0;
    for (uint32_t v = 0; v < 642; ++v) {
        force += found.gradient[v];
        torque += s.offset(body, v).cross(found.gradient[v]);
        size += found.gradient[v].norm();
    }
    EXPECT_LT(force.norm(), 1e-7 * size);
    EXPECT_LT(torque.norm(), 1e-7 * size * 0.07);
}

// omega of the breathing mode: rank one, so exactly K / V0 sum |dV/dx|^2 / m.
double breathing_omega(const AdvanceScene& s, uint32_t body) {
    const Found found = find(s, body);
    double sum = 0;
    for (uint32_t v = 0; v < found.gradient.size(); ++v)
        sum += s.particles.offset[s.range(body).first + v].w * found.gradient[v].squaredNorm();
    return std::sqrt(s.bodies.tissue[body].pressure_modulus * sum / found.volume);
}

// A liquid-filled sphere whose mass lies on the surface breathes with omega = 3 / r sqrt(K / rho) (M = rho V and
// omega^2 = K A^2 / (V M)); a level finer errs by a quarter at most.
TEST(Pressure, BreathingModeConvergesToThatOfASphere) {
    const double radius = 0.05, modulus = 20e3, omega = 3 / radius * std::sqrt(modulus / 1050);
    std::vector<double> error;
    for (const int level : {2, 3, 4}) {
        AdvanceScene s;
        const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(radius, level)), Motion::kDeformable, Vec3d::Zero(), balloon(modulus));
        error.push_back(breathing_omega(s, body) / omega - 1);
    }
    // what facets leave out of area and of volume cancels to first order
    EXPECT_LT(std::abs(error[2]), 1e-5);
    EXPECT_GT(error[1] / error[2], 4);
    EXPECT_GT(error[0] / error[1], 4);
}

// Displaced along the mode and let go, the volume follows the cosine of the leapfrog: it turns by 2 asin(omega dt / 2) a
// step. A wrong mass, sign or pressure breaks it.
TEST(Pressure, SphereBreathesAtItsFrequency) {
    AdvanceScene s;
    s.params.gravity.setZero();
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 3)), Motion::kDeformable, Vec3d::Zero(), balloon(20e3));
    const double omega = breathing_omega(s, body), rest = s.meshes.info[0].volume;
    const Found found = find(s, body);
    for (uint32_t v = 0; v < found.gradient.size(); ++v) {
        Float4& o = s.particles.offset[v];
        const Vec3d move = 5e-4 * o.w * found.gradient[v];
        o = {o.x + static_cast<float>(move.x()), o.y + static_cast<float>(move.y()), o.z + static_cast<float>(move.z()), o.w};
    }
    const double start = volume_now(s, body) / rest - 1;
    ASSERT_GT(start, 5e-4);
    ASSERT_LT(start, 5e-3);
    for (int n = 1; n <= 50; ++n) {
        s.advance(1, 2);
        const double phase = 2 * n * 2 * std::asin(0.5 * omega * 0.5e-3);
        // V is a cubic: its own curvature is of second order in the amplitude
        EXPECT_NEAR(volume_now(s, body) / rest - 1, start * std::cos(phase), 10 * start * start) << n;
    }
}

// A sphere whose surroundings press it inwards (anchors with goals at a share s of its radius, k per area): at y times
// its radius pressure and anchors balance, K (1 - y^3) y^2 = k r (y - s). Wrinkles of the edge length h grow where p > k h /
// 2, as no tension holds this wall: a coarse mesh and a stiff bed keep below.
TEST(Pressure, SphereUnderOuterPressureStopsWhereTheFormulaSays) {
    AdvanceScene s;
    s.params.gravity.setZero();
    const double radius = 0.05, modulus = 20e3, goal = 0.95;
    Tissue tissue = balloon(modulus);
    tissue.youngs_modulus = 2e3, tissue.depth = 0.002, tissue.wall = 1e-9, tissue.damping = 60;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(radius, 3)), Motion::kDeformable, Vec3d::Zero(), tissue);
    for (auto* rest : {&s.anchors.rest_x, &s.anchors.rest_y, &s.anchors.rest_z})
        for (float& x : *rest) x *= static_cast<float>(goal);
    for (int n = 0; n < 500; ++n) s.advance(1, 2);
    const double per_area = tissue.youngs_modulus / tissue.depth;
    double low = goal, high = 1;
    for (int i = 0; i < 60; ++i) {
        const double y = 0.5 * (low + high);
        (modulus * (1 - y * y * y) * y * y > per_area * radius * (y - goal) ? low : high) = y;
    }
    double mean = 0;
    for (const Vec3d& x : places(s, body)) mean += x.norm() / radius / 642;
    // a vertex of six facets has dV/dx = its share of area but for (h / r)^2 / 8 = 3e-3; y - s by that share of itself
    EXPECT_NEAR(mean, low, 5e-3 * (low - goal));
    EXPECT_GT(low, goal + 0.02);
}

// A soft ball squeezed to 70 % between a table and a plate that comes down: with pressure it keeps its volume, without
// it loses it. The books close.
struct Squeezed {
    double volume = 0, worst_balance = 0, peak = 0, drift = 0;
};
Squeezed squeeze(double modulus) {
    AdvanceScene s;
    s.params.gravity.setZero();
    s.params.contact.push_speed = 0.05;
    Tissue tissue;
    tissue.youngs_modulus = 2e3, tissue.wall = 2e-3, tissue.depth = 0.05, tissue.damping = 10;
    tissue.pressure_modulus = modulus;
    const uint32_t ball = s.add_body(s.add_mesh(subdivided_sphere(0.05, 3)), Motion::kDeformable, Vec3d(0, 0, 0.05), tissue, AnchorFrame::kShape);
    Mesh box = make_box(300);
    Box extent;
    for (const Vec3d& p : box.position) extent.min = extent.min.cwiseMin(p), extent.max = extent.max.cwiseMax(p);
    for (Vec3d& p : box.position)
        p = (p - 0.5 * (extent.min + extent.max)).cwiseQuotient(extent.max - extent.min).cwiseProduct(Vec3d(0.4, 0.4, 0.1));
    const uint32_t plate_mesh = s.add_mesh(box);
    const uint32_t table = s.add_body(plate_mesh, Motion::kStatic, Vec3d(0, 0, -0.05));
    const uint32_t plate = s.add_body(plate_mesh, Motion::kKinematic, Vec3d(0, 0, 0.15));
    s.add_path(plate, {{0.0, Vec3d(0, 0, 0.15), {}, 0}, {0.3, Vec3d(0, 0, 0.12), {}, 0}, {1.0, Vec3d(0, 0, 0.12), {}, 0}});
    s.open_books();
    const uint32_t substeps = count_substeps(s.bodies, std::vector<uint32_t>{ball}, 1e-3, 1e-3);
    Squeezed result;
    for (int n = 0; n < 500; ++n) {
        s.clear_rows();
        s.poses.origin[plate] = Vec3d(0, 0, n < 300 ? 0.15 - 1e-4 * n : 0.12);
        s.add_rows(ball, table, 0.2);
        s.add_rows(ball, plate, 0.2);
        s.advance(1, substeps);
        s.measure();
        result.peak = std::max(result.peak, s.energy.elastic + s.energy.pressure);
        result.worst_balance = std::max(result.worst_balance, std::abs(s.energy.balance));
    }
    result.volume = volume_now(s, ball) / s.meshes.info[0].volume;
    return result;
}
TEST(Pressure, SqueezedBallKeepsItsVolume) {
    const Squeezed free = squeeze(0), kept = squeeze(50e3);
    EXPECT_LT(free.volume, 0.9);
    EXPECT_GT(kept.volume, 0.985);
    EXPECT_LT(kept.volume, 1.0);
    EXPECT_GT(kept.peak, 1.1 * free.peak);
    EXPECT_LT(kept.worst_balance, 0.01 * kept.peak);
    EXPECT_LT(free.worst_balance, 0.01 * free.peak);
    RecordProperty("volume_kept", std::to_string(kept.volume));
    RecordProperty("balance_of_peak", std::to_string(kept.worst_balance / kept.peak));
}

// Momentum of a free body that pressure deforms; gravity off. Spin and translation stay.
TEST(Pressure, FreeBodyKeepsItsMomentum) {
    AdvanceScene s;
    s.params.gravity.setZero();
    Tissue tissue;
    tissue.youngs_modulus = 2e3, tissue.damping = 0, tissue.pressure_modulus = 30e3;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 3, 0.05)), Motion::kDeformable, Vec3d::Zero(), tissue, AnchorFrame::kShape);
    for (uint32_t v = 0; v < 642; ++v) {
        s.particles.offset[v].z *= 1.1f;
        s.set_velocity(body, v, Vec3d(0.1, 0, 0) + Vec3d(0, 3, 2).cross(s.offset(body, v)));
    }
    s.open_books();
    const Momentum start = measure_momentum(s.bodies, s.poses, s.particles, body);
    const double energy = s.energy.kinetic + s.energy.elastic + s.energy.pressure;
    for (int n = 0; n < 300; ++n) s.advance(1, 4);
    s.measure();
    const Momentum end = measure_momentum(s.bodies, s.poses, s.particles, body);
    EXPECT_LT((end.linear - start.linear).norm(), 1e-5 * start.linear.norm());
    EXPECT_LT((end.angular - start.angular).norm(), 1e-4 * start.angular.norm());
    EXPECT_LT(std::abs(s.energy.balance), 0.01 * energy);
}

// The limit must lie under 2 / omega of the stiffest mode, at rest, stretched by 30 % and blown up; found from the
// forces of springs and anchors and the pressure's own energy in double.
TEST(Pressure, LimitIsBelowThatOfTheStiffestMode) {
    AdvanceScene s;
    Tissue tissue;
    tissue.youngs_modulus = 1e3, tissue.damping = 0, tissue.pressure_modulus = 1e6;
    const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 1, 0.1)), Motion::kDeformable, Vec3d::Zero(), tissue);
    const double limit = s.bodies.stable_dt[body] / kStableShare;
    const MeshView mesh = mesh_view(s.meshes, 0);
    const double rest = s.meshes.info[0].volume;
    for (const Vec3d& stretch : {Vec3d(1, 1, 1), Vec3d(1.3, 0.877, 0.877), Vec3d(1.09, 1.09, 1.09), Vec3d(0.9, 0.9, 0.9)}) {
        reference::DoubleBody b = double_copy(s, body);
        for (Vec3d& x : b.place) x = x.cwiseProduct(stretch);
        const int n = static_cast<int>(b.place.size());
        const auto forces = [&] {
            auto f = reference::forces(b);
            const double p = tissue.pressure_modulus * (rest - volume_of(mesh, b.place)) / rest;
            for (const Triangle& t : mesh.triangle) {
                const Vec3d area = (b.place[t[1]] - b.place[t[0]]).cross(b.place[t[2]] - b.place[t[0]]) / 6;
                for (const uint32_t v : t) f[v] += p * area;
            }
            return f;
        };
        Eigen::MatrixXd h(3 * n, 3 * n);
        for (int c = 0; c < 3 * n; ++c) {
            const double step = 1e-6;
            b.place[c / 3][c % 3] += step;
            const auto up = forces();
            b.place[c / 3][c % 3] -= 2 * step;
            const auto down = forces();
            b.place[c / 3][c % 3] += step;
            for (int r = 0; r < 3 * n; ++r)
                h(r, c) = -(up[r / 3][r % 3] - down[r / 3][r % 3]) / (2 * step) * std::sqrt(b.inv_mass[r / 3] * b.inv_mass[c / 3]);
        }
        const double most = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(0.5 * (h + h.transpose())).eigenvalues().maxCoeff();
        EXPECT_LE(limit, 2 / std::sqrt(most)) << stretch.transpose();
        if (stretch.isOnes()) {
            EXPECT_GE(limit, 0.5 * 2 / std::sqrt(most)) << "at most 1 / kStretchReserve^2 where pressure rules";
        }
    }
}

TEST(Pressure, OpenSurfacesAreRefusedByName) {
    AdvanceScene s;
    const uint32_t sheet = s.add_mesh(flat_square(0.1), Admission::kSheet);
    try {
        s.add_body(sheet, Motion::kDeformable, Vec3d::Zero(), balloon(1e3));
        FAIL();
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("body 0"), std::string::npos) << error.what();
    }
}

// Bodies of more than one chunk on one and on four threads; and with the other instruction set's kernels the forces are
// the same code.
TEST(Pressure, SameBitsForAnyNumberOfThreads) {
    const auto run = [](uint32_t threads) {
        auto s = std::make_unique<AdvanceScene>();
        Tissue tissue;
        tissue.pressure_modulus = 30e3;
        s->add_body(s->add_mesh(subdivided_sphere(0.05, 5, 0.02)), Motion::kDeformable, Vec3d::Zero(), tissue);
        for (Float4& o : s->particles.offset) o.z *= 1.2f;
        ThreadPool pool(threads);
        pool.run([&] { s->advance(3, 12); });
        return s;
    };
    const auto one = run(1), four = run(4);
    EXPECT_GT(one->range(0).count, 512u * kSliceWidth);
    EXPECT_EQ(0, std::memcmp(one->particles.offset.data(), four->particles.offset.data(), one->particles.offset.size() * sizeof(Float4)));
}

TEST(Pressure, BodiesWithoutItCostNothing) {
    AdvanceScene s;
    s.add_body(s.add_mesh(subdivided_sphere(0.05, 2)), Motion::kDeformable);
    s.open_books();
    s.advance(2, 2);
    s.measure();
    EXPECT_EQ(s.scratch.force.capacity() + s.scratch.force_sums.capacity(), 0u);
    EXPECT_EQ(s.springs.fans.first.capacity() + s.springs.fans.corner.capacity(), 0u);
    EXPECT_EQ(s.energy_scratch.offset.capacity() + s.energy_scratch.gradient.capacity(), 0u);
    EXPECT_EQ(s.energy.pressure, 0);
}

}  // namespace
}  // namespace trocar
