#include <gtest/gtest.h>

#include <cstdio>

#include "content/scene/build_scene.hpp"
#include "content/scene/make_solid.hpp"
#include "engine/base/error.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "reference/paths.hpp"
#include "systems/frame/frame.hpp"
#include "tests/reference/measures.hpp"
#include "tests/reference/solid_cases.hpp"
#include "tests/systems/advance/advance_scene.hpp"

// Solids of tetrahedra: the springs-and-volume model against closed forms and finite elements in double, and
// the engine against the model.
namespace trocar {
namespace {

using reference::DoubleSolid;
using reference::SolidModel;
using namespace reference::cases;

// A box of nx x ny x nz lattice cubes of edge h in a scene; corner at the origin.
uint32_t add_box(AdvanceScene& scene, int nx, int ny, int nz, double h, const Tissue& tissue, AnchorFrame frame = AnchorFrame::kWorld) {
    TetMesh tets;
    reference::lattice_box(nx, ny, nz, h, 0, tets.position, tets.tetrahedron);
    const Prototype made = add_tet_mesh(scene.meshes, scene.springs, scene.solids, tets, {});
    EXPECT_EQ(made.judgement.admitted_as, Admission::kSolid) << made.judgement.reason;
    return scene.add_body(made.row, Motion::kDeformable, Vec3d::Zero(), tissue, frame);
}

Tissue solid_tissue(double nu, double damping = 0) {
    Tissue tissue;
    tissue.youngs_modulus = kE;
    tissue.poisson = nu;
    tissue.damping = damping;
    tissue.depth = kNoFoundation;
    return tissue;
}

// The body's nodes and tetrahedra for the double model, at their present positions.
DoubleSolid double_solid(const AdvanceScene& scene, uint32_t body) {
    const uint32_t prototype = scene.bodies.mesh[body];
    const SolidInfo& info = scene.solids.info[prototype];
    const MeshView surface = mesh_view(scene.meshes, prototype);
    std::vector<Vec3d> rest(surface.position.begin(), surface.position.end());
    for (uint32_t i = 0; i < info.inner.count; ++i) rest.push_back(scene.solids.position[info.inner.first + i]);
    std::vector<std::array<uint32_t, 4>> tets;
    for (uint32_t t = 0; t < info.count; ++t) {
        const uint32_t row = info.tetrahedra.first + t;
        tets.push_back(
            {scene.solids.corner[0][row], scene.solids.corner[1][row], scene.solids.corner[2][row], scene.solids.corner[3][row]});
    }
    DoubleSolid s = reference::make_double_solid(rest, tets);
    s.youngs_modulus = scene.bodies.tissue[body].youngs_modulus;
    s.poisson = scene.bodies.tissue[body].poisson;
    for (uint32_t v = 0; v < rest.size(); ++v) {
        s.position[v] = scene.offset(body, v);
        if (!(scene.particles.offset[scene.range(body).first + v].w > 0)) s.held[v] = {true, true, true};
    }
    return s;
}

template <typename Where>
void fix(AdvanceScene& scene, uint32_t body, Where&& where) {
    const DoubleSolid s = double_solid(scene, body);
    for (uint32_t v = 0; v < s.rest.size(); ++v) {
        if (where(s.rest[v])) scene.particles.offset[scene.range(body).first + v].w = 0;
    }
    update_solid_dt(scene.meshes, scene.springs, scene.solids, body, scene.particles, scene.anchors, scene.bodies);
}

// ---- the model, in double ----

// Affine at the boundary, affine inside: to round-off on the regular lattice. If inner nodes are perturbed
// springs are not affine (finite elements are): the residual is only reported.
TEST(SolidModel, PatchTest) {
    for (const double jitter : {0.0, 0.1}) {
        for (const SolidModel model : {SolidModel::kSprings, SolidModel::kCorotational}) {
            DoubleSolid s = box_solid(4, 4, 4, 0.01, 0.45, jitter);
            Eigen::Matrix3d strain;
            strain << 2e-3, 1e-3, 0, 1e-3, -1e-3, 5e-4, 0, 5e-4, 1e-3;
            for (size_t i = 0; i < s.rest.size(); ++i) {
                // the outermost centres too: half octahedra at the faces make their surroundings irregular
                const bool outside = (s.rest[i] - Vec3d::Constant(0.02)).cwiseAbs().maxCoeff() > 0.0125;
                if (outside) s.held[i] = {true, true, true}, s.position[i] = s.rest[i] + strain * s.rest[i];
            }
            reference::solve_statics(s, model);
            double worst = 0;
            for (size_t i = 0; i < s.rest.size(); ++i) worst = std::max(worst, (s.position[i] - s.rest[i] - strain * s.rest[i]).norm());
            const double relative = worst / (strain.norm() * 0.01);
            std::printf("patch test, jitter %.1f, %s: largest deviation %.2e of strain * edge\n", jitter,
                        model == SolidModel::kSprings ? "springs" : "finite elements", relative);
            const bool affine = jitter == 0 || model == SolidModel::kCorotational;
            EXPECT_TRUE(affine ? relative < 1e-9 : relative > 1e-4) << relative;
        }
    }
}

// Young's modulus and Poisson's ratio of a finite bar, springs beside finite elements on the same mesh.
TEST(SolidModel, YoungsModulusAndPoissonRatio) {
    for (const double nu : {0.25, 0.35, 0.45, 0.49}) {
        std::array<double, 2> stiffer{}, narrower{};
        for (const int n : {2, 4}) {
            const Uniaxial springs = pull_bar(SolidModel::kSprings, n, nu);
            const Uniaxial elements = pull_bar(SolidModel::kCorotational, n, nu);
            std::printf("bar, nu %.2f, %d cells: E %+.2f %% (finite elements %+.2f %%), nu %.4f (%.4f)\n", nu, n,
                        100 * (springs.modulus / kE - 1), 100 * (elements.modulus / kE - 1), springs.poisson, elements.poisson);
            EXPECT_NEAR(elements.modulus, kE, 1e-6 * kE) << "uniform strain is exact for finite elements";
            EXPECT_NEAR(elements.poisson, nu, 1e-6);
            stiffer[n / 4] = std::abs(springs.modulus / kE - 1);
            narrower[n / 4] = std::abs(springs.poisson - nu);
        }
        // only the layer of half octahedra at the faces is anisotropic, and its share falls with the edge
        EXPECT_LT(stiffer[1], stiffer[0] + 1e-3) << nu;
        EXPECT_LT(stiffer[1], 0.02) << nu;
        EXPECT_LT(narrower[1], 0.7 * narrower[0]) << nu;
        EXPECT_LT(narrower[1], 0.02) << nu;
    }
}

// M21 too: twice as fine, and the static deflection changes by less than 5 %.
TEST(SolidModel, M21_BarUnderItsOwnWeight) {
    for (const double nu : {0.25, 0.45}) {
        std::array<double, 3> error{}, element_error{};
        for (int i = 0; i < 3; ++i) {
            error[i] = hang_bar(SolidModel::kSprings, 1 << i, nu) - 1;
            element_error[i] = hang_bar(SolidModel::kCorotational, 1 << i, nu) - 1;
        }
        std::printf(
            "bar under its own weight, nu %.2f: springs %+.2f %+.2f %+.2f %%, finite elements %+.2f %+.2f %+.2f %% "
            "(1, 2, 4 cells), order %.2f\n",
            nu, 100 * error[0], 100 * error[1], 100 * error[2], 100 * element_error[0], 100 * element_error[1], 100 * element_error[2],
            std::log2(error[1] / error[2]));
        EXPECT_LT(std::abs(element_error[2]), 0.005);
        EXPECT_LT(std::abs(error[2]), 0.05);
        EXPECT_GT(std::log2(error[1] / error[2]), 0.7) << "springs converge with about the first power of the edge";
        EXPECT_LT(std::abs(error[2] - error[1]), 0.05);
    }
}

// Linear tetrahedra are too stiff in bending; springs on them have the same error.
TEST(SolidModel, CantileverUnderItsOwnWeight) {
    for (const double nu : {0.25, 0.45}) {
        std::array<double, 3> error{}, element_error{};
        for (int i = 0; i < 3; ++i) {
            error[i] = sag_cantilever(SolidModel::kSprings, 1 << i, nu) - 1;
            element_error[i] = sag_cantilever(SolidModel::kCorotational, 1 << i, nu) - 1;
        }
        std::printf("cantilever, nu %.2f: springs %+.1f %+.1f %+.1f %%, finite elements %+.1f %+.1f %+.1f %% (1, 2, 4 cells high)\n", nu,
                    100 * error[0], 100 * error[1], 100 * error[2], 100 * element_error[0], 100 * element_error[1], 100 * element_error[2]);
        for (int i = 0; i < 2; ++i) EXPECT_LT(std::abs(error[i + 1]), 0.75 * std::abs(error[i]));
        EXPECT_LT(std::abs(error[2]), std::abs(element_error[2]) + 0.1);
    }
}

// The discrete contact ends between nodes: half an edge of its radius is the mesh's part of the error.
void compare_with_hertz(int edges) {
    for (const double nu : {0.25, 0.45}) {
        const double springs = press_sphere(SolidModel::kSprings, 3 * edges, edges, nu) - 1;
        const double elements = press_sphere(SolidModel::kCorotational, 3 * edges, edges, nu) - 1;
        std::printf("Hertz, nu %.2f, %d edges to the radius: springs %+.1f %%, finite elements %+.1f %%\n", nu, edges, 100 * springs,
                    100 * elements);
        EXPECT_LT(std::abs(springs), 0.5 / edges);
        EXPECT_LT(std::abs(elements), 0.5 / edges);
    }
}
TEST(SolidModel, HertzIndentation) { compare_with_hertz(2); }
TEST(SolidModel, LongHertzIndentation) {
    compare_with_hertz(3);
    compare_with_hertz(4);
}

// ---- the engine against the model ----

// Hung by its upper face until at rest: the positions of Newton's method in double.
TEST(Solid, ComesToRestWhereTheDoubleModelDoes) {
    AdvanceScene scene;
    const uint32_t body = add_box(scene, 2, 2, 4, 0.01, solid_tissue(0.45, 60));
    fix(scene, body, [](const Vec3d& r) { return r.z() > 0.04 - 1e-9; });
    const uint32_t substeps = substeps_for(0.02, scene.bodies.stable_dt[body], 1e-3);
    for (int i = 0; i < 100; ++i) scene.advance(20, substeps);
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
    EXPECT_GT(most, 5e-4);
    EXPECT_LT(worst, 1e-4 * most);
    EXPECT_GT(scene.result.min_volume_ratio, 0.9);
    EXPECT_LT(scene.result.min_volume_ratio, 1.0);
}

struct FreeRun {
    double linear = 0, angular = 0;        // relative change of the momenta
    double kinetic = 0, most_elastic = 0;  // J, at the start; later
    double worst = 0;                      // J, of the balance
};

// A free solid, spinning and stretched, for two seconds in steps of its stable step / `finer`.
FreeRun run_free(uint32_t finer) {
    AdvanceScene scene;
    scene.params.gravity.setZero();
    const uint32_t body = add_box(scene, 3, 3, 3, 0.01, solid_tissue(0.45), AnchorFrame::kShape);
    const DoubleSolid s = double_solid(scene, body);
    for (uint32_t v = 0; v < s.rest.size(); ++v) {
        const Vec3d arm = s.rest[v] - Vec3d::Constant(0.015);
        scene.set_velocity(body, v, Vec3d(0.1, 0, 0) + Vec3d(0, 2, 3).cross(arm) + 10 * Vec3d(arm.x(), -arm.y(), 0.5 * arm.z()));
    }
    const auto momentum = [&] { return measure_momentum(scene.bodies, scene.poses, scene.particles, body); };
    const Momentum before = momentum();
    scene.open_energy_account();
    FreeRun run;
    run.kinetic = scene.energy.kinetic;
    const uint32_t substeps = finer * substeps_for(0.02, scene.bodies.stable_dt[body], 1e-3);
    for (int i = 0; i < 100; ++i) {
        scene.advance(20, substeps);
        scene.measure();
        run.most_elastic = std::max(run.most_elastic, scene.energy.elastic);
        run.worst = std::max(run.worst, std::abs(scene.energy.balance));
    }
    const Momentum after = momentum();
    run.linear = (after.linear - before.linear).norm() / before.linear.norm();
    run.angular = (after.angular - before.angular).norm() / before.angular.norm();
    return run;
}

// No external action, so momentum stays; the energy accounting balances, better with the square of the step.
TEST(Solid, KeepsMomentumAndEnergy) {
    const FreeRun coarse = run_free(1), fine = run_free(3);
    std::printf("free solid, 2 s: momentum %.1e, angular %.1e; energy %.2f %% at the stable step, %.2f %% at a third of it\n",
                coarse.linear, coarse.angular, 100 * coarse.worst / coarse.kinetic, 100 * fine.worst / fine.kinetic);
    for (const FreeRun& run : {coarse, fine}) {
        EXPECT_LT(run.linear, 1e-6);
        EXPECT_LT(run.angular, 1e-5);
        EXPECT_GT(run.most_elastic, 0.1 * run.kinetic) << "hardly deformed: nothing was tested";
    }
    EXPECT_LT(fine.worst, 0.01 * fine.kinetic);
    EXPECT_LT(fine.worst, coarse.worst / 5) << "leapfrog's energy error is of second order";
}

TEST(Solid, EnergyIsThatOfTheDoubleModel) {
    AdvanceScene scene;
    scene.params.gravity.setZero();
    const uint32_t body = add_box(scene, 3, 2, 2, 0.01, solid_tissue(0.4));
    std::mt19937 random(3);
    std::uniform_real_distribution<float> shake(-2e-3f, 2e-3f);
    for (uint32_t p = scene.range(body).first; p < scene.range(body).end(); ++p) {
        if (scene.particles.offset[p].w > 0) scene.particles.offset[p].x += shake(random), scene.particles.offset[p].z += shake(random);
    }
    scene.open_energy_account();
    const double expected = reference::spring_energy(double_solid(scene, body));
    EXPECT_NEAR(scene.energy.elastic, expected, 1e-5 * expected);
}

// 0.99 and 1.05 of the limit set by the stiffest mode of the double model; the engine's own bound is below
// it, at rest, stretched by 30 % and squeezed to 70 % at constant volume.
TEST(Solid, StableStepLiesBelowTheMeasuredLimit) {
    for (const double nu : {0.25, 0.45}) {
        AdvanceScene scene;
        scene.params.gravity.setZero();
        const uint32_t body = add_box(scene, 3, 2, 2, 0.01, solid_tissue(nu));
        fix(scene, body, [](const Vec3d& r) { return r.x() < 1e-9; });
        DoubleSolid s = double_solid(scene, body);
        for (const double stretch : {1.0, 1.3, 0.7}) {
            for (size_t i = 0; i < s.rest.size(); ++i)
                s.position[i] = s.rest[i].cwiseProduct(Vec3d(stretch, 1 / std::sqrt(stretch), 1 / std::sqrt(stretch)));
            const double limit = 2 / std::sqrt(stiffest_mode(s, scene.bodies.tissue[body].density));
            const double bound = scene.bodies.stable_dt[body] / kSolidShare;
            std::printf("solid, nu %.2f, stretched to %.1f: bound %.4f of the measured limit, step %.4f of it\n", nu, stretch,
                        bound / limit, scene.bodies.stable_dt[body] / limit);
            if (stretch == 1.0) {
                EXPECT_LT(bound, limit);
                EXPECT_GT(bound, (nu < 0.4 ? 0.65 : 0.8) * limit);  // the former resist inversion by more than at rest
            }
            EXPECT_LT(scene.bodies.stable_dt[body], 0.9 * limit);
        }
        for (const double share : {0.99, 1.05}) {
            AdvanceScene run = {};
            run.params.gravity.setZero();
            const uint32_t b = add_box(run, 3, 2, 2, 0.01, solid_tissue(nu));
            fix(run, b, [](const Vec3d& r) { return r.x() < 1e-9; });
            for (size_t i = 0; i < s.rest.size(); ++i) s.position[i] = s.rest[i];
            const double limit = 2 / std::sqrt(stiffest_mode(s, run.bodies.tissue[b].density));
            // a call of 1 ms in steps of share * limit: density scaled so that a whole number fits
            const uint32_t substeps = static_cast<uint32_t>(std::ceil(1e-3 / (share * limit)));
            const double scale = std::pow(1e-3 / substeps / (share * limit), 2);
            for (uint32_t p = run.range(b).first; p < run.range(b).end(); ++p) run.particles.offset[p].w /= static_cast<float>(scale);
            std::mt19937 random(1);
            std::uniform_real_distribution<float> shake(-1e-6f, 1e-6f);
            for (uint32_t p = run.range(b).first; p < run.range(b).end(); ++p)
                if (run.particles.offset[p].w > 0) run.particles.offset[p].y += shake(random);
            run.open_energy_account();
            const double start = run.energy.elastic;
            for (int i = 0; i < 40; ++i) run.advance(20, 20 * substeps);
            run.measure();
            const double end = run.energy.elastic + run.energy.kinetic;
            const bool bounded = end < 100 * start && run.report.nonfinite_particles == 0;
            EXPECT_EQ(bounded, share < 1) << "nu " << nu << ", energy " << start << " to " << end;
        }
    }
}

// M13 for solids, and the impossible case.
TEST(HardCases, M13_SolidWithAllNodesFixedRests) {
    AdvanceScene scene;
    const uint32_t body = add_box(scene, 2, 2, 2, 0.01, solid_tissue(0.45));
    fix(scene, body, [](const Vec3d&) { return true; });
    const auto before = scene.particles.offset;
    scene.advance(20, 40);
    EXPECT_EQ(0, std::memcmp(before.data(), scene.particles.offset.data(), before.size() * sizeof(Float4)));
    EXPECT_EQ(scene.bodies.stable_dt[body], std::numeric_limits<double>::infinity());
}

TEST(HardCases, M14_ImpossiblePoissonRatiosAreRefused) {
    for (const double nu : {-0.1, 0.0, 0.2, 0.5, 0.6, std::nan("")}) {
        AdvanceScene scene;
        EXPECT_THROW(add_box(scene, 1, 1, 1, 0.01, solid_tissue(nu)), InputError) << nu;
    }
}

// M10. One node of one solid becomes NaN: that body is restored in the call, another keeps its bits.
TEST(HardCases, M10_SolidWithANanIsRestoredAlone) {
    std::array<std::vector<Float4>, 2> other;
    for (const bool poked : {false, true}) {
        AdvanceScene scene;
        const uint32_t a = add_box(scene, 2, 2, 2, 0.01, solid_tissue(0.45, 5)), b = add_box(scene, 2, 2, 2, 0.01, solid_tissue(0.45, 5));
        for (const uint32_t body : {a, b}) fix(scene, body, [](const Vec3d& r) { return r.z() < 1e-9; });
        scene.advance(20, 60);
        if (poked) scene.particles.offset[scene.range(a).first + 20].x = std::nanf("");
        scene.advance(20, 60);
        const Range rows = scene.range(b);
        other[poked].assign(scene.particles.offset.begin() + rows.first, scene.particles.offset.begin() + rows.end());
        EXPECT_EQ(scene.report.nonfinite_particles > 0, poked);
        for (uint32_t v = 0; v < scene.range(a).count; ++v) EXPECT_TRUE(scene.offset(a, v).allFinite());
        scene.advance(20, 60);
        EXPECT_EQ(scene.result.nonfinite_particles, 0u);
    }
    EXPECT_EQ(0, std::memcmp(other[0].data(), other[1].data(), other[0].size() * sizeof(Float4)));
}

// M17. One node at 1e6 m/s: no non-finite value stays, and the body comes to rest again.
TEST(HardCases, M17_SolidStruckAtAMillionMetresPerSecond) {
    AdvanceScene scene;
    const uint32_t body = add_box(scene, 2, 2, 2, 0.01, solid_tissue(0.45, 20));
    fix(scene, body, [](const Vec3d& r) { return r.z() < 1e-9; });
    const uint32_t substeps = substeps_for(0.02, scene.bodies.stable_dt[body], 1e-3);
    scene.set_velocity(body, 20, Vec3d(1e6, 0, 0));
    for (int i = 0; i < 200; ++i) scene.advance(20, substeps);
    for (uint32_t v = 0; v < scene.range(body).count; ++v) {
        EXPECT_TRUE(scene.offset(body, v).allFinite());
        EXPECT_LT(scene.velocity(body, v).norm(), 1e-3);
    }
    EXPECT_GT(scene.report.nonfinite_particles, 0u) << "logged";
}

// M04, the whole body: mirrored and crushed tetrahedra of a held solid recover after release.
TEST(HardCases, M04_InvertedSolidRecovers) {
    AdvanceScene scene;
    scene.params.gravity.setZero();
    const uint32_t body = add_box(scene, 3, 3, 3, 0.01, solid_tissue(0.45, 20));
    fix(scene, body, [](const Vec3d& r) { return r.z() < 1e-9; });
    const DoubleSolid s = double_solid(scene, body);
    std::mt19937 random(4);
    std::uniform_real_distribution<float> shake(-3e-3f, 3e-3f);
    for (uint32_t v = 0; v < s.rest.size(); ++v) {
        Float4& o = scene.particles.offset[scene.range(body).first + v];
        if (o.w > 0) o.x += shake(random), o.y += shake(random), o.z += shake(random);
    }
    const auto least = [&] {
        const std::vector<double> ratio = volume_ratios(scene.solids, scene.bodies, scene.particles, body);
        return *std::min_element(ratio.begin(), ratio.end());
    };
    EXPECT_LT(least(), -0.1) << "nothing was inverted";
    const uint32_t substeps = substeps_for(0.02, scene.bodies.stable_dt[body], 1e-3);
    for (int i = 0; i < 150; ++i) scene.advance(20, substeps);
    EXPECT_EQ(scene.report.nonfinite_particles, 0u);
    EXPECT_NEAR(least(), 1.0, 1e-3);
    double worst = 0;
    for (uint32_t v = 0; v < s.rest.size(); ++v) worst = std::max(worst, (scene.offset(body, v) - s.rest[v]).norm());
    EXPECT_LT(worst, 1e-5);
}

// ---- scenes ----

struct PressedLiver {
    double least = 1, least_whole = 1, most_whole = 1, deepest = 0;
    uint64_t nonfinite = 0;
    uint32_t tetrahedra = 0;
};

// content/scenes/tet_liver_press with `cells` and the path run until `seconds`.
PressedLiver press_liver(const std::string& cells, double seconds) {
    const std::string path = (source_folder() / "content/scenes/tet_liver_press.toml").string();
    BuiltScene built = build_scene(read_scene_file(path, {{"liver.cells", cells}}), Looks::kPlain);
    PressedLiver out;
    Frame frame(std::move(built.world), {});
    const World& w = frame.world();
    out.tetrahedra = w.solids.info[w.bodies.mesh[0]].count;
    const auto whole = [&] {
        double volume = 0, rest = 0;
        const std::vector<double> ratio = volume_ratios(w.solids, w.bodies, w.particles, 0);
        for (uint32_t t = 0; t < ratio.size(); ++t) {
            const double r = w.solids.rest[w.solids.info[w.bodies.mesh[0]].tetrahedra.first + t];
            rest += r, volume += r * ratio[t];
            out.least = std::min(out.least, ratio[t]);
        }
        return volume / rest;
    };
    while (w.clock.tick * 1e-3 < seconds) {
        frame.step();
        const double ratio = whole();
        out.least_whole = std::min(out.least_whole, ratio);
        out.most_whole = std::max(out.most_whole, ratio);
        for (const double depth : w.penetrations.depth) out.deepest = std::max(out.deepest, depth);
    }
    out.nonfinite = w.report.nonfinite_particles;
    EXPECT_LE(w.report.min_volume_ratio, out.least + 1e-6);
    out.least = std::min(out.least, w.report.min_volume_ratio);
    std::printf("liver of %u tetrahedra pressed 20 mm: least volume of one %.3f of rest, of the whole %.4f to %.4f, residual %.2f mm\n",
                out.tetrahedra, out.least, out.least_whole, out.most_whole, 1e3 * w.report.deepest_residual);
    return out;
}

TEST(Solid, PressedLiverKeepsItsTetrahedra) {
    const PressedLiver liver = press_liver("8", 1.8);
    EXPECT_GT(liver.least, 0.05);
    EXPECT_GT(liver.least_whole, 0.95);
    EXPECT_EQ(liver.nonfinite, 0u);
}

TEST(Solid, LongPressedLiverKeepsItsTetrahedra) {
    const PressedLiver liver = press_liver("18", 14);
    EXPECT_GT(liver.least, 0.05);
    EXPECT_GT(liver.least_whole, 0.95);
    EXPECT_EQ(liver.nonfinite, 0u);
}

}  // namespace
}  // namespace trocar
