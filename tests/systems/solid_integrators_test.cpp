// Solids stepped by midpoint and xpbd: against the double model, a dense solve, each other, and in a scene.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstring>

#include "content/build_scene.hpp"
#include "content/make_solid.hpp"
#include "engine/error.hpp"
#include "engine/solid_limit.hpp"
#include "engine/thread_pool.hpp"
#include "reference/paths.hpp"
#include "systems/frame.hpp"
#include "tests/reference/dense.hpp"
#include "tests/reference/solid_double.hpp"
#include "tests/systems/advance_scene.hpp"
namespace trocar {
namespace {

using reference::DoubleSolid;
using reference::SolidModel;

uint32_t add_box(AdvanceScene& scene, int nx, int ny, int nz, double nu, double damping = 0, AnchorFrame frame = AnchorFrame::kWorld, double jitter = 0) {
    TetMesh tets;
    reference::lattice_box(nx, ny, nz, 0.01, jitter, tets.position, tets.tetrahedron);
    const Prototype made = add_tet_mesh(scene.meshes, scene.springs, scene.solids, tets, {});
    Tissue tissue;
    tissue.youngs_modulus = 1e4;
    tissue.poisson = nu;
    tissue.damping = damping;
    tissue.depth = kNoBed;
    return scene.add_body(made.row, Motion::kDeformable, Vec3d::Zero(), tissue, frame);
}

DoubleSolid double_solid(const AdvanceScene& scene, uint32_t body) {
    const uint32_t prototype = scene.bodies.mesh[body];
    const SolidInfo& info = scene.solids.info[prototype];
    const MeshView surface = mesh_view(scene.meshes, prototype);
    std::vector<Vec3d> rest(surface.position.begin(), surface.position.end());
    for (uint32_t i = 0; i < info.inner.count; ++i) rest.push_back(scene.solids.position[info.inner.first + i]);
    std::vector<std::array<uint32_t, 4>> tets;
    for (uint32_t t = info.tetrahedra.first; t < info.tetrahedra.first + info.count; ++t)
        tets.push_back({scene.solids.corner[0][t], scene.solids.corner[1][t], scene.solids.corner[2][t], scene.solids.corner[3][t]});
    DoubleSolid s = reference::make_double_solid(rest, tets);
    s.youngs_modulus = scene.bodies.tissue[body].youngs_modulus;
    s.poisson = scene.bodies.tissue[body].poisson;
    for (uint32_t v = 0; v < rest.size(); ++v) {
        s.place[v] = scene.offset(body, v);
        if (!(scene.particles.offset[scene.range(body).first + v].w > 0)) s.held[v] = {true, true, true};
    }
    return s;
}

void hold_top(AdvanceScene& scene, uint32_t body, double above) {
    const DoubleSolid s = double_solid(scene, body);
    for (uint32_t v = 0; v < s.rest.size(); ++v) {
        if (s.rest[v].z() > above) scene.particles.offset[scene.range(body).first + v].w = 0;
    }
    update_solid_dt(scene.meshes, scene.springs, scene.solids, body, scene.particles, scene.anchors, scene.bodies);
}

void choose(AdvanceScene& s, Integrator integrator, uint32_t iterations, double tolerance = 1e-6) {
    s.bodies.stepping.assign(s.bodies.mesh.size(), {integrator, iterations, tolerance, 1});
    if (integrator != Integrator::kXpbd) return;
    for (const uint32_t mesh : s.bodies.mesh) colour_springs(s.springs, mesh), colour_tetrahedra(s.solids, mesh);
}

// A block, held by its top, let fall.
uint32_t add_falling(AdvanceScene& s) {
    const uint32_t body = add_box(s, 2, 2, 3, 0.45);
    hold_top(s, body, 0.03 - 1e-9);
    s.params.gravity = Vec3d(8, 0, -30);
    return body;
}

// Errors of halved steps against the double model at a tiny step: second order for leapfrog and midpoint, first for xpbd.
TEST(SolidIntegrators, ConvergeWithTheirOrder) {
    AdvanceScene first;
    const uint32_t body = add_falling(first);
    DoubleSolid truth = double_solid(first, body);
    const uint32_t count = static_cast<uint32_t>(truth.rest.size());
    std::vector<Vec3d> velocity(count, Vec3d::Zero());
    constexpr double kStep = 8e-6;
    for (int i = 0; i < 4000; ++i) {  // velocity Verlet: half a kick, whole ones after it
        const std::vector<Vec3d> force = reference::solid_forces(truth, SolidModel::kSprings);
        for (uint32_t v = 0; v < count; ++v) {
            const double w = first.particles.offset[first.range(body).first + v].w;
            if (!(w > 0)) continue;
            velocity[v] += (i == 0 ? 0.5 : 1.0) * kStep * (w * force[v] + first.params.gravity);
            truth.place[v] += kStep * velocity[v];
        }
    }
    const auto error = [&](Integrator integrator, uint32_t iterations, uint32_t substeps) {
        AdvanceScene s;
        add_falling(s);
        choose(s, integrator, iterations);
        s.advance(32, substeps);
        double sum = 0;
        for (uint32_t v = 0; v < count; ++v) sum += (s.offset(body, v) - truth.place[v]).squaredNorm();
        return std::sqrt(sum / count);
    };
    const struct {
        const char* name;
        Integrator integrator;
        uint32_t iterations, substeps;
        double order, most;  // m; the block swings by a millimetre
    } cases[] = {{"leapfrog", Integrator::kLeapfrog, 1, 64, 2, 2e-5}, {"midpoint", Integrator::kMidpoint, 200, 64, 2, 2e-5}, {"xpbd", Integrator::kXpbd, 60, 128, 1, 4e-4}};
    for (const auto& c : cases) {
        const double coarse = error(c.integrator, c.iterations, c.substeps), fine = error(c.integrator, c.iterations, 2 * c.substeps);
        const double order = std::log2(coarse / fine);
        std::printf("solid, %s: %.3g m, %.3g m, order %.2f\n", c.name, coarse, fine, order);
        EXPECT_NEAR(order, c.order, 0.3) << c.name;
        EXPECT_LT(coarse, c.most) << c.name;
    }
}

// One midpoint step from a strained state against a dense solve of the matrix that the header names, made in double from
// nothing but the tables; and one of backward Euler, where some tetrahedra are crushed and some beyond the cap.
void compare_with_dense_solve(float most_shake, double theta) {
    AdvanceScene s;
    const uint32_t body = add_box(s, 1, 1, 2, 0.45, 0, AnchorFrame::kWorld, 0.1);
    hold_top(s, body, 0.02 - 1e-9);
    DoubleSolid d = double_solid(s, body);
    const uint32_t count = static_cast<uint32_t>(d.rest.size());
    std::mt19937 random(3);
    std::uniform_real_distribution<float> shake(-most_shake, most_shake);
    for (uint32_t v = 0; v < count; ++v) {
        Float4& o = s.particles.offset[s.range(body).first + v];
        if (!(o.w > 0)) continue;
        o.x += shake(random), o.y += shake(random), o.z += shake(random);
        s.set_velocity(body, v, Vec3d(shake(random), shake(random), shake(random)) * 20);
    }
    const double h = 4e-3;
    std::vector<Vec3d> start(count), velocity(count);
    for (uint32_t v = 0; v < count; ++v) {
        start[v] = s.offset(body, v), velocity[v] = s.velocity(body, v);
        d.place[v] = start[v] + theta * h * velocity[v];
    }
    const SolidModuli moduli = solid_moduli(s.bodies.tissue[body]);
    Eigen::MatrixXd k = Eigen::MatrixXd::Zero(3 * count, 3 * count);
    uint32_t crushed = 0, beyond = 0;
    for (const auto& t : d.tetrahedron) {
        double squared = 0, six = 0, now = 0;
        std::array<Vec3d, 4> p, r;
        for (int i = 0; i < 4; ++i) p[i] = d.place[t[i]], r[i] = d.rest[t[i]];
        six = (r[1] - r[0]).dot((r[2] - r[0]).cross(r[3] - r[0])), now = (p[1] - p[0]).dot((p[2] - p[0]).cross(p[3] - p[0]));
        for (int i = 0; i < 4; ++i) for (int j = 0; j < i; ++j) squared += (r[i] - r[j]).squaredNorm();
        for (int i = 0; i < 4; ++i) {
            for (int j = 0; j < i; ++j) {
                const Vec3d way = p[j] - p[i];
                const double a = std::max(0.0, 1 - (r[i] - r[j]).norm() / way.norm());
                const Eigen::Matrix3d b = moduli.springs * six / squared * (a * Eigen::Matrix3d::Identity() + (1 - a) * way.normalized() * way.normalized().transpose());
                k.block<3, 3>(3 * t[i], 3 * t[i]) += b, k.block<3, 3>(3 * t[j], 3 * t[j]) += b;
                k.block<3, 3>(3 * t[i], 3 * t[j]) -= b, k.block<3, 3>(3 * t[j], 3 * t[i]) -= b;
            }
        }
        const double ratio = now / six;
        crushed += ratio < 0.5, beyond += ratio > 1.25 || ratio < 0;
        const double held = std::clamp(ratio - 1, -1.0, double{kStretchCap});
        const double pressure = std::abs(moduli.bulk * held + moduli.crush * std::min(held + 1 - double{kCrushed}, 0.0));
        for (int i = 1; i < 4; ++i) {
            const double spring = pressure / 6 * ((p[1 + i % 3] - p[0]).norm() + (p[1 + (i + 1) % 3] - p[0]).norm());
            for (const auto& [r, c, sign] : {std::tuple(0, 0, 1), std::tuple(i, i, 1), std::tuple(0, i, -1), std::tuple(i, 0, -1)})
                k.block<3, 3>(3 * t[r], 3 * t[c]) += sign * spring * Eigen::Matrix3d::Identity();
        }
        if (ratio < 0 || ratio > 1 + double{kStretchCap}) continue;
        const double bend = moduli.bulk + (ratio < double{kCrushed} ? moduli.crush : 0);
        std::array<Vec3d, 4> g{Vec3d::Zero(), (p[2] - p[0]).cross(p[3] - p[0]) / six, (p[3] - p[0]).cross(p[1] - p[0]) / six, (p[1] - p[0]).cross(p[2] - p[0]) / six};
        g[0] = -g[1] - g[2] - g[3];
        for (int i = 0; i < 4; ++i) for (int j = 0; j < 4; ++j) k.block<3, 3>(3 * t[i], 3 * t[j]) += bend * six / 6 * g[i] * g[j].transpose();
    }
    ASSERT_EQ(crushed > 0 && beyond > 0, theta == 1);
    const std::vector<Vec3d> force = reference::solid_forces(d, SolidModel::kSprings);
    Eigen::MatrixXd matrix = theta * theta * h * h * k;
    Eigen::VectorXd right(3 * count);
    for (uint32_t v = 0; v < count; ++v) {
        const double w = s.particles.offset[s.range(body).first + v].w;
        matrix.block<3, 3>(3 * v, 3 * v) += (w > 0 ? 1 / w : 1e12) * Eigen::Matrix3d::Identity();
        right.segment<3>(3 * v) = w > 0 ? Vec3d(h * (force[v] + s.params.gravity / w)) : Vec3d(Vec3d::Zero());
    }
    const Eigen::VectorXd change = reference::solve_symmetric(matrix, right);
    choose(s, Integrator::kMidpoint, 400, 1e-8);
    s.advance(4, 1);
    for (uint32_t v = 0; v < count; ++v) {
        const bool fixed = !(s.particles.offset[s.range(body).first + v].w > 0);
        const Vec3d dv = fixed ? Vec3d(Vec3d::Zero()) : Vec3d(change.segment<3>(3 * v));
        EXPECT_LT((s.velocity(body, v) - velocity[v] - dv).norm(), 1e-4 * change.norm()) << v;
        EXPECT_LT((s.offset(body, v) - start[v] - h * (velocity[v] + theta * dv)).norm(), 2e-7) << v;
    }
}

TEST(SolidIntegrators, OneStepAgreesWithADenseSolve) {
    compare_with_dense_solve(1e-3f, 0.5);
    compare_with_dense_solve(4.5e-3f, 1);
}

// Hung and left to come to rest: where Newton's method in double does, whoever steps, at steps that leapfrog does not stand.
TEST(SolidIntegrators, SameRestWhoeverSteps) {
    for (const Integrator integrator : {Integrator::kMidpoint, Integrator::kXpbd}) {
        AdvanceScene scene;
        const uint32_t body = add_box(scene, 2, 2, 4, 0.45, 40);
        hold_top(scene, body, 0.04 - 1e-9);
        choose(scene, integrator, 80);
        const bool midpoint = integrator == Integrator::kMidpoint;
        EXPECT_GT(5e-3, scene.bodies.stable_dt[body]);
        for (int i = 0; i < 60; ++i) scene.advance(20, midpoint ? 4 : 20);
        DoubleSolid s = double_solid(scene, body);
        const std::vector<Vec3d> found = s.place;
        s.place = s.rest;
        for (size_t i = 0; i < s.rest.size(); ++i) {
            const float w = scene.particles.offset[scene.range(body).first + i].w;
            if (w > 0) s.load[i] = scene.params.gravity / w;
        }
        reference::solve_statics(s, SolidModel::kSprings);
        double worst = 0, most = 0;
        for (size_t i = 0; i < s.rest.size(); ++i) {
            worst = std::max(worst, (s.place[i] - found[i]).norm());
            most = std::max(most, (s.place[i] - s.rest[i]).norm());
        }
        std::printf("hung solid, %s: %.3g of %.3g m from the static solution\n", midpoint ? "midpoint" : "xpbd", worst, most);
        EXPECT_LT(worst, (midpoint ? 1e-3 : 5e-3) * most);
        EXPECT_GT(scene.result.min_volume_ratio, midpoint ? 0.9 : 0.0);
    }
}

// Free, spinning and stretched: momentum stays.
TEST(SolidIntegrators, FreeSolidKeepsItsMomentum) {
    for (const Integrator integrator : {Integrator::kMidpoint, Integrator::kXpbd}) {
        AdvanceScene scene;
        scene.params.gravity.setZero();
        const uint32_t body = add_box(scene, 3, 3, 3, 0.45, 0, AnchorFrame::kShape);
        const DoubleSolid s = double_solid(scene, body);
        for (uint32_t v = 0; v < s.rest.size(); ++v) {
            const Vec3d arm = s.rest[v] - Vec3d::Constant(0.015);
            scene.set_velocity(body, v, Vec3d(0.1, 0, 0) + Vec3d(0, 2, 3).cross(arm) + 5 * Vec3d(arm.x(), -arm.y(), 0.5 * arm.z()));
        }
        choose(scene, integrator, integrator == Integrator::kMidpoint ? 60 : 8);
        const Momentum before = measure_momentum(scene.bodies, scene.poses, scene.particles, body);
        scene.open_books();
        const double kinetic = scene.energy.kinetic;
        for (int i = 0; i < 100; ++i) scene.advance(4, 4);
        scene.measure();
        const Momentum after = measure_momentum(scene.bodies, scene.poses, scene.particles, body);
        EXPECT_LT((after.linear - before.linear).norm(), 1e-5 * before.linear.norm());
        EXPECT_LT((after.angular - before.angular).norm(), 1e-2 * before.angular.norm());
        EXPECT_LT(std::abs(scene.energy.balance), 1e-5 * kinetic) << "what steps lose by themselves is measured";
        EXPECT_LT(scene.energy.work_numeric, 0.05 * kinetic) << "and is a loss";
        EXPECT_EQ(scene.report.nonfinite_particles + scene.report.runaway_bodies, 0u);
    }
}

// Blocks of several chunks: the same bits with any number of threads and both instruction sets.
TEST(SolidIntegrators, ThreadsAndInstructionSetsGiveTheSameBits) {
    std::vector<Float4> first;
    double lost = 0;
    for (const auto& [threads, narrow] : {std::pair{1u, false}, {3u, false}, {2u, true}}) {
        AdvanceScene s;
        ThreadPool pool(threads);
        pool.run([&] {
            force_avx2(narrow);
            for (int i = 0; i < 2; ++i) {
                const uint32_t body = add_box(s, 7, 7, 8, 0.45, 3);
                hold_top(s, body, 0.08 - 1e-9);
            }
            s.bodies.stepping = {{Integrator::kMidpoint, 12, 1e-6, 1}, {Integrator::kXpbd, 3, 0, 1}};
            colour_springs(s.springs, 1), colour_tetrahedra(s.solids, 1);
            s.advance(10, 5);
            force_avx2(false);
        });
        EXPECT_EQ(s.report.nonfinite_particles, 0u);
        if (first.empty()) first = s.particles.offset, lost = s.energy.work_numeric;
        EXPECT_EQ(0, std::memcmp(first.data(), s.particles.offset.data(), first.size() * sizeof(Float4))) << threads;
        EXPECT_EQ(lost, s.energy.work_numeric);
        EXPECT_LT(s.offset(0, 0).z(), -1e-5) << "it sank";
        EXPECT_LT(s.offset(1, 0).z(), -1e-5);
    }
}

// All nodes inverted or crushed at random come to rest, nothing inverted, however they are stepped.
TEST(HardCases, M04_InvertedSolidRecoversWhoeverSteps) {
    for (const Integrator integrator : {Integrator::kMidpoint, Integrator::kXpbd}) {
        AdvanceScene scene;
        scene.params.gravity.setZero();
        const uint32_t body = add_box(scene, 3, 3, 3, 0.45, 20);
        hold_top(scene, body, 0.03 - 1e-9);
        std::mt19937 random(4);
        std::uniform_real_distribution<float> shake(-3e-3f, 3e-3f);
        for (uint32_t p = scene.range(body).first; p < scene.range(body).end(); ++p) {
            Float4& o = scene.particles.offset[p];
            if (o.w > 0) o.x += shake(random), o.y += shake(random), o.z += shake(random);
        }
        choose(scene, integrator, integrator == Integrator::kMidpoint ? 40 : 10, 1e-4);
        for (int i = 0; i < 150; ++i) scene.advance(20, integrator == Integrator::kMidpoint ? 5 : 20);
        const std::vector<double> ratio = volume_ratios(scene.solids, scene.bodies, scene.particles, body);
        const double least = *std::min_element(ratio.begin(), ratio.end());
        std::printf("inverted solid, integrator %d: least volume at the end %.4f of rest\n", int(integrator), least);
        // backward Euler goes to the nearest rest, which may have crushed corners
        EXPECT_GT(least, integrator == Integrator::kMidpoint ? 0.1 : 0.995) << int(integrator);
        for (uint32_t v = 0; v < scene.range(body).count; ++v) EXPECT_LT(scene.velocity(body, v).norm(), 1e-3);
        EXPECT_EQ(scene.report.nonfinite_particles, 0u);
    }
}

// ---- scenes ----

TEST(SolidIntegrators, PressedLiverWhoeverSteps) {
    const std::string path = (source_folder() / "content/scenes/tet_liver_press.toml").string();
    for (const char* integrator : {"midpoint", "xpbd"}) {
        BuiltScene built = build_scene(read_scene_file(path, {{"liver.cells", "8"}, {"liver.triangles", "1500"}, {"liver.integrator", integrator}}));
        EXPECT_NE(built.world.bodies.stepping[0].integrator, Integrator::kLeapfrog);
        EXPECT_EQ(find_fault(built.world), "");
        Frame frame(std::move(built.world), {});
        const World& w = frame.world();
        double least = 1, most = 0, deepest = 0;
        while (w.clock.tick < 2500) {
            frame.step();
            const std::vector<double> ratio = volume_ratios(w.solids, w.bodies, w.particles, 0);
            double volume = 0, rest = 0;
            for (uint32_t t = 0; t < ratio.size(); ++t) rest += w.solids.rest[t], volume += ratio[t] * w.solids.rest[t];
            least = std::min(least, volume / rest), most = std::max(most, volume / rest);
            if (w.clock.tick > 1500) deepest = std::max(deepest, w.report.deepest_residual);
        }
        std::printf("pressed liver, %s: volume %.4f to %.4f, overlap left %.3f mm, work %.4g J, lost by steps %.4g J\n", integrator, least, most, deepest * 1e3,
                    w.energy.work_hand, w.energy.work_numeric);
        EXPECT_GT(least, 0.93) << integrator;
        EXPECT_LT(most, 1.02) << integrator;
        EXPECT_GT(w.energy.work_hand + w.energy.work_push, 0.005) << integrator;
        EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u) << integrator;
        EXPECT_LT(deepest, 1e-3) << integrator;
    }
}

// `auto` asks of solids what it asks of shells: held, and more steps a millisecond than it likes.
TEST(SolidIntegrators, AutoIncludesSolids) {
    const std::string path = (source_folder() / "content/scenes/tet_liver_press.toml").string();
    const auto picks = [&](std::vector<Override> more) {
        more.insert(more.end(), {{"liver.cells", "8"}, {"liver.triangles", "1500"}, {"liver.integrator", "auto"}});
        const BuiltScene built = build_scene(read_scene_file(path, more));
        return stepping_of(built.world.bodies, 0).integrator;
    };
    EXPECT_EQ(picks({}), Integrator::kLeapfrog);
    EXPECT_EQ(picks({{"liver.tissue.youngs_modulus", "5e6"}}), Integrator::kMidpoint);
    EXPECT_EQ(picks({{"liver.tissue.youngs_modulus", "5e6"}, {"liver.skin", "true"}}), Integrator::kMidpoint);
    EXPECT_EQ(picks({{"liver.tissue.youngs_modulus", "5e6"}, {"liver.wanted_error", "1e-5"}}), Integrator::kLeapfrog);
    EXPECT_EQ(picks({{"liver.tissue.youngs_modulus", "5e6"}, {"liver.fixed_below", "-1"}}), Integrator::kLeapfrog) << "nothing holds it";
    EXPECT_EQ(picks({{"liver.tissue.youngs_modulus", "5e6"}, {"liver.fixed_below", "-1"}, {"liver.skin", "true"}}), Integrator::kLeapfrog) << "a skin is not held";
}

}  // namespace
}  // namespace trocar
