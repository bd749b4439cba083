#pragma once
#include <string>

#include "tests/engine/distance/closest_point_meshes.hpp"
namespace trocar {

// Closed surfaces on which sign computations are error-prone.
struct HardSurface {
    std::string name;
    TestMesh mesh;
};

// Radial spikes of random height on every third vertex: acute fans and edges between faces of very unequal size.
inline TestMesh make_spiky(int n, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    return make_icosphere(n).moved([&](const Vec3d& p) {
        const double height = unit(random);
        return Vec3d((1 + (random() % 3 == 0 ? 2 * height * height : 0.0)) * p);
    });
}

// A block with slots of width 1e-3 to 1e-7: its walls are slivers, separated by thin gaps.
inline TestMesh make_comb() {
    std::vector<std::array<double, 2>> p{{0, 0}, {1, 0}, {1, 1}};
    double x = 0.9;
    for (const double w : {1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-4, 1e-7, 1e-3}) {
        p.push_back({x, 1 + 0.1 * x * x});
        p.push_back({x - w, 1 + 0.1 * (x - w) * (x - w)});
        x -= 0.1;
    }
    p.push_back({0, 1});
    return make_prism(p, {0.5, 0.4});
}

inline std::vector<HardSurface> hard_surfaces() {
    const TestMesh small = make_organ(8);
    return {{"organ", make_organ(16)},
            {"spikes", make_spiky(8, 7)},
            {"slivers", make_comb()},
            {"flattened 1:2000", small.moved([](const Vec3d& x) { return Vec3d(x.x(), x.y(), 5e-4 * x.z()); })},
            {"needle 1:1000", small.moved([](const Vec3d& x) { return Vec3d(x.x(), 1e-3 * x.y(), 1e-3 * x.z()); })},
            {"sheets 1e-7 apart", small.moved([](const Vec3d& x) { return Vec3d(x.x(), x.y(), 2e-7 * x.z()); })}};
}

// The surface `away` diagonals from the origin, its coordinates rounded there, and `count` points around it:
// a third each near its faces, in its box, and 1e-2 to 1e-7 diagonals from its vertices and edges.
struct PlacedSurface {
    TestMesh mesh;
    std::vector<Vec3d> point;
};
inline PlacedSurface place_surface(const TestMesh& mesh, double away, uint32_t count, uint64_t seed) {
    const Vec3d shift = away * mesh.diagonal() * Vec3d(0.6, -0.64, 0.48);
    PlacedSurface placed{mesh.moved([&](const Vec3d& x) -> Vec3d { return x + shift; }), {}};
    placed.point = points_near(mesh, count / 3, 0.01 * mesh.diagonal(), seed);
    for (const Vec3d& p : points_in_box(mesh, count / 3, seed + 1)) placed.point.push_back(p);
    for (const Vec3d& p : points_at_edges(mesh, count - 2 * (count / 3), seed + 2)) placed.point.push_back(p);
    for (Vec3d& p : placed.point) p += shift;
    return placed;
}

}  // namespace trocar
