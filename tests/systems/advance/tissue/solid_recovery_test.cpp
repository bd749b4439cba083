// Solids of every admitted material, folded in every way, return to their rest shape when let go.
#include <gtest/gtest.h>

#include <cstdio>

#include "content/scene/make_solid.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "tests/reference/measures.hpp"
#include "tests/reference/solid_double.hpp"
#include "tests/systems/advance/advance_scene.hpp"
namespace trocar {
namespace {

constexpr double kEdge = 0.01;  // m, of a lattice cube

struct Block {
    AdvanceScene scene;
    uint32_t body = 0;
    std::vector<Vec3d> rest;
};

// A block of lattice cubes, its face z = 0 held, or free. Damping per explicit step, so that every stiffness
// takes the same steps.
void make_block(Block& b, double youngs_modulus, double nu, bool held, TissueLaw law = TissueLaw::kSprings) {
    TetMesh tets;
    reference::lattice_box(2, 2, 3, kEdge, 0, tets.position, tets.tetrahedron);
    const Prototype made = add_tet_mesh(b.scene.meshes, b.scene.springs, b.scene.solids, tets, {});
    Tissue tissue;
    tissue.youngs_modulus = youngs_modulus;
    tissue.poisson = nu;
    tissue.damping = 0.3 * std::sqrt(youngs_modulus / tissue.density) / kEdge;
    tissue.depth = kNoFoundation;
    b.scene.bodies.law = {law};
    b.scene.params.gravity.setZero();
    b.scene.params.account_energy = false;
    b.body = b.scene.add_body(made.row, Motion::kDeformable, Vec3d::Zero(), tissue, held ? AnchorFrame::kWorld : AnchorFrame::kShape);
    for (uint32_t v = 0; v < b.scene.range(b.body).count; ++v) {
        b.rest.push_back(b.scene.offset(b.body, v));
        if (held && b.rest.back().z() < 1e-9) b.scene.particles.offset[b.scene.range(b.body).first + v].w = 0;
    }
    update_solid_dt(b.scene.meshes, b.scene.springs, b.scene.solids, b.body, b.scene.particles, b.scene.anchors, b.scene.bodies);
}

enum class Fold { kShaken, kVice, kFlat, kMirrored, kPushed, kLoaded };
constexpr Fold kFolds[] = {Fold::kShaken, Fold::kVice, Fold::kFlat, Fold::kMirrored, Fold::kPushed, Fold::kLoaded};

// Time in which a wave of shear crosses an edge, s.
double crossing_time(const Block& b) {
    const Tissue& tissue = b.scene.bodies.tissue[b.body];
    return kEdge / std::sqrt(tissue.youngs_modulus / tissue.density);
}

void advance(Block& b, double crossings) {
    const uint32_t ticks = static_cast<uint32_t>(std::ceil(crossings * crossing_time(b) * 1e3));
    b.scene.advance(ticks, substeps_for(1e-3 * ticks, b.scene.bodies.stable_dt[b.body], 1));
}

void fold(Block& b, Fold how, uint32_t seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    const uint32_t first = b.scene.range(b.body).first;
    const uint32_t pushed = static_cast<uint32_t>(random() % b.rest.size());
    for (uint32_t v = 0; v < b.rest.size() && how != Fold::kLoaded; ++v) {
        Float4& o = b.scene.particles.offset[first + v];
        if (!(o.w > 0)) continue;
        Vec3d p = b.rest[v];
        const Vec3d noise(unit(random), unit(random), unit(random));
        if (how == Fold::kShaken) p += 0.6 * kEdge * noise;
        if (how == Fold::kVice) p.z() *= 0.1;
        if (how == Fold::kFlat) p.z() = 0;
        if (how == Fold::kMirrored) p.z() *= -1;
        if (how == Fold::kPushed && v == pushed) p += 2 * kEdge * noise.normalized();
        if (how != Fold::kShaken) p += 1e-3 * kEdge * noise;
        o.x = static_cast<float>(p.x()), o.y = static_cast<float>(p.y()), o.z = static_cast<float>(p.z());
    }
    if (how != Fold::kLoaded) return;
    // weights of up to three times Young's modulus over the height
    const Tissue& tissue = b.scene.bodies.tissue[b.body];
    for (int load = 0; load < 4; ++load) {
        b.scene.params.gravity = 3 * tissue.youngs_modulus / (tissue.density * 3 * kEdge) * Vec3d(unit(random), unit(random), unit(random));
        advance(b, 10);
    }
    b.scene.params.gravity.setZero();
}

double least_ratio(const Block& b) {
    const std::vector<double> ratio = volume_ratios(b.scene.solids, b.scene.bodies, b.scene.particles, b.body);
    return *std::min_element(ratio.begin(), ratio.end());
}

// Lets go: back at rest, no tetrahedron lost, and none restored.
void expect_recovery(Block& b, bool held, const std::string& what) {
    const double start = least_ratio(b);
    advance(b, 300);
    double worst = 0;
    for (uint32_t v = 0; held && v < b.rest.size(); ++v) worst = std::max(worst, (b.scene.offset(b.body, v) - b.rest[v]).norm());
    EXPECT_NEAR(least_ratio(b), 1, 2e-3) << what << ", from " << start;
    EXPECT_LT(worst, 2e-3 * kEdge) << what;
    EXPECT_EQ(b.scene.report.nonfinite_particles + b.scene.report.runaway_bodies, 0u) << what;
}

// Not a held body mirrored through its base: it may stay twisted by half a turn above it.
TEST(SolidRecovery, FromEveryFold) {
    for (const double nu : {0.25, 0.27, 0.3, 0.35, 0.4, 0.45, 0.48, 0.49, 0.499}) {
        for (const double e : {100.0, 1e4, 1e9}) {
            for (const bool held : {true, false}) {
                for (const Fold how : kFolds) {
                    if (how == (held ? Fold::kMirrored : Fold::kLoaded)) continue;
                    Block b;
                    make_block(b, e, nu, held);
                    fold(b, how, 1);
                    expect_recovery(
                        b, held,
                        "nu " + std::to_string(nu) + " E " + std::to_string(e) + (held ? " held " : " free ") + std::to_string(int(how)));
                }
            }
        }
    }
}

// The neo-Hookean law, but not under loads of three times Young's modulus over the height, which may tear it out of any step.
TEST(SolidRecovery, OfTheNeoHookeanLaw) {
    for (const double nu : {0.25, 0.4, 0.45, 0.49}) {
        for (const bool held : {true, false}) {
            for (const Fold how : {Fold::kShaken, Fold::kVice, Fold::kFlat, Fold::kMirrored, Fold::kPushed}) {
                if (held && how == Fold::kMirrored) continue;
                for (const uint32_t seed : {1u, 2u, 3u}) {
                    Block b;
                    make_block(b, 1e4, nu, held, TissueLaw::kNeoHookean);
                    fold(b, how, seed);
                    expect_recovery(
                        b, held,
                        "nu " + std::to_string(nu) + (held ? " held " : " free ") + std::to_string(int(how)) + " " + std::to_string(seed));
                }
            }
        }
    }
}

// Each tetrahedron in turn: one corner pushed through the others.
TEST(SolidRecovery, OfEveryTetrahedronTurnedInsideOut) {
    for (const double nu : {0.25, 0.3, 0.4, 0.499}) {
        Block start;
        make_block(start, 1e4, nu, true);
        const SolidInfo& info = start.scene.solids.info[start.scene.bodies.mesh[start.body]];
        for (uint32_t t = 0; t < info.count; ++t) {
            Block b;
            make_block(b, 1e4, nu, true);
            std::array<uint32_t, 4> corner;
            for (int k = 0; k < 4; ++k) corner[k] = b.scene.solids.corner[k][info.tetrahedra.first + t];
            // the highest corner is never held
            std::sort(corner.begin(), corner.end(), [&](uint32_t p, uint32_t q) { return b.rest[p].z() > b.rest[q].z(); });
            const Vec3d through = 2.0 / 3 * (b.rest[corner[1]] + b.rest[corner[2]] + b.rest[corner[3]]) - b.rest[corner[0]];
            Float4& o = b.scene.particles.offset[b.scene.range(b.body).first + corner[0]];
            o.x = static_cast<float>(through.x()), o.y = static_cast<float>(through.y()), o.z = static_cast<float>(through.z());
            ASSERT_LT(least_ratio(b), -0.9);
            expect_recovery(b, true, "nu " + std::to_string(nu) + " tetrahedron " + std::to_string(t));
        }
    }
}

}  // namespace
}  // namespace trocar
