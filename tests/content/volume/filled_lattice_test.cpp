// Solids whose surface cuts whole tetrahedra of a lattice.
#include "content/volume/filled_lattice.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "content/scene/make_solid.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/base/error.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "tests/reference/embedded_statics.hpp"
#include "tests/reference/solid_double.hpp"
#include "tests/systems/advance/tissue/law_block.hpp"
namespace trocar {
namespace {

using reference::ElasticCase;
using Corner = std::array<Vec3d, 4>;

Corner corners_of(const TetMesh& tets, size_t t) {
    Corner c;
    for (int k = 0; k < 4; ++k) c[k] = tets.position[tets.tetrahedron[t][k]];
    return c;
}
double volume_of(const Corner& c) { return six_volumes(c[0], c[1], c[2], c[3]) / 6; }

struct Enclosed {
    double volume = 0;
    Vec3d centre = Vec3d::Zero();
};
// By the divergence theorem.
Enclosed enclosed(const Mesh& mesh) {
    Enclosed e;
    for (const Triangle& t : mesh.triangle) {
        const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
        const double v = a.dot(b.cross(c)) / 6;
        e.volume += v, e.centre += v / 4 * (a + b + c);
    }
    e.centre /= e.volume;
    return e;
}

// Part of a tetrahedron below a plane, from the heights of its corners above it: a quotient of differences of cubes.
double part_below(const std::array<long double, 4>& height) {
    long double above = 0;
    for (int i = 0; i < 4; ++i) {
        if (height[i] <= 0) continue;
        long double product = height[i] * height[i] * height[i];
        for (int j = 0; j < 4; ++j)
            if (j != i) product /= height[i] - height[j];
        above += product;
    }
    return static_cast<double>(1 - above);
}

// Every tetrahedron that a single face of a turned box cuts has the closed form's part.
TEST(FilledLattice, PartsOfTetrahedraAreExact) {
    const Vec3d size(0.05, 0.07, 0.06);
    const ElasticCase box = reference::pulled_bar(size, 0.3, 0.7, 6);
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized()).toRotationMatrix();
    const FilledLattice lattice = fill_lattice(0.009, box.shape.position, box.shape.triangle, 0);
    int cut = 0, full = 0;
    for (size_t t = 0; t < lattice.fill.size(); ++t) {
        const Corner c = corners_of(lattice.tets, t);
        std::array<long double, 4> height{};
        int faces = 0;
        for (int axis = 0; axis < 3; ++axis) {
            for (const int side : {-1, 1}) {
                std::array<long double, 4> h;
                bool in = true;
                for (int k = 0; k < 4; ++k) {
                    h[k] = side * (turn.transpose() * c[k])[axis] - 0.5 * size[axis];
                    in = in && h[k] < 0;
                }
                if (!in) ++faces, height = h;
            }
        }
        if (faces > 1) continue;  // at an edge
        const double part = faces == 0 ? 1 : part_below(height);
        EXPECT_NEAR(lattice.fill[t], part, 1e-9) << t;
        cut += faces, full += faces == 0;
    }
    EXPECT_GT(cut, 500);
    EXPECT_GT(full, 500);
    EXPECT_EQ(lattice.given_away, 0u);
}

// Volume, centre of mass and the part of no tetrahedron, whatever the shape; nothing is lost by giving slivers away.
TEST(FilledLattice, VolumeAndCentreAreThoseOfTheShape) {
    for (const char* shape : {"liver", "sphere", "bowel"}) {
        const Mesh mesh = make_shape(shape, 1000, 1);
        const Enclosed exact = enclosed(mesh);
        const double extent = std::cbrt(exact.volume);
        for (const double least : {0.0, kLeastFill}) {
            const FilledLattice lattice = fill_lattice(extent / 6, mesh.position, mesh.triangle, least);
            double volume = 0;
            Vec3d centre = Vec3d::Zero();
            for (size_t t = 0; t < lattice.fill.size(); ++t) {
                const double v = lattice.fill[t] * volume_of(corners_of(lattice.tets, t));
                volume += v, centre += v * lattice.centroid[t];
                EXPECT_GT(lattice.fill[t], 0);
            }
            EXPECT_NEAR(volume, exact.volume, 1e-9 * exact.volume) << shape;
            EXPECT_LT((centre / volume - exact.centre).norm(), 1e-8 * extent) << shape;
            EXPECT_EQ(lattice.given_away > 0, least > 0) << shape;
            const std::vector<double> nodes = filled_node_volume(lattice);
            double sum = 0;
            Vec3d middle = Vec3d::Zero();
            for (size_t v = 0; v < nodes.size(); ++v) {
                EXPECT_GT(nodes[v], 0);
                sum += nodes[v], middle += nodes[v] * lattice.tets.position[v];
            }
            EXPECT_NEAR(sum, exact.volume, 1e-9 * exact.volume) << shape;
            const double off = (middle / sum - exact.centre).norm() / extent;
            std::printf("[   figure ] %s: centre of mass off by %.3f %% of the cube root of its volume\n", shape, 100 * off);
            EXPECT_LT(off, 5e-4) << shape;
        }
    }
    EXPECT_THROW(fill_lattice(1e-9, make_shape("sphere", 100, 1).position, make_shape("sphere", 100, 1).triangle), InputError);
}

struct BuiltSolid {
    AdvanceScene scene;
    uint32_t prototype = kNone;
    BuiltSolid(const Mesh& mesh, double spacing, double nu, TissueLaw law) {
        prototype = make_solid(scene.meshes, scene.springs, scene.solids, mesh, {}, {.spacing = spacing, .skin = true, .filled = true}).row;
        Tissue tissue;
        tissue.youngs_modulus = reference::kCaseModulus, tissue.poisson = nu, tissue.depth = kNoFoundation, tissue.damping = 0;
        scene.bodies.law = {law};
        scene.params.gravity.setZero();
        scene.params.account_energy = false;
        scene.add_body(prototype, Motion::kDeformable, Vec3d::Zero(), tissue);
    }
};

// A wall of little more than a cell, which stuffing refuses, keeps its volume.
TEST(FilledLattice, ThinWallsAreFilled) {
    const Mesh wall = make_shape("hernia_wall", 3000, 1);
    AdvanceScene scene;
    const SolidOptions stuffed{.cells = 10, .skin = true};
    SolidOptions filled = stuffed;
    filled.filled = true;
    EXPECT_THROW(make_solid(scene.meshes, scene.springs, scene.solids, wall, {}, stuffed), InputError);
    const Prototype made = make_solid(scene.meshes, scene.springs, scene.solids, wall, {}, filled);
    ASSERT_NE(made.row, kNone);
    double volume = 0;
    for (const double v : scene.solids.node_volume) volume += v;
    const double exact = enclosed(wall).volume;
    EXPECT_NEAR(volume, exact, 1e-9 * exact);
}

// However thin the slivers are that the surface cuts, the step is at least that of a whole tetrahedron with kLeastShare of its mass at
// each corner, with the room for large shapes that the engine leaves.
TEST(FilledLattice, NoCutMakesTheStepCollapse) {
    constexpr double kSpacing = 0.01, kNu = 0.45;
    // a tetrahedron of the lattice: two centres and an edge between their cells
    const Vec3d a(0, 0, 0), b(kSpacing, 0, 0), c(0.5 * kSpacing, 0.5 * kSpacing, -0.5 * kSpacing),
        d(0.5 * kSpacing, 0.5 * kSpacing, 0.5 * kSpacing);
    reference::DoubleSolid one = reference::make_double_solid({a, b, c, d}, {{0, 1, 2, 3}});
    ASSERT_GT(volume_of({a, b, c, d}), 0);
    one.youngs_modulus = reference::kCaseModulus, one.poisson = kNu;
    const double stiffest = reference::stiffest_mode(one, Tissue{}.density);
    const double bound = kSolidShare * 2 / std::sqrt(stiffest * kStretchRoom * 0.25 / kLeastShare);
    double least = 1e9, most = 0;
    for (const double extra : {0.001, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.9}) {
        const double side = (4 + extra) * kSpacing;
        BuiltSolid solid(reference::pulled_bar(Vec3d(side, side - 0.003, side - 0.001), kNu, extra, 12).shape, kSpacing, kNu,
                         TissueLaw::kSprings);
        least = std::min(least, solid.scene.bodies.stable_dt[0]), most = std::max(most, solid.scene.bodies.stable_dt[0]);
    }
    std::printf("[   figure ] steps of cut lattices %.3f to %.3f ms, bound %.3f ms\n", 1e3 * least, 1e3 * most, 1e3 * bound);
    EXPECT_GT(least, bound);
    EXPECT_GT(least, 0.75 * most);
}

// First Piola-Kirchhoff stress (Pa) of a body under a uniform deformation gradient, from the momentum that one step gives its nodes.
Eigen::Matrix3d stress_of(BuiltSolid& solid, double volume, const Eigen::Matrix3d& f) {
    constexpr double kStep = 1e-3;
    AdvanceScene& s = solid.scene;
    const SolidInfo& info = s.solids.info[solid.prototype];
    const uint32_t first = embedded_count(info);
    std::vector<double> inverse;
    for (uint32_t v = 0; v < info.inner.count; ++v) {
        Float4& o = s.particles.offset[first + v];
        const Vec3d at = f * s.solids.position[info.inner.first + v];
        o.x = static_cast<float>(at.x()), o.y = static_cast<float>(at.y()), o.z = static_cast<float>(at.z());
        inverse.push_back(o.w);
    }
    s.particles.last_dt[0] = kStep;
    s.advance(1, 1);
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (uint32_t v = 0; v < info.inner.count; ++v)
        sum -= s.velocity(0, first + v) / (kStep * inverse[v]) * s.solids.position[info.inner.first + v].transpose();
    return sum / volume;
}

// The stress that the engine's step gives a cut body under a uniform deformation is the law's.
TEST(FilledLattice, StressOfACutBodyIsThatOfItsLaw) {
    for (const double turn : {0.0, 0.4}) {
        const Mesh mesh = reference::pulled_bar(Vec3d(0.05, 0.043, 0.037), 0.3, turn, 12).shape;
        BuiltSolid solid(mesh, 0.01, 0.45, TissueLaw::kNeoHookean);
        Eigen::Matrix3d f = Eigen::Vector3d(1.2, 0.9, 0.95).asDiagonal();
        f(0, 1) = 0.2;
        const Eigen::Matrix3d exact = NeoHookeanLaw(reference::kCaseModulus, 0.45).stress(f);
        const Eigen::Matrix3d stress = stress_of(solid, enclosed(mesh).volume, f);
        EXPECT_LT((stress - exact).norm(), 1e-3 * exact.norm()) << stress << "\n" << exact;
    }
}

reference::StaticsOutcome outcome(const ElasticCase& what, double spacing, double nu, TissueLaw law) {
    const BuiltSolid solid(what.shape, spacing, nu, law);
    return reference::load_surface(solid.scene.meshes, solid.scene.springs, solid.scene.solids, solid.prototype, law, nu, what);
}

// Second order in space against exact solutions of elasticity, at spacings that fit no side. Work of the loads against the exact one,
// 6 and 12 cells along the longest side.
TEST(FilledLattice, SolidsConvergeToClosedFormsInSecondOrder) {
    struct Bound {
        ElasticCase what;
        double coarse, fine, order;
    };
    const Vec3d bar(0.031, 0.029, 0.103), block(0.083, 0.071, 0.09);
    const double nu = 0.45;
    const Bound bounds[] = {{reference::pulled_bar(bar, nu, 0, 72), 0.002, 0.002, 0},
                            {reference::bent_bar(bar, nu, 0, 72), 0.21, 0.04, 2},
                            {reference::block_under_weight(block, nu, 0, 36), 0.015, 0.004, 1.6},
                            {reference::twisted_cylinder(0.021, 0.09, nu, 0, 40), 0.155, 0.037, 1.9}};
    for (const Bound& b : bounds) {
        const double longest = b.what.name.starts_with("bar") ? bar.z() : block.z();
        const double coarse = outcome(b.what, longest / 6, nu, TissueLaw::kNeoHookean).compliance,
                     fine = outcome(b.what, longest / 12, nu, TissueLaw::kNeoHookean).compliance;
        const double order = std::log2(std::abs(coarse / fine));
        std::printf("[   figure ] %-27s nu %.2f: %+.2f, %+.2f %%, order %.2f\n", b.what.name.c_str(), nu, 100 * coarse, 100 * fine, order);
        EXPECT_LT(std::abs(coarse), b.coarse) << b.what.name;
        EXPECT_LT(std::abs(fine), b.fine) << b.what.name;
        if (b.order > 0) {
            EXPECT_GT(order, b.order) << b.what.name;
        }
    }
}

}  // namespace
}  // namespace trocar
