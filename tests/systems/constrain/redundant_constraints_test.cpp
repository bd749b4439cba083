#include "systems/constrain/redundant_constraints.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "tests/systems/detect/contact_scene.hpp"

namespace trocar::test {
namespace {

constexpr double kSize = 0.1;  // m, approximate extent of the positions

struct Point {
    double x, y, distance;
};

// Two rotated rigid bodies with constraints between vertices of one and the face z = 0 of the other.
struct FaceConstraints {
    ContactScene scene{{{make_noisy_sphere(12, kSize, 0.05, 0), Motion::kFree, Vec3d(0.1, 0.2, 0.3), {}},
                        {make_noisy_sphere(9, kSize, 0.05, 1), Motion::kStatic, Vec3d(1, 2, 3), turn({1, 2, 3}, 0.7)}}};
    ContactConstraints constraints;
    RedundantConstraintsScratch scratch;

    void add(const Point& point, bool other_side = false) {
        // the point's position along the normal is irrelevant: only its distance counts
        const uint32_t vertex = static_cast<uint32_t>(constraints.body.size()), body = other_side ? 1 : 0;
        Meshes& meshes = scene.meshes;
        const Vec3d world = rotate(scene.poses.orientation[1], {point.x, point.y, 0.01 * point.distance}) + Vec3d(0.5, 0.4, 0.3);
        meshes.position[meshes.info[scene.bodies.mesh[body]].vertices.first + vertex] =
            rotate_back(scene.poses.orientation[body], world - scene.poses.origin[body]);
        constraints.contact.push_back(vertex);
        constraints.body.push_back(body);
        constraints.other.push_back(1 - body);
        constraints.vertex.push_back({vertex, vertex});
        constraints.along.push_back(0);
        constraints.third.push_back(kNone);
        constraints.across.push_back(0);
        constraints.triangle.push_back({0, 1, 2});
        constraints.weight.push_back({1, 0, 0});
        const Vec3d normal = rotate(scene.poses.orientation[1], Vec3d(0, 0, other_side ? -1 : 1));
        constraints.normal.push_back(rotate_back(scene.poses.orientation[1 - body], normal));
        constraints.distance.push_back(point.distance);
        constraints.friction.push_back(0.3F);
        constraints.impulse.push_back(Vec3d::Zero());
    }
    std::vector<uint32_t> kept() {
        drop_redundant_constraints(scene.surfaces(), scratch, constraints);
        return constraints.contact;
    }
};

// Least distance that the other points allow at a position: the lower hull of their distances, by all
// triangles of them. Infinite if none covers it.
double allowed(const std::vector<Point>& points, const std::vector<uint32_t>& others, const Point& p, double beside) {
    double least = std::numeric_limits<double>::infinity();
    const auto cross = [](const Point& a, const Point& b, const Point& c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); };
    for (const uint32_t i : others)
        for (const uint32_t j : others)
            for (const uint32_t k : others) {
                const Point &a = points[i], &b = points[j], &c = points[k];
                const double area = cross(a, b, c);
                if (i >= j || j >= k || std::abs(area) < 1e-9) continue;
                const double u = cross(b, c, p) / area, v = cross(c, a, p) / area, w = 1 - u - v;
                const double slack = beside * kSize / std::sqrt(std::abs(area));
                if (std::min({u, v, w}) < -slack) continue;
                least = std::min(least, u * a.distance + v * b.distance + w * c.distance);
            }
    return least;
}

// Every dropped constraint follows from the kept ones: on tilted faces with bumps above and below. Breaks
// when the supporting plane is wrong, or the hull loses a corner.
TEST(RedundantConstraints, WhatIsDroppedIsImplied) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(-1, 1);
    size_t all = 0, left = 0;
    for (int round = 0; round < 200; ++round) {
        FaceConstraints face;
        std::vector<Point> points;
        const double tilt_x = 0.05 * unit(random), tilt_y = 0.05 * unit(random), bumps = round % 4 == 0 ? 0 : 1e-3 * unit(random);
        const int count = 3 + round % 40;
        for (int k = 0; k < count; ++k) {
            Point p{0.5 * kSize * unit(random), 0.5 * kSize * unit(random), 0};
            p.distance = 1e-3 + tilt_x * p.x + tilt_y * p.y + (k % 3 == 0 ? bumps * std::abs(unit(random)) : 0);
            points.push_back(p);
            face.add(p, round % 2 == 1 && k % 2 == 1);
        }
        const std::vector<uint32_t> kept = face.kept();
        EXPECT_TRUE(std::ranges::is_sorted(kept)) << round;
        if (bumps >= 0) all += points.size(), left += kept.size();
        for (uint32_t k = 0; k < points.size(); ++k) {
            if (std::ranges::find(kept, k) != kept.end()) continue;
            EXPECT_LE(allowed(points, kept, points[k], 2e-3), points[k].distance + 2e-5 * kSize) << round << ", row " << k;
        }
    }
    std::printf("%zu rows, %zu left\n", all, left);
    EXPECT_LT(left, 6 * all / 10);
}

// Of a flat face exactly the corners stay, wherever other constraints are between them.
TEST(RedundantConstraints, OfAFaceTheCornersStay) {
    FaceConstraints face;
    std::vector<uint32_t> corners;
    for (int x = 0; x <= 8; ++x)
        for (int y = 0; y <= 5; ++y) {
            if ((x == 0 || x == 8) && (y == 0 || y == 5)) corners.push_back(static_cast<uint32_t>(x * 6 + y));
            face.add({0.01 * x, 0.01 * y, 1e-4 + 3e-3 * x - 1e-3 * y});
        }
    EXPECT_EQ(face.kept(), corners);
}

// The lowest point of a bowl bears load despite the rim; a point above the face between corners does not.
TEST(RedundantConstraints, ALowerPointBetweenCornersStays) {
    for (const double middle : {-1e-4, 1e-4}) {
        FaceConstraints face;
        for (const auto& [x, y] : {std::pair(0.0, 0.0), {0.1, 0.0}, {0.1, 0.1}, {0.0, 0.1}}) face.add({x, y, 0});
        face.add({0.04, 0.06, middle});
        EXPECT_EQ(face.kept().size(), middle < 0 ? 5u : 4u);
    }
}

// A rod on a face touches along a line: its ends stay. Constraints at one position count as one.
TEST(RedundantConstraints, OfALineTheEndsStayAndOfAPlaceOne) {
    FaceConstraints line;
    for (int k = 0; k < 9; ++k) line.add({0.012 * (k % 5), 0.007 * (k % 5), 1e-5}, k > 4);
    EXPECT_EQ(line.kept(), (std::vector<uint32_t>{0, 4}));
    FaceConstraints point;
    for (int k = 0; k < 5; ++k) point.add({0.03, 0.02, 1e-5}, k > 2);
    EXPECT_EQ(point.kept().size(), 1u);
}

// The points of deformable bodies share no plane.
TEST(RedundantConstraints, RowsOfWhatDeformsStay) {
    FaceConstraints face;
    for (int k = 0; k < 9; ++k) face.add({0.01 * (k % 3), 0.01 * (k / 3), 0});
    face.scene.bodies.motion[0] = Motion::kDeformable;
    EXPECT_EQ(face.kept().size(), 9u);
}

}  // namespace
}  // namespace trocar::test
