// Solids in time: against the double model, each other, and in a scene.
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

uint32_t add_falling(AdvanceScene& s) {
    const uint32_t body = add_box(s, 2, 2, 3, 0.45);
    hold_top(s, body, 0.03 - 1e-9);
    s.params.gravity = Vec3d(8, 0, -30);
    return body;
}

// Errors of halved steps against the double model at a tiny step: second order.
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
    const auto error = [&](uint32_t substeps) {
        AdvanceScene s;
        add_falling(s);
        s.advance(32, substeps);
        double sum = 0;
        for (uint32_t v = 0; v < count; ++v) sum += (s.offset(body, v) - truth.position[v]).squaredNorm();
        return std::sqrt(sum / count);
    };
    const double coarse = error(64), fine = error(128), order = std::log2(coarse / fine);
    std::printf("solid: %.3g m, %.3g m, order %.2f\n", coarse, fine, order);
    EXPECT_NEAR(order, 2, 0.3);
    EXPECT_LT(coarse, 2e-5);  // the block oscillates by a millimetre
}

// Hung until at rest: Newton's solution in double.
TEST(SolidIntegrators, HungSolidIsTheStaticSolution) {
    AdvanceScene scene;
    const uint32_t body = add_box(scene, 2, 2, 4, 0.45, 40);
    hold_top(scene, body, 0.04 - 1e-9);
    const uint32_t substeps = substeps_for(20e-3, scene.bodies.stable_dt[body], 1e-3);
    for (int i = 0; i < 60; ++i) scene.advance(20, substeps);
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
CutBlock let_cut_block_fall(uint32_t substeps, bool anew) {
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
    const CutBlock anew = let_cut_block_fall(160, true), cut = let_cut_block_fall(160, false);
    double most = 0;
    for (const auto& [rest, position] : anew.position) most = std::max(most, (cut.position.at(rest) - position).norm());
    EXPECT_GT(cut.position.size(), anew.position.size());
    EXPECT_GT(anew.moved, 5e-3);
    std::printf("cut block: %.2g of %.2g m from one made anew\n", most, anew.moved);
    EXPECT_LT(most / anew.moved, 1e-4);
}

// Blocks of several chunks: the same bits with any number of threads and both instruction sets.
TEST(SolidIntegrators, ThreadsAndInstructionSetsGiveTheSameBits) {
    std::vector<Float4> first;
    for (const auto& [threads, narrow] : {std::pair{1u, false}, {3u, false}, {2u, true}}) {
        AdvanceScene s;
        ThreadPool pool(threads);
        pool.run([&] {
            force_avx2(narrow);
            for (int i = 0; i < 2; ++i) {
                const uint32_t body = add_box(s, 7, 7, 8, 0.45, 3);
                hold_top(s, body, 0.08 - 1e-9);
            }
            s.advance(10, substeps_for(10e-3, s.bodies.stable_dt[0], 1e-3));
            force_avx2(false);
        });
        EXPECT_EQ(s.report.nonfinite_particles, 0u);
        if (first.empty()) first = s.particles.offset;
        EXPECT_EQ(0, std::memcmp(first.data(), s.particles.offset.data(), first.size() * sizeof(Float4))) << threads;
        EXPECT_LT(s.offset(0, 0).z(), -1e-5) << "it sank";
        EXPECT_LT(s.offset(1, 0).z(), -1e-5);
    }
}

// All nodes inverted or crushed at random come to rest, nothing inverted.
TEST(HardCases, M04_InvertedSolidRecovers) {
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
    const uint32_t substeps = substeps_for(20e-3, scene.bodies.stable_dt[body], 1e-3);
    for (int i = 0; i < 150; ++i) scene.advance(20, substeps);
    const std::vector<double> ratio = volume_ratios(scene.solids, scene.bodies, scene.particles, body);
    const double least = *std::min_element(ratio.begin(), ratio.end());
    std::printf("inverted solid: least volume at the end %.4f of rest\n", least);
    EXPECT_GT(least, 0.99);
    for (uint32_t v = 0; v < scene.range(body).count; ++v) EXPECT_LT(scene.velocity(body, v).norm(), 1e-3);
    EXPECT_EQ(scene.report.nonfinite_particles, 0u);
}

// One node pushed through to the far side of its tetrahedra, and a whole bar squashed to a tenth of its
// height: released, every tetrahedron recovers its volume.
TEST(HardCases, M04_OneInvertedOrAllSquashedRecover) {
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
        const uint32_t explicit_steps = substeps_for(20e-3, scene.bodies.stable_dt[body], 1e-3);
        for (int i = 0; i < 100; ++i) scene.advance(20, explicit_steps);
        std::printf("%s: least volume %.3f, at the end %.4f of rest\n", squashed ? "squashed" : "one inverted", start, least());
        EXPECT_GT(least(), 0.99) << squashed;
        EXPECT_EQ(scene.report.nonfinite_particles + scene.report.runaway_bodies, 0u);
    }
}

// ---- scenes ----

// A rod pressed 20 mm into a liver, held, with nothing inverted meanwhile.
TEST(SolidIntegrators, PressedLiver) {
    const std::string path = (source_folder() / "content/scenes/tet_liver_press.toml").string();
    const std::vector<Override> more{{"liver.cells", "8"}, {"liver.triangles", "1500"}};
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
    std::printf("pressed liver: volume %.4f to %.4f, overlap left %.3f mm, work %.4g J\n", least, most, deepest * 1e3, w.energy.work_hand);
    EXPECT_GT(w.report.min_volume_ratio, 0.25);
    EXPECT_GT(least, 0.93);
    EXPECT_LT(most, 1.02);
    EXPECT_GT(w.energy.work_hand + w.energy.work_push, 0.005);
    EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u);
    EXPECT_LT(deepest, 1e-3);
}

}  // namespace
}  // namespace trocar
