// Solids stepped by midpoint: against the double model, a dense solve, each other, and in a scene.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstring>
#include <map>

#include "content/scene/build_scene.hpp"
#include "content/scene/make_solid.hpp"
#include "engine/base/cpu.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/tissue/links.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "engine/tissue/solid_tears.hpp"
#include "reference/paths.hpp"
#include "systems/frame/frame.hpp"
#include "systems/prepare/tear_bodies.hpp"
#include "tests/reference/dense.hpp"
#include "tests/reference/measures.hpp"
#include "tests/reference/solid_double.hpp"
#include "tests/systems/advance/advance_scene.hpp"
namespace trocar {
namespace {

using reference::DoubleSolid;
using reference::SolidModel;

uint32_t add_box(AdvanceScene& scene, int nx, int ny, int nz, double nu, double damping = 0, AnchorFrame frame = AnchorFrame::kWorld,
                 double jitter = 0) {
    TetMesh tets;
    reference::lattice_box(nx, ny, nz, 0.01, jitter, tets.position, tets.tetrahedron);
    const Prototype made = add_tet_mesh(scene.meshes, scene.springs, scene.solids, tets, {});
    Tissue tissue;
    tissue.youngs_modulus = 1e4;
    tissue.poisson = nu;
    tissue.damping = damping;
    tissue.depth = kNoFoundation;
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
        s.position[v] = scene.offset(body, v);
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
}

uint32_t add_falling(AdvanceScene& s) {
    const uint32_t body = add_box(s, 2, 2, 3, 0.45);
    hold_top(s, body, 0.03 - 1e-9);
    s.params.gravity = Vec3d(8, 0, -30);
    return body;
}

// Errors of halved steps against the double model at a tiny step: second order for both.
TEST(SolidIntegrators, ConvergeWithTheirOrder) {
    AdvanceScene first;
    const uint32_t body = add_falling(first);
    DoubleSolid truth = double_solid(first, body);
    const uint32_t count = static_cast<uint32_t>(truth.rest.size());
    std::vector<Vec3d> velocity(count, Vec3d::Zero());
    constexpr double kStep = 8e-6;
    for (int i = 0; i < 4000; ++i) {  // velocity Verlet: half a kick, then whole ones
        const std::vector<Vec3d> force = reference::solid_forces(truth, SolidModel::kSprings);
        for (uint32_t v = 0; v < count; ++v) {
            const double w = first.particles.offset[first.range(body).first + v].w;
            if (!(w > 0)) continue;
            velocity[v] += (i == 0 ? 0.5 : 1.0) * kStep * (w * force[v] + first.params.gravity);
            truth.position[v] += kStep * velocity[v];
        }
    }
    const auto error = [&](Integrator integrator, uint32_t iterations, uint32_t substeps) {
        AdvanceScene s;
        add_falling(s);
        choose(s, integrator, iterations);
        s.advance(32, substeps);
        double sum = 0;
        for (uint32_t v = 0; v < count; ++v) sum += (s.offset(body, v) - truth.position[v]).squaredNorm();
        return std::sqrt(sum / count);
    };
    const struct {
        const char* name;
        Integrator integrator;
        uint32_t iterations, substeps;
        double order, most;  // m; the block oscillates by a millimetre
    } cases[] = {{"leapfrog", Integrator::kLeapfrog, 1, 64, 2, 2e-5}, {"midpoint", Integrator::kMidpoint, 200, 64, 2, 2e-5}};
    for (const auto& c : cases) {
        const double coarse = error(c.integrator, c.iterations, c.substeps), fine = error(c.integrator, c.iterations, 2 * c.substeps);
        const double order = std::log2(coarse / fine);
        std::printf("solid, %s: %.3g m, %.3g m, order %.2f\n", c.name, coarse, fine, order);
        EXPECT_NEAR(order, c.order, 0.3) << c.name;
        EXPECT_LT(coarse, c.most) << c.name;
    }
}

// One midpoint step from a strained state against a dense solve of the header's matrix, built in double from
// the tables; and one of backward Euler, with some tetrahedra crushed and some beyond the cap.
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
        d.position[v] = start[v] + theta * h * velocity[v];
    }
    const SolidModuli moduli = solid_moduli(s.bodies.tissue[body]);
    Eigen::MatrixXd k = Eigen::MatrixXd::Zero(3 * count, 3 * count);
    uint32_t crushed = 0, beyond = 0;
    for (const auto& t : d.tetrahedron) {
        double squared = 0, six = 0, now = 0;
        std::array<Vec3d, 4> p, r;
        for (int i = 0; i < 4; ++i) p[i] = d.position[t[i]], r[i] = d.rest[t[i]];
        six = (r[1] - r[0]).dot((r[2] - r[0]).cross(r[3] - r[0])), now = (p[1] - p[0]).dot((p[2] - p[0]).cross(p[3] - p[0]));
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < i; ++j) squared += (r[i] - r[j]).squaredNorm();
        for (int i = 0; i < 4; ++i) {
            for (int j = 0; j < i; ++j) {
                const Vec3d edge = p[j] - p[i];
                const double a = std::max(0.0, 1 - (r[i] - r[j]).norm() / edge.norm());
                const Eigen::Matrix3d b = moduli.springs * six / squared *
                                          (a * Eigen::Matrix3d::Identity() + (1 - a) * edge.normalized() * edge.normalized().transpose());
                k.block<3, 3>(3 * t[i], 3 * t[i]) += b, k.block<3, 3>(3 * t[j], 3 * t[j]) += b;
                k.block<3, 3>(3 * t[i], 3 * t[j]) -= b, k.block<3, 3>(3 * t[j], 3 * t[i]) -= b;
            }
        }
        const double ratio = now / six;
        crushed += ratio<0.5, beyond += ratio> 1.25 || ratio < 0;
        const double held = std::clamp(ratio - 1, -1.0, double{kStretchCap});
        const double squeezed = std::min(held, 0.0),
                     pressure = std::abs(moduli.bulk * held + moduli.crush * std::min(held + 1 - double{kCrushed}, 0.0) -
                                         moduli.squeeze * squeezed * squeezed);
        for (int i = 1; i < 4; ++i) {
            const double spring = pressure / 6 * ((p[1 + i % 3] - p[0]).norm() + (p[1 + (i + 1) % 3] - p[0]).norm());
            for (const auto& [r, c, sign] : {std::tuple(0, 0, 1), std::tuple(i, i, 1), std::tuple(0, i, -1), std::tuple(i, 0, -1)})
                k.block<3, 3>(3 * t[r], 3 * t[c]) += sign * spring * Eigen::Matrix3d::Identity();
        }
        if (ratio < 0 || ratio > 1 + double{kStretchCap}) continue;
        const double bend = moduli.bulk + (ratio < double{kCrushed} ? moduli.crush : 0) - 2 * moduli.squeeze * squeezed;
        std::array<Vec3d, 4> g{Vec3d::Zero(), (p[2] - p[0]).cross(p[3] - p[0]) / six, (p[3] - p[0]).cross(p[1] - p[0]) / six,
                               (p[1] - p[0]).cross(p[2] - p[0]) / six};
        g[0] = -g[1] - g[2] - g[3];
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < 4; ++j) k.block<3, 3>(3 * t[i], 3 * t[j]) += bend * six / 6 * g[i] * g[j].transpose();
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
    if (theta == 1) {  // bodies that a constraint may touch are stepped by backward Euler; this one is a metre away
        const uint32_t wall = s.add_body(s.add_mesh(flat_square(0.1), Admission::kSheet), Motion::kStatic, {0, 0, -1});
        s.bodies.stepping.resize(2);
        s.add_constraint(body, 0, wall, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, 1, 0);
    }
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

