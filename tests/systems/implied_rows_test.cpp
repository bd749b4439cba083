#include "systems/implied_rows.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "tests/systems/contact_scene.hpp"

namespace trocar::test {
namespace {

constexpr double kSize = 0.1;  // m, about, of the places

struct Place {
    double x, y, distance;
};

// Two rigid bodies whose rows are vertices of the first against the face z = 0 of the second, both turned in the world.
struct FaceRows {
    ContactScene scene{{{make_noisy_sphere(12, kSize, 0.05, 0), Motion::kFree, Vec3d(0.1, 0.2, 0.3), {}},
                        {make_noisy_sphere(9, kSize, 0.05, 1), Motion::kStatic, Vec3d(1, 2, 3), turn({1, 2, 3}, 0.7)}}};
    ContactRows rows;
    ImpliedRowsScratch scratch;

    void add(const Place& place, bool other_side = false) {
        // where the point lies along the normal says nothing: only its distance counts
        const uint32_t vertex = static_cast<uint32_t>(rows.body.size()), body = other_side ? 1 : 0;
        Meshes& meshes = scene.meshes;
        const Vec3d world = rotate(scene.poses.orientation[1], {place.x, place.y, 0.01 * place.distance}) + Vec3d(0.5, 0.4, 0.3);
        meshes.position[meshes.info[scene.bodies.mesh[body]].vertices.first + vertex] =
            rotate_back(scene.poses.orientation[body], world - scene.poses.origin[body]);
        rows.contact.push_back(vertex);
        rows.body.push_back(body);
        rows.other.push_back(1 - body);
        rows.vertex.push_back({vertex, vertex});
        rows.along.push_back(0);
        rows.third.push_back(kNone);
        rows.across.push_back(0);
        rows.triangle.push_back({});
        rows.weight.push_back({1, 0, 0});
        const Vec3d normal = rotate(scene.poses.orientation[1], Vec3d(0, 0, other_side ? -1 : 1));
        rows.normal.push_back(rotate_back(scene.poses.orientation[1 - body], normal));
        rows.distance.push_back(place.distance);
        rows.friction.push_back(0.3F);
        rows.impulse.push_back(Vec3d::Zero());
    }
    std::vector<uint32_t> kept() {
        drop_implied_rows(scene.surfaces(), scratch, rows);
        return rows.contact;
    }
};

// Least distance that the others allow a place: the lower hull of their distances, by all triangles of them. Infinite where
// none covers it.
double allowed(const std::vector<Place>& places, const std::vector<uint32_t>& others, const Place& p, double beside) {
    double least = std::numeric_limits<double>::infinity();
    const auto cross = [](const Place& a, const Place& b, const Place& c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); };
    for (const uint32_t i : others)
        for (const uint32_t j : others)
            for (const uint32_t k : others) {
                const Place &a = places[i], &b = places[j], &c = places[k];
                const double area = cross(a, b, c);
                if (i >= j || j >= k || std::abs(area) < 1e-9) continue;
                const double u = cross(b, c, p) / area, v = cross(c, a, p) / area, w = 1 - u - v;
                const double slack = beside * kSize / std::sqrt(std::abs(area));
                if (std::min({u, v, w}) < -slack) continue;
                least = std::min(least, u * a.distance + v * b.distance + w * c.distance);
            }
    return least;
}

// Nothing is dropped that the kept ones do not imply: on tilted faces with bumps above and below. Breaks when the supporting
// plane is none, or the hull loses a corner.
TEST(ImpliedRows, WhatIsDroppedIsImplied) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(-1, 1);
    size_t all = 0, left = 0;
    for (int round = 0; round < 200; ++round) {
        FaceRows face;
        std::vector<Place> places;
        const double tilt_x = 0.05 * unit(random), tilt_y = 0.05 * unit(random), bumps = round % 4 == 0 ? 0 : 1e-3 * unit(random);
        const int count = 3 + round % 40;
        for (int k = 0; k < count; ++k) {
            Place p{0.5 * kSize * unit(random), 0.5 * kSize * unit(random), 0};
            p.distance = 1e-3 + tilt_x * p.x + tilt_y * p.y + (k % 3 == 0 ? bumps * std::abs(unit(random)) : 0);
            places.push_back(p);
            face.add(p, round % 2 == 1 && k % 2 == 1);
        }
        const std::vector<uint32_t> kept = face.kept();
        EXPECT_TRUE(std::ranges::is_sorted(kept)) << round;
        if (bumps >= 0) all += places.size(), left += kept.size();
        for (uint32_t k = 0; k < places.size(); ++k) {
            if (std::ranges::find(kept, k) != kept.end()) continue;
            EXPECT_LE(allowed(places, kept, places[k], 2e-3), places[k].distance + 2e-5 * kSize) << round << ", row " << k;
        }
    }
    std::printf("%zu rows, %zu left\n", all, left);
    EXPECT_LT(left, 6 * all / 10);
}

// Of a flat face the corners stay and no others, wherever rows lie between them.
TEST(ImpliedRows, OfAFaceTheCornersStay) {
    FaceRows face;
    std::vector<uint32_t> corners;
    for (int x = 0; x <= 8; ++x)
        for (int y = 0; y <= 5; ++y) {
            if ((x == 0 || x == 8) && (y == 0 || y == 5)) corners.push_back(static_cast<uint32_t>(x * 6 + y));
            face.add({0.01 * x, 0.01 * y, 1e-4 + 3e-3 * x - 1e-3 * y});
        }
    EXPECT_EQ(face.kept(), corners);
}

// The lowest point of a bowl carries, whatever its rim does; a point above the face between corners does not.
TEST(ImpliedRows, ALowerPointBetweenCornersStays) {
    for (const double middle : {-1e-4, 1e-4}) {
        FaceRows face;
        for (const auto& [x, y] : {std::pair(0.0, 0.0), {0.1, 0.0}, {0.1, 0.1}, {0.0, 0.1}}) face.add({x, y, 0});
        face.add({0.04, 0.06, middle});
        EXPECT_EQ(face.kept().size(), middle < 0 ? 5u : 4u);
    }
}

// A rod on a face touches along a line: its ends stay. Rows at one place are one.
TEST(ImpliedRows, OfALineTheEndsStayAndOfAPlaceOne) {
    FaceRows line;
    for (int k = 0; k < 9; ++k) line.add({0.012 * (k % 5), 0.007 * (k % 5), 1e-5}, k > 4);
    EXPECT_EQ(line.kept(), (std::vector<uint32_t>{0, 4}));
    FaceRows place;
    for (int k = 0; k < 5; ++k) place.add({0.03, 0.02, 1e-5}, k > 2);
    EXPECT_EQ(place.kept().size(), 1u);
}

// What deforms has no plane that its points share.
TEST(ImpliedRows, RowsOfWhatDeformsStay) {
    FaceRows face;
    for (int k = 0; k < 9; ++k) face.add({0.01 * (k % 3), 0.01 * (k / 3), 0});
    face.scene.bodies.motion[0] = Motion::kDeformable;
    EXPECT_EQ(face.kept().size(), 9u);
}

}  // namespace
}  // namespace trocar::test
