// Cuts of triangulated surfaces: random strokes, judged by counting.
#include "engine/mesh/surface_cut.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <string>
namespace trocar {
namespace {

// A flat sheet of equilateral triangles of 1 m, with room for cuts.
struct CutSheet {
    std::vector<Vec3d> rest, place;
    std::vector<Triangle> triangle;
    std::vector<std::array<Vec2, 3>> uv;
    std::vector<uint16_t> material;
    CutMesh mesh;

    explicit CutSheet(uint32_t n, size_t room = 20'000) {
        const auto id = [n](uint32_t i, uint32_t j) { return i * (n + 1) + j; };
        for (uint32_t i = 0; i <= n; ++i)
            for (uint32_t j = 0; j <= n; ++j) rest.push_back({j + 0.5 * (i % 2), i * std::sqrt(0.75), 0});
        for (uint32_t i = 0; i < n; ++i) {
            for (uint32_t j = 0; j < n; ++j) {
                const uint32_t a = id(i, j), b = id(i, j + 1), c = id(i + 1, j), d = id(i + 1, j + 1);
                if (i % 2 == 0)
                    triangle.push_back({a, b, c}), triangle.push_back({b, d, c});
                else
                    triangle.push_back({a, b, d}), triangle.push_back({a, d, c});
            }
        }
        const uint32_t vertices = static_cast<uint32_t>(rest.size()), triangles = static_cast<uint32_t>(triangle.size());
        rest.resize(room, Vec3d::Zero()), triangle.resize(room), uv.resize(room), material.resize(room);
        place = rest;
        mesh = {vertices, triangles, rest, place, triangle, uv, material, {}, {}, 1};
    }
};

double cut_area(const CutMesh& m) {
    double area = 0;
    for (uint32_t t = 0; t < m.triangles; ++t) {
        const Triangle& c = m.triangle[t];
        area += 0.5 * (m.rest[c[1]] - m.rest[c[0]]).cross(m.rest[c[2]] - m.rest[c[0]]).norm();
    }
    return area;
}

// What a flat surface without handles is made of.
struct Census {
    std::string fault;             // not a manifold with consistent orientation
    int64_t euler = 0;             // vertices - edges + triangles
    int64_t pieces = 0, rims = 0;  // connected parts, closed loops of rim edges
    double least_edge = 1e300;     // m, at rest
};

Census take_census(const CutMesh& m) {
    Census census;
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> side;  // directed edge to its triangle
    std::set<uint32_t> used;
    for (uint32_t t = 0; t < m.triangles; ++t) {
        for (int k = 0; k < 3; ++k) {
            const uint32_t a = m.triangle[t][k], b = m.triangle[t][(k + 1) % 3];
            used.insert(a);
            if (a == b || !side.try_emplace({a, b}, t).second) census.fault = "an edge has two triangles on one side";
            census.least_edge = std::min(census.least_edge, (m.rest[a] - m.rest[b]).norm());
        }
    }
    if (used.size() != m.vertices) census.fault = "a vertex without a triangle";
    std::vector<uint32_t> root(m.triangles);
    for (uint32_t t = 0; t < m.triangles; ++t) root[t] = t;
    const auto find = [&](uint32_t t) {
        while (root[t] != t) t = root[t] = root[root[t]];
        return t;
    };
    std::map<uint32_t, uint32_t> next;  // along the rim
    int64_t edges = 0;
    for (const auto& [edge, t] : side) {
        const auto back = side.find({edge.second, edge.first});
        if (back == side.end()) {
            ++edges;
            if (!next.try_emplace(edge.first, edge.second).second) census.fault = "two rims meet at a vertex";
        } else {
            edges += edge.first < edge.second;
            root[find(t)] = find(back->second);
        }
    }
    std::set<uint32_t> roots, seen;
    for (uint32_t t = 0; t < m.triangles; ++t) roots.insert(find(t));
    for (const auto& [start, second] : next) {
        if (seen.count(start) > 0) continue;
        ++census.rims;
        for (uint32_t v = start; seen.insert(v).second;) v = next[v];
    }
    census.pieces = static_cast<int64_t>(roots.size());
    census.euler = static_cast<int64_t>(used.size()) - edges + m.triangles;
    return census;
}

// Ten strokes on a sheet of 12 x 12: straight ones anywhere, through vertices, along edges, in and out at the rim, and
// circles that close, in 1 to 40 steps, with the edge askew.
uint32_t random_strokes(uint64_t seed) {
    std::mt19937_64 any(seed);
    const auto real = [&](double low, double high) { return low + (high - low) * static_cast<double>(any() >> 11) * 0x1p-53; };
    CutSheet sheet(12);
    const double area = cut_area(sheet.mesh);
    std::vector<CutVertex> made;
    uint32_t refused = 0;
    for (int stroke = 0; stroke < 10; ++stroke) {
        sheet.mesh.front.clear();
        Vec3d from(real(-1.5, 13.5), real(-1.5, 11.5), 0), to(real(-1.5, 13.5), real(-1.5, 11.5), 0);
        const uint64_t kind = any() % 5;
        if (kind == 1) from = {std::round(from.x()), 0, 0}, to = {from.x(), 6 * std::sqrt(0.75), 0};
        if (kind == 2) from = {-1, 2 * std::sqrt(0.75), 0}, to = {13, 2 * std::sqrt(0.75), 0};
        const Vec3d centre(real(3, 9), real(3, 8), 0), tilt(real(-0.5, 0.5), real(-0.5, 0.5), 1);
        const double radius = real(1, 3.5);
        const auto at = [&](double t) {
            return kind == 3 ? Vec3d(centre + radius * Vec3d(std::cos(6.5 * t), std::sin(6.5 * t), 0)) : Vec3d(from + t * (to - from));
        };
        const int steps = 1 + static_cast<int>(any() % 40);
        for (int k = 0; k < steps; ++k) {
            const Vec3d p = at(static_cast<double>(k) / steps), q = at((k + 1.0) / steps);
            refused += cut_surface({p - tilt, p + tilt, q - tilt, q + tilt}, sheet.mesh, made).refused;
        }
        const Census census = take_census(sheet.mesh);
        EXPECT_EQ(census.fault, "") << "seed " << seed << ", stroke " << stroke;
        // without handles: 2 for every piece, less its rims
        EXPECT_EQ(census.euler, 2 * census.pieces - census.rims) << "seed " << seed << ", stroke " << stroke;
        EXPECT_GT(census.least_edge, 1e-9);
        EXPECT_NEAR(cut_area(sheet.mesh), area, 1e-12 * area);
        if (testing::Test::HasFailure()) break;
    }
    return refused;
}

TEST(SurfaceCut, RandomStrokesLeaveASurface) {
    uint32_t refused = 0;
    for (uint64_t seed = 0; seed < 30 && !HasFailure(); ++seed) refused += random_strokes(seed);
    EXPECT_EQ(refused, 0u);
}

TEST(SurfaceCut, LongTenThousandRandomStrokes) {
    uint32_t refused = 0;
    for (uint64_t seed = 0; seed < 1000 && !HasFailure(); ++seed) refused += random_strokes(seed);
    EXPECT_EQ(refused, 0u);
}

// One stroke from rim to rim makes two pieces; its rim follows the path to kSnap of an edge; its length is that of the
// path, but for the snapping. A slit inside opens one rim more, and is closed at both of its tips.
TEST(SurfaceCut, AStrokeFromRimToRimMakesTwo) {
    CutSheet sheet(12);
    std::vector<CutVertex> made;
    double length = 0;
    const Vec3d up(0, 0, 1), path(6.3, 0, 0), way(0, 1, 0);
    for (int k = 0; k < 60; ++k) {
        const Vec3d p = path + (0.2 * k - 0.7) * way, q = path + (0.2 * k - 0.5) * way;
        length += cut_surface({p - up, p + up, q - up, q + up}, sheet.mesh, made).length;
    }
    const Census census = take_census(sheet.mesh);
    EXPECT_EQ(census.fault, "");
    EXPECT_EQ(census.pieces, 2);
    EXPECT_EQ(census.rims, 2);
    EXPECT_TRUE(sheet.mesh.slit.empty());
    const double height = 12 * std::sqrt(0.75);
    EXPECT_NEAR(length, height, 0.05 * height);
    double off = 0;
    for (uint32_t v = 169; v < sheet.mesh.vertices; ++v) off = std::max(off, std::abs(sheet.rest[v].x() - 6.3));
    EXPECT_LE(off, kSnap);
}

TEST(SurfaceCut, ASlitIsClosedAtItsTips) {
    CutSheet sheet(12);
    std::vector<CutVertex> made;
    const Vec3d up(0, 0, 1);
    for (int k = 0; k < 20; ++k) {
        const Vec3d p(3.1 + 0.2 * k, 5.03, 0), q(3.3 + 0.2 * k, 5.03, 0);
        cut_surface({p - up, p + up, q - up, q + up}, sheet.mesh, made);
    }
    const Census census = take_census(sheet.mesh);
    EXPECT_EQ(census.fault, "");
    EXPECT_EQ(census.pieces, 1);
    EXPECT_EQ(census.rims, 2) << "the sheet's and the slit's";
    EXPECT_EQ(sheet.mesh.front.size(), 1u);
}

// Without room nothing changes, and it says so.
TEST(SurfaceCut, WithoutRoomNothingChanges) {
    CutSheet sheet(12, 300);
    std::vector<CutVertex> made;
    const std::vector<Triangle> before = sheet.triangle;
    const Vec3d up(0, 0, 1), p(6.3, -1, 0), q(6.3, 12, 0);
    const CutResult result = cut_surface({p - up, p + up, q - up, q + up}, sheet.mesh, made);
    EXPECT_TRUE(result.refused);
    EXPECT_EQ(result.length, 0);
    EXPECT_EQ(sheet.mesh.vertices, 169u);
    EXPECT_EQ(sheet.mesh.triangles, 288u);
    EXPECT_EQ(sheet.triangle, before);
}

}  // namespace
}  // namespace trocar
