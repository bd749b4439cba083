#include "engine/tissue/deformable_setup.hpp"

#include <gtest/gtest.h>

#include "engine/base/error.hpp"
#include "tests/systems/advance/advance_scene.hpp"
namespace trocar {
namespace {

struct Shell : testing::Test {
    AdvanceScene scene;
    Tissue tissue;
    uint32_t add(Mesh mesh, AnchorFrame frame = AnchorFrame::kWorld, const Quat& q = {}) {
        return scene.add_body(scene.add_mesh(mesh), Motion::kDeformable, Vec3d(1, 2, 3), tissue, frame, q);
    }
};
using DeformableSetup = Shell;

TEST_F(DeformableSetup, MassesAddUpToDensityTimesVolume) {
    const uint32_t body = add(subdivided_sphere(0.05, 3, 0.05));
    double mass = 0, stiffness = 0;
    for (uint32_t p = 0; p < scene.range(body).count; ++p) {
        const float w = scene.particles.offset[p].w;
        if (w > 0) mass += 1.0 / w;
        stiffness += scene.anchors.stiffness[p];
    }
    const MeshInfo& info = scene.meshes.info[0];
    EXPECT_NEAR(mass, tissue.density * info.volume, 1e-6 * mass);
    EXPECT_NEAR(stiffness, tissue.youngs_modulus * info.area / tissue.depth, 1e-6 * stiffness);
    EXPECT_EQ(scene.range(body).count % kSliceWidth, 0u);
}

// A triangular lattice stretched along x must need sigma = E' * strain with E = 2 k / sqrt(3) per membrane
// thickness and contract by a third: the formula of the header, measured on the lattice itself (Newton on the
// double reference's forces).
TEST_F(DeformableSetup, SpringStiffnessIsThatOfTheWall) {
    const double k = 0.5 * std::sqrt(3.0) * tissue.youngs_modulus * tissue.wall;
    const uint32_t body = add(subdivided_sphere(0.05, 2));
    EXPECT_NEAR(scene.bodies.spring_stiffness[body], k, 1e-6 * k);
    // energy per area of the lattice of edge h under strain (ex, ey): three springs per vertex cell sqrt(3)/2 h^2
    const auto energy = [&](double ex, double ey) {
        double sum = 0;
        for (const double angle : {0.0, std::numbers::pi / 3, 2 * std::numbers::pi / 3}) {
            const double c = std::cos(angle), s = std::sin(angle), strain = ex * c * c + ey * s * s;
            sum += 0.5 * k * strain * strain;
        }
        return sum / (0.5 * std::sqrt(3.0));
    };
    const double nu = 1.0 / 3, stress_per_strain = tissue.youngs_modulus * tissue.wall;
    EXPECT_NEAR(energy(1, -nu), 0.5 * stress_per_strain, 1e-9 * stress_per_strain);
    EXPECT_LT(energy(1, -nu), energy(1, -nu + 0.01));
    EXPECT_LT(energy(1, -nu), energy(1, -nu - 0.01));
}

// The bound must be above the true stiffest mode, at rest and stretched, but not far above: Eigen finds the
// mode.
TEST_F(DeformableSetup, LimitIsAboveTheStiffestMode) {
    const uint32_t body = add(subdivided_sphere(0.05, 1, 0.1));
    for (uint32_t v = 0; v < 5; ++v) scene.particles.offset[scene.range(body).first + v].w = 0;
    update_stable_dt(scene.springs, body, scene.particles, scene.anchors, scene.bodies);
    const double limit = scene.bodies.stable_dt[body] / kStableShare;
    for (const double stretch : {1.0, 0.6, 5.0}) {
        reference::DoubleBody b = double_copy(scene, body);
        for (Vec3d& x : b.position) x *= stretch;
        const double true_limit = 2 / std::sqrt(reference::stiffest_mode(b));
        EXPECT_LE(limit, true_limit * 1.001) << stretch;
        EXPECT_GE(limit, 0.6 * true_limit) << stretch;
    }
}

TEST_F(DeformableSetup, FixedBodyHasNoLimit) {
    const uint32_t body = add(subdivided_sphere(0.05, 1));
    for (Float4& o : scene.particles.offset) o.w = 0;
    update_stable_dt(scene.springs, body, scene.particles, scene.anchors, scene.bodies);
    EXPECT_EQ(scene.bodies.stable_dt[body], std::numeric_limits<double>::infinity());
}

// A copy takes the limit of the preceding body; a body that differs in any input of the limit gets its own.
TEST_F(DeformableSetup, CopiesShareTheLimitOnlyWhileTheyAreEqual) {
    const uint32_t first = add(subdivided_sphere(0.05, 2)), mesh = scene.bodies.mesh[first];
    const Tissue tissue = scene.bodies.tissue[first];
    const auto add_copy = [&] { return scene.add_body(mesh, Motion::kDeformable, {1, 0, 0}, tissue); };
    const auto limit_of = [&](uint32_t body) {
        update_stable_dt(scene.springs, body, scene.particles, scene.anchors, scene.bodies);
        return scene.bodies.stable_dt[body];
    };
    const auto alone = [&](uint32_t body) {  // without a preceding body of its kind
        scene.bodies.stable_dt[body - 1] = std::numeric_limits<double>::infinity();
        const double limit = limit_of(body);
        scene.bodies.stable_dt[body - 1] = limit_of(body - 1);
        return limit;
    };
    const double limit = limit_of(first);
    const uint32_t copy = add_copy();
    EXPECT_EQ(scene.bodies.stable_dt[copy], limit);
    EXPECT_EQ(alone(copy), limit);
    const Range rows = scene.range(copy);
    const auto expect_own = [&](const char* what) {
        const double own = limit_of(copy);
        EXPECT_EQ(own, alone(copy)) << what;
        EXPECT_NE(own, limit) << what;
    };
    scene.bodies.tissue[copy].damping *= 8;
    expect_own("damping");
    scene.bodies.tissue[copy].damping /= 8;
    for (uint32_t p = rows.first; p < rows.end(); ++p) scene.anchors.stiffness[p] *= 3;
    expect_own("anchors");
    for (uint32_t p = rows.first; p < rows.end(); ++p) scene.anchors.stiffness[p] /= 3;
    for (uint32_t p = rows.first; p < rows.end(); ++p) scene.particles.offset[p].w *= 2;
    expect_own("masses");
    for (uint32_t p = rows.first; p < rows.end(); ++p) scene.particles.offset[p].w /= 2;
    scene.bodies.spring_stiffness[copy] *= 2;
    expect_own("springs");
}

TEST_F(DeformableSetup, TurnedBodyStartsAtRest) {
    for (const AnchorFrame frame : {AnchorFrame::kWorld, AnchorFrame::kShape}) {
        const uint32_t body = add(subdivided_sphere(0.05, 2, 0.1), frame, from_rotation_vector({0.3, -1, 0.4}));
        scene.params.gravity.setZero();
        for (const Vec3d& f : reference::forces(double_copy(scene, body))) EXPECT_LT(f.norm(), 1e-5);
    }
}

// M11
TEST_F(DeformableSetup, M11_VertexWithoutTrianglesIsFixed) {
    Mesh mesh = subdivided_sphere(0.05, 1);
    mesh.position.push_back({0, 0, 0.2});
    const uint32_t body = add(mesh);
    const uint32_t last = scene.range(body).first + static_cast<uint32_t>(mesh.position.size()) - 1;
    EXPECT_EQ(scene.particles.offset[last].w, 0);
    EXPECT_EQ(scene.anchors.stiffness[last], 0);
    EXPECT_TRUE(std::isfinite(scene.bodies.stable_dt[body]));
}

// M14
TEST_F(DeformableSetup, M14_ImpossibleMaterialsAreRefusedByName) {
    const uint32_t mesh = scene.add_mesh(subdivided_sphere(0.05, 1));
    for (const double bad : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
        for (double Tissue::*field : {&Tissue::youngs_modulus, &Tissue::density, &Tissue::wall, &Tissue::depth}) {
            Tissue t;
            t.*field = bad;
            try {
                scene.add_body(mesh, Motion::kDeformable, Vec3d::Zero(), t);
                ADD_FAILURE() << bad;
            } catch (const InputError& error) {
                EXPECT_NE(std::string(error.what()).find("body"), std::string::npos);
            }
        }
    }
    EXPECT_TRUE(scene.particles.offset.empty());
}

TEST(SubstepsFor, NeverLongerThanAsked) {
    EXPECT_EQ(substeps_for(1e-3, 1.0, 1e-3), 1u);
    EXPECT_EQ(substeps_for(33e-3, 1.0, 1e-3), 33u);
    EXPECT_EQ(substeps_for(1e-3, 0.3e-3, 1e-3), 4u);
    EXPECT_EQ(substeps_for(1e-3, std::numeric_limits<double>::infinity(), 1.0), 1u);
}

}  // namespace
}  // namespace trocar