// Hung until at rest: Newton's solution in double, for every integrator, at steps too long for leapfrog.
TEST(SolidIntegrators, SameRestWhoeverSteps) {
    AdvanceScene scene;
    const uint32_t body = add_box(scene, 2, 2, 4, 0.45, 40);
    hold_top(scene, body, 0.04 - 1e-9);
    choose(scene, Integrator::kMidpoint, 80);
    EXPECT_GT(5e-3, scene.bodies.stable_dt[body]);
    for (int i = 0; i < 60; ++i) scene.advance(20, 4);
    DoubleSolid s = double_solid(scene, body);
    const std::vector<Vec3d> found = s.position;
    s.position = s.rest;
    for (size_t i = 0; i < s.rest.size(); ++i) {
        const float w = scene.particles.offset[scene.range(body).first + i].w;
        if (w > 0) s.load[i] = scene.params.gravity / w;
    }
    reference::solve_statics(s, SolidModel::kSprings);
    double worst = 0, most = 0;
    for (size_t i = 0; i < s.rest.size(); ++i) {
        worst = std::max(worst, (s.position[i] - found[i]).norm());
        most = std::max(most, (s.position[i] - s.rest[i]).norm());
    }
    std::printf("hung solid: %.3g of %.3g m from the static solution\n", worst, most);
    EXPECT_LT(worst, 1e-3 * most);
    EXPECT_GT(scene.result.min_volume_ratio, 0.9);
}

