#include "engine/tissue/lumped_volume.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "content/volume/isosurface_stuffing.hpp"
namespace trocar {
namespace {

// An egg with a dent, cut out of a lattice so that its boundary has tetrahedra of all sizes.
TetMesh dented_egg(double spacing) {
    const DistanceField field = [](std::span<const Vec3d> points, std::span<double> distance) {
        for (size_t i = 0; i < points.size(); ++i) {
            const Vec3d p = points[i].cwiseProduct(Vec3d(1, 1.3, 1.7));
            distance[i] = 0.58 * std::max(p.norm() - 1, 0.6 - (p - Vec3d(1.2, 0.1, 0.2)).norm());
        }
    };
    return stuff_isosurface({spacing, 1}, {Vec3d::Constant(-1.1), Vec3d::Constant(1.1)}, field);
}

double volume_of(const TetMesh& mesh, size_t t) {
    Eigen::Matrix4d m = Eigen::Matrix4d::Ones();
    for (int k = 0; k < 4; ++k) m.block<3, 1>(0, k) = mesh.position[mesh.tetrahedron[t][static_cast<size_t>(k)]];
    return std::abs(m.determinant()) / 6;
}

// Gradients of the four shape functions: rows of the inverse of (x y z 1).
Eigen::Matrix<double, 4, 3> gradients(const TetMesh& mesh, size_t t) {
    Eigen::Matrix4d m = Eigen::Matrix4d::Ones();
    for (int k = 0; k < 4; ++k) m.block<3, 1>(0, k) = mesh.position[mesh.tetrahedron[t][static_cast<size_t>(k)]];
    return m.inverse().leftCols<3>();
}

std::vector<double> quarters(const TetMesh& mesh) {
    std::vector<double> out(mesh.position.size(), 0.0);
    for (size_t t = 0; t < mesh.tetrahedron.size(); ++t) {
        for (const uint32_t v : mesh.tetrahedron[t]) out[v] += volume_of(mesh, t) / 4;
    }
    return out;
}

Eigen::MatrixXd laplacian(const TetMesh& mesh) {
    const auto n = static_cast<Eigen::Index>(mesh.position.size());
    Eigen::MatrixXd k = Eigen::MatrixXd::Zero(n, n);
    for (size_t t = 0; t < mesh.tetrahedron.size(); ++t) {
        const auto g = gradients(mesh, t);
        const Eigen::Matrix4d part = volume_of(mesh, t) * g * g.transpose();
        for (int i = 0; i < 4; ++i) {
            for (int j = 0; j < 4; ++j)
                k(mesh.tetrahedron[t][static_cast<size_t>(i)], mesh.tetrahedron[t][static_cast<size_t>(j)]) += part(i, j);
        }
    }
    return k;
}

// All omega^2 of the mesh, ascending: unit conductivity, mass lumped as given.
Eigen::VectorXd spectrum(const Eigen::MatrixXd& stiffness, const std::vector<double>& lumped) {
    const Eigen::VectorXd mass = Eigen::Map<const Eigen::VectorXd>(lumped.data(), stiffness.rows());
    const Eigen::VectorXd root = mass.cwiseSqrt().cwiseInverse();
    return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(root.asDiagonal() * stiffness * root.asDiagonal(), Eigen::EigenvaluesOnly)
        .eigenvalues();
}

// Breaks when volume is created or lost, or a node gets none.
TEST(LumpedVolume, SumIsKept) {
    for (const double spacing : {0.5, 0.31, 0.2}) {
        const TetMesh mesh = dented_egg(spacing);
        const std::vector<double> lumped = lumped_volume(mesh.position, mesh.tetrahedron);
        ASSERT_EQ(lumped.size(), mesh.position.size());
        const double whole = judge_tets(mesh).volume;
        EXPECT_NEAR(std::accumulate(lumped.begin(), lumped.end(), 0.0), whole, 1e-12 * whole);
        for (const double v : lumped) EXPECT_GT(v, 0);
    }
}

// Breaks when nodes still set the step (fewer rounds, another definition of need), or slow modes change.
// Oracle: every eigenvalue of the dense matrix.
TEST(LumpedVolume, StiffestModesAreSoftenedAndSlowOnesAreKept) {
    const TetMesh mesh = dented_egg(0.31);
    const Eigen::MatrixXd stiffness = laplacian(mesh);
    const Eigen::VectorXd before = spectrum(stiffness, quarters(mesh)),
                          after = spectrum(stiffness, lumped_volume(mesh.position, mesh.tetrahedron));
    EXPECT_LT(after.tail(1)[0], 0.45 * before.tail(1)[0]);
    for (int mode = 1; mode <= 6; ++mode) EXPECT_NEAR(after[mode] / before[mode], 1, 0.005) << "mode " << mode;
}

// Breaks when there are too few rounds or needs are not satisfied. Oracle: the diagonal of the dense matrix.
TEST(LumpedVolume, NoNodeIsMuchStifferThanTheMean) {
    for (const double spacing : {0.5, 0.31, 0.2}) {
        const TetMesh mesh = dented_egg(spacing);
        const Eigen::VectorXd diagonal = laplacian(mesh).diagonal();
        const std::vector<double> lumped = lumped_volume(mesh.position, mesh.tetrahedron), whole = quarters(mesh);
        const double mean = diagonal.sum() / std::accumulate(whole.begin(), whole.end(), 0.0);
        double before = 0, after = 0;
        for (size_t v = 0; v < lumped.size(); ++v) {
            before = std::max(before, diagonal[static_cast<Eigen::Index>(v)] / whole[v] / mean);
            after = std::max(after, diagonal[static_cast<Eigen::Index>(v)] / lumped[v] / mean);
        }
        EXPECT_GT(before, 2 * kEvenRate);
        EXPECT_LT(after, 1.001 * kEvenRate) << spacing;
    }
}

// Breaks when mass moves far. Oracle: centre and moments of inertia of the quarters.
TEST(LumpedVolume, CentreAndInertiaHardlyMove) {
    const TetMesh mesh = dented_egg(0.2);
    const auto moments = [&](const std::vector<double>& lumped) {
        Vec3d first = Vec3d::Zero();
        Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
        for (size_t v = 0; v < lumped.size(); ++v) {
            first += lumped[v] * mesh.position[v];
            second += lumped[v] * mesh.position[v] * mesh.position[v].transpose();
        }
        return std::pair{first, second};
    };
    const auto [first, second] = moments(quarters(mesh));
    const auto [evened_first, evened_second] = moments(lumped_volume(mesh.position, mesh.tetrahedron));
    EXPECT_LT((evened_first - first).norm(), 1e-3 * judge_tets(mesh).volume * 1.0);
    EXPECT_LT((evened_second - second).norm(), 3e-3 * second.norm());
}

// Breaks when volume is moved although nothing is too stiff. A block of bricks of six tetrahedra: omega^2 of
// no node is more than 4/3 of the mean.
TEST(LumpedVolume, EvenMeshesKeepTheirQuarters) {
    constexpr uint32_t kSide = 4;
    constexpr std::array<std::array<uint32_t, 3>, 6> kOrders{{{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}}};
    TetMesh block;
    const auto row = [](const std::array<uint32_t, 3>& p) { return (p[2] * kSide + p[1]) * kSide + p[0]; };
    for (uint32_t i = 0; i < kSide * kSide * kSide; ++i) block.position.push_back(Vec3d(i % kSide, i / kSide % kSide, i / (kSide * kSide)));
    for (uint32_t i = 0; i < block.position.size(); ++i) {
        const std::array<uint32_t, 3> corner{i % kSide, i / kSide % kSide, i / (kSide * kSide)};
        if (*std::max_element(corner.begin(), corner.end()) + 1 == kSide) continue;
        for (size_t o = 0; o < kOrders.size(); ++o) {
            std::array<uint32_t, 3> p = corner;
            std::array<uint32_t, 4> t{row(p), 0, 0, 0};
            for (size_t k = 0; k < 3; ++k) ++p[kOrders[o][k]], t[k + 1] = row(p);
            if (o >= 3) std::swap(t[2], t[3]);
            block.tetrahedron.push_back(t);
        }
    }
    const std::vector<double> lumped = lumped_volume(block.position, block.tetrahedron), expected = quarters(block);
    for (size_t v = 0; v < lumped.size(); ++v) EXPECT_NEAR(lumped[v], expected[v], 1e-15) << v;
}

}  // namespace
}  // namespace trocar
