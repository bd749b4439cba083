#include "engine/draw/marker_mesh.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace trocar {
namespace {

Vec3d position(const MarkerMesh& mesh, uint32_t row) { return Vec3(mesh.vertex[row].position).cast<double>(); }

// Signed volume between the triangles and a point.
double volume(const MarkerMesh& mesh, const Vec3d& about) {
    double six = 0;
    for (size_t i = 0; i < mesh.index.size(); i += 3) {
        const Vec3d a = position(mesh, mesh.index[i]) - about, b = position(mesh, mesh.index[i + 1]) - about;
        six += a.dot(b.cross(position(mesh, mesh.index[i + 2]) - about));
    }
    return six / 6;
}

const double kPolygon = 8 * std::sin(std::numbers::pi / 8);  // area of 16 corners on the unit circle

// Breaks when triangles are inside out, shaft or head have other sizes, or the arrow points elsewhere.
TEST(MarkerMesh, AnArrowHasTheVolumeOfPrismAndPyramid) {
    const Vec3d eye(1e6, -2e6, 3e6), from = eye + Vec3d(0.1, 0.2, -0.3), along(0.03, -0.05, 0.02);
    MarkerMesh mesh;
    append_marker({Marker::Kind::kArrow, from, from + along, 0.001, {1, 1, 1, 1}}, eye, mesh);
    const double head = 5 * 0.001, shaft = along.norm() - head;
    const double asked = kPolygon * (1e-6 * shaft + 2.4e-3 * 2.4e-3 * head / 3);
    // the shaft is open where the head's base closes it
    const Vec3d tail(0.1, 0.2, -0.3), joint = tail + shaft * along.normalized();
    EXPECT_NEAR(volume(mesh, joint) / asked, 1, 1e-4);
    double farthest = 0;
    for (uint32_t row = 0; row < mesh.vertex.size(); ++row)
        farthest = std::max(farthest, (position(mesh, row) - tail).dot(along.normalized()));
    EXPECT_NEAR(farthest, along.norm(), 1e-7);
}

// Breaks when a short arrow is longer than the vector it shows.
TEST(MarkerMesh, HalfOfAShortArrowIsItsHead) {
    MarkerMesh mesh;
    append_marker({Marker::Kind::kArrow, Vec3d::Zero(), Vec3d(0, 0, 0.002), 0.001, {1, 1, 1, 1}}, Vec3d::Zero(), mesh);
    EXPECT_NEAR(volume(mesh, Vec3d(0, 0, 0.001)) / (kPolygon * (1e-6 * 1e-3 + 2.4e-3 * 2.4e-3 * 1e-3 / 3)), 1, 1e-5);
}

// Breaks when spheres are not round or their normals do not point outwards.
TEST(MarkerMesh, BallsAreRoundWithNormalsOutwards) {
    MarkerMesh mesh;
    append_marker({Marker::Kind::kArrow, Vec3d::Zero(), Vec3d(0, 0, 0.002), 0.001, {1, 1, 1, 1}}, Vec3d::Zero(), mesh);
    const uint32_t first = static_cast<uint32_t>(mesh.vertex.size());
    const Vec3d centre(0.5, 0.25, -2);
    append_marker({Marker::Kind::kSphere, centre, centre, 0.125, {1, 1, 1, 1}}, Vec3d::Zero(), mesh);
    ASSERT_GT(mesh.vertex.size(), first);
    for (uint32_t row = first; row < mesh.vertex.size(); ++row) {
        const Vec3d out = position(mesh, row) - centre;
        EXPECT_NEAR(out.norm(), 0.125, 1e-6);
        EXPECT_GT(out.normalized().dot(Vec3(mesh.vertex[row].normal).cast<double>()), 0.9999);
    }
}

TEST(MarkerMesh, WhatHasNoSizeOrIsNoNumberAddsNothing) {
    const Vec3d nan = Vec3d::Constant(std::numeric_limits<double>::quiet_NaN()), one = Vec3d::Ones();
    MarkerMesh mesh;
    for (const Marker& m : {Marker{Marker::Kind::kArrow, one, one, 0.1, {}}, Marker{Marker::Kind::kArrow, one, nan, 0.1, {}},
                            Marker{Marker::Kind::kSphere, nan, nan, 0.1, {}}, Marker{Marker::Kind::kSphere, one, one, 0, {}},
                            Marker{Marker::Kind::kSphere, one, one, nan.x(), {}}})
        append_marker(m, Vec3d::Zero(), mesh);
    EXPECT_TRUE(mesh.index.empty());
}

}  // namespace
}  // namespace trocar