// A jittered block held at its top, a corner of its tetrahedra removed while it hangs whole, or built without
// them: both are released. `position` maps rest positions of the remaining nodes to positions.
struct CutBlock {
    std::map<std::array<double, 3>, Vec3d> position;
    double moved = 0;  // m
};
CutBlock let_cut_block_fall(Integrator integrator, uint32_t iterations, uint32_t substeps, bool anew) {
    TetMesh tets;
    reference::lattice_box(3, 3, 4, 0.01, 0.1, tets.position, tets.tetrahedron);
    const auto goes = [&](const std::array<uint32_t, 4>& t) {
        const Vec3d middle = 0.25 * (tets.position[t[0]] + tets.position[t[1]] + tets.position[t[2]] + tets.position[t[3]]);
        return middle.x() > 0.017 && middle.z() < 0.021;
    };
    std::vector<bool> stays(tets.position.size(), false);
    for (const auto& t : tets.tetrahedron) {
        if (!goes(t))
            for (const uint32_t v : t) stays[v] = true;
    }
    TetMesh used;
    std::vector<uint32_t> to(stays.size());
    for (uint32_t v = 0; v < stays.size(); ++v) {
        if (!anew || stays[v]) to[v] = static_cast<uint32_t>(used.position.size()), used.position.push_back(tets.position[v]);
    }
    for (const auto& t : tets.tetrahedron) {
        if (!anew || !goes(t)) used.tetrahedron.push_back({to[t[0]], to[t[1]], to[t[2]], to[t[3]]});
    }
    AdvanceScene s;
    Tissue tissue;
    tissue.youngs_modulus = 1e4, tissue.poisson = 0.45, tissue.damping = 0, tissue.depth = kNoFoundation;
    const uint32_t body =
        s.add_body(add_tet_mesh(s.meshes, s.springs, s.solids, used, {}, !anew).row, Motion::kDeformable, Vec3d::Zero(), tissue);
    hold_top(s, body, 0.035);
    choose(s, integrator, iterations, 1e-7);
    s.params.gravity = Vec3d(8, 0, -30);
    Tears tears;
    Torn torn;
    TornSprings torn_springs;
    const Range rows = s.solids.info[0].tetrahedra;
    if (!anew) {
        TearBody& tear = tears.body.emplace_back();
        tear.body = body;
        add_tear_faces(s.meshes, s.solids, 0, tears, tear);
        torn.tetrahedron.resize(rows.end(), 0), torn.spring.resize(s.springs.neighbour.size(), 0);
        copy_torn_springs(s.springs, s.solids, s.bodies, tears, torn, torn_springs);
        std::vector<uint32_t> gone;
        for (uint32_t t = 0; t < used.tetrahedron.size(); ++t)
            if (goes(used.tetrahedron[t])) gone.push_back(t);
        uint64_t broken = 0;
        drop_tetrahedra(s.springs, s.solids, s.bodies, body, gone, positions_of_nodes(s.solids, s.bodies, s.particles, body), torn,
                        torn_springs, broken);
        EXPECT_GT(broken, 5u);
        lose_mass(s.solids, s.bodies, s.poses, s.anchors, Vec3d::Zero(), body, torn, s.particles);
    }
    AdvanceInputs inputs = s.inputs();
    if (!anew) inputs.other.tears = &tears, inputs.other.torn = &torn, inputs.other.torn_springs = &torn_springs;
    s.params.ticks = 40, s.params.substeps = substeps;
    advance_island(s.params, inputs, s.moving(), {}, s.scratch, {s.particles, s.poses, s.contact_constraints, s.tool_states}, s.result);
    CutBlock out;
    for (uint32_t v = 0; v < s.range(body).count; ++v) {
        if (v >= used.position.size()) break;
        const Vec3d rest = rest_of_node(s.meshes, s.solids, 0, v);
        out.position[{rest.x(), rest.y(), rest.z()}] = s.offset(body, v);
        out.moved = std::max(out.moved, (s.offset(body, v) - rest).norm());
    }
    return out;
}

// A block that lost a corner falls like one built without it. Masses and stiffnesses: float sums, 3e-6.
TEST(SolidIntegrators, ACutBlockFallsAsOneMadeAnew) {
    const auto apart = [](Integrator integrator, uint32_t iterations, uint32_t substeps) {
        const CutBlock anew = let_cut_block_fall(integrator, iterations, substeps, true),
                       cut = let_cut_block_fall(integrator, iterations, substeps, false);
        double most = 0;
        for (const auto& [rest, position] : anew.position) most = std::max(most, (cut.position.at(rest) - position).norm());
        EXPECT_GT(cut.position.size(), anew.position.size());
        EXPECT_GT(anew.moved, 5e-3);
        std::printf("cut block, integrator %d, %u steps: %.2g of %.2g m from one made anew\n", int(integrator), substeps, most, anew.moved);
        return most / anew.moved;
    };
    EXPECT_LT(apart(Integrator::kLeapfrog, 1, 160), 1e-4);
    EXPECT_LT(apart(Integrator::kMidpoint, 300, 40), 1e-4);
}

// Free, spinning and stretched: momentum stays.
TEST(SolidIntegrators, FreeSolidKeepsItsMomentum) {
    AdvanceScene scene;
    scene.params.gravity.setZero();
    const uint32_t body = add_box(scene, 3, 3, 3, 0.45, 0, AnchorFrame::kShape);
    const DoubleSolid s = double_solid(scene, body);
    for (uint32_t v = 0; v < s.rest.size(); ++v) {
        const Vec3d arm = s.rest[v] - Vec3d::Constant(0.015);
        scene.set_velocity(body, v, Vec3d(0.1, 0, 0) + Vec3d(0, 2, 3).cross(arm) + 5 * Vec3d(arm.x(), -arm.y(), 0.5 * arm.z()));
    }
    choose(scene, Integrator::kMidpoint, 60);
    const Momentum before = measure_momentum(scene.bodies, scene.poses, scene.particles, body);
    scene.open_energy_account();
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
            s.bodies.stepping = {{Integrator::kMidpoint, 12, 1e-6, 1}, {Integrator::kMidpoint, 3, 0, 1}};
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

// All nodes inverted or crushed at random come to rest, nothing inverted, under every integrator.
TEST(HardCases, M04_InvertedSolidRecoversWhoeverSteps) {
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
    choose(scene, Integrator::kMidpoint, 40, 1e-4);
    for (int i = 0; i < 150; ++i) scene.advance(20, 5);
    const std::vector<double> ratio = volume_ratios(scene.solids, scene.bodies, scene.particles, body);
    const double least = *std::min_element(ratio.begin(), ratio.end());
    std::printf("inverted solid: least volume at the end %.4f of rest\n", least);
    EXPECT_GT(least, 0.99);
    for (uint32_t v = 0; v < scene.range(body).count; ++v) EXPECT_LT(scene.velocity(body, v).norm(), 1e-3);
    EXPECT_EQ(scene.report.nonfinite_particles, 0u);
}

// One node pushed through to the far side of its tetrahedra, and a whole bar squashed to a tenth of its
// height: released, every tetrahedron recovers its volume, under every integrator.
TEST(HardCases, M04_OneInvertedOrAllSquashedRecoverWhoeverSteps) {
    for (const Integrator integrator : {Integrator::kLeapfrog, Integrator::kMidpoint}) {
        for (const bool squashed : {false, true}) {
            AdvanceScene scene;
            scene.params.gravity.setZero();
            const uint32_t body = add_box(scene, 2, 2, 5, 0.45, 20);
            hold_top(scene, body, 0.05 - 1e-9);
            const DoubleSolid rest = double_solid(scene, body);
            const auto least = [&] {
                const std::vector<double> ratio = volume_ratios(scene.solids, scene.bodies, scene.particles, body);
                return *std::min_element(ratio.begin(), ratio.end());
            };
            for (uint32_t v = 0; v < rest.rest.size(); ++v) {
                Float4& o = scene.particles.offset[scene.range(body).first + v];
                if (squashed)
                    o.z = static_cast<float>(0.05 - 0.1 * (0.05 - rest.rest[v].z()));
                else if ((rest.rest[v] - Vec3d(0.01, 0.01, 0.01)).norm() < 1e-6)
                    o.x += 0.015f, o.z -= 0.007f;
            }
            const double start = least();
            EXPECT_LT(start, squashed ? 0.11 : -0.3);
            choose(scene, integrator, 40, 1e-4);
            const uint32_t explicit_steps = substeps_for(20e-3, scene.bodies.stable_dt[body], 1e-3);
            for (int i = 0; i < 100; ++i) scene.advance(20, integrator == Integrator::kLeapfrog ? explicit_steps : 4);
            std::printf("%s, integrator %d: least volume %.3f, at the end %.4f of rest\n", squashed ? "squashed" : "one inverted",
                        int(integrator), start, least());
            EXPECT_GT(least(), 0.99) << squashed << int(integrator);
            EXPECT_EQ(scene.report.nonfinite_particles + scene.report.runaway_bodies, 0u);
        }
    }
}

// ---- scenes ----

// A rod pressed 20 mm into a liver, held. Midpoint applies contact constraints within its steps: at 10 ms the
// hand's work equals leapfrog's within the position corrections, with nothing inverted meanwhile.
TEST(SolidIntegrators, PressedLiverWhoeverSteps) {
    const std::string path = (source_folder() / "content/scenes/tet_liver_press.toml").string();
    double by_leapfrog = 0;
    const struct {
        const char *integrator, *step;
        double work, lost;  // share of the hand's work under leapfrog: largest deviation, largest loss by steps
    } cases[] = {{"leapfrog", "0", 1, 0}, {"midpoint", "1e-2", 0.06, 0.05}};
    for (const auto& [integrator, step, work, lost] : cases) {
        std::vector<Override> more{{"liver.cells", "8"}, {"liver.triangles", "1500"}, {"liver.integrator", integrator}};
        if (std::string(step) != "0") more.push_back({"liver.step", step});
        BuiltScene built = build_scene(read_scene_file(path, more), Looks::kPlain);
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
        std::printf("pressed liver, %s, step %s s: volume %.4f to %.4f, overlap left %.3f mm, work %.4g J, lost by steps %.4g J\n",
                    integrator, step, least, most, deepest * 1e3, w.energy.work_hand, w.energy.work_numeric);
        if (by_leapfrog == 0) by_leapfrog = w.energy.work_hand;
        EXPECT_NEAR(w.energy.work_hand, by_leapfrog, work * by_leapfrog) << integrator << step;
        EXPECT_LE(std::abs(w.energy.work_numeric), lost * by_leapfrog) << integrator << step;
        EXPECT_GT(w.report.min_volume_ratio, 0.25) << integrator << step;
        EXPECT_GT(least, 0.93) << integrator;
        EXPECT_LT(most, 1.02) << integrator;
        EXPECT_GT(w.energy.work_hand + w.energy.work_push, 0.005) << integrator;
        EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u) << integrator;
        EXPECT_LT(deepest, 1e-3) << integrator;
    }
}

}  // namespace
}  // namespace trocar
