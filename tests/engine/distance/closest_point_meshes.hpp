#pragma once
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// A mesh with the topology required by a closest-point tree, for tests and benches.
struct TestMesh {
    MeshInfo info;
    std::vector<Vec3d> position;
    std::vector<Triangle> triangle;
    std::vector<std::array<uint32_t, 3>> neighbour;
    std::vector<uint32_t> incident_first, incident;

    TestMesh(std::vector<Vec3d> points, std::vector<Triangle> faces, Admission admission = Admission::kSolid)
        : position(std::move(points)), triangle(std::move(faces)) {
        info.admission = admission;
        neighbour.assign(triangle.size(), {kNone, kNone, kNone});
        std::map<std::array<uint32_t, 2>, std::array<uint32_t, 2>> half;  // directed edge -> triangle, corner
        for (uint32_t t = 0; t < triangle.size(); ++t)
            for (uint32_t k = 0; k < 3; ++k) half[{triangle[t][k], triangle[t][(k + 1) % 3]}] = {t, k};
        for (const auto& [edge, slot] : half) {
            const auto other = half.find({edge[1], edge[0]});
            if (other != half.end()) neighbour[slot[0]][slot[1]] = other->second[0];
        }
        incident_first.assign(position.size() + 1, 0);
        for (const Triangle& t : triangle)
            for (const uint32_t v : t) ++incident_first[v + 1];
        for (size_t v = 0; v < position.size(); ++v) incident_first[v + 1] += incident_first[v];
        incident.resize(3 * triangle.size());
        std::vector<uint32_t> next(incident_first.begin(), incident_first.end() - 1);
        for (uint32_t t = 0; t < triangle.size(); ++t)
            for (const uint32_t v : triangle[t]) incident[next[v]++] = t;
    }
    MeshView view() const {
        MeshView v;
        v.info = &info;
        v.position = position;
        v.triangle = triangle;
        v.neighbour = neighbour;
        v.incident_first = incident_first;
        v.incident = incident;
        return v;
    }
    std::vector<Float4> offsets() const {
        std::vector<Float4> o;
        for (const Vec3d& x : position)
            o.push_back({static_cast<float>(x.x()), static_cast<float>(x.y()), static_cast<float>(x.z()), 1.0f});
        return o;
    }
    double diagonal() const {
        Vec3d low = Vec3d::Constant(INFINITY), high = -low;
        for (const Vec3d& x : position) low = low.cwiseMin(x), high = high.cwiseMax(x);
        return (high - low).norm();
    }
    template <typename Map>  // Map: Vec3d(Vec3d)
    TestMesh moved(const Map& map) const {
        TestMesh m = *this;
        for (Vec3d& x : m.position) x = map(x);
        return m;
    }
};

// Unit icosphere, every face of the icosahedron cut into n * n: 20 n^2 triangles.
inline TestMesh make_icosphere(int n) {
    const double g = 0.5 * (1 + std::sqrt(5.0));
    const Vec3d corner[12] = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                              {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    const int face[20][3] = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                             {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                             {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    std::vector<Vec3d> position;
    std::vector<Triangle> triangle;
    std::map<std::array<int64_t, 3>, uint32_t> known;
    const auto add = [&](const Vec3d& x) {
        const Vec3d p = x / x.norm();
        const std::array<int64_t, 3> key{std::llround(p.x() * 1e8), std::llround(p.y() * 1e8), std::llround(p.z() * 1e8)};
        const auto [slot, fresh] = known.insert({key, static_cast<uint32_t>(position.size())});
        if (fresh) position.push_back(p);
        return slot->second;
    };
    for (const auto& f : face) {
        std::vector<std::vector<uint32_t>> row(n + 1);
        for (int i = 0; i <= n; ++i)
            for (int j = 0; j <= n - i; ++j) row[i].push_back(add((n - i - j) * corner[f[0]] + i * corner[f[1]] + j * corner[f[2]]));
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < n - i; ++j) {
                triangle.push_back({row[i][j], row[i + 1][j], row[i][j + 1]});
                if (i + j < n - 1) triangle.push_back({row[i + 1][j], row[i + 1][j + 1], row[i][j + 1]});
            }
    }
    return TestMesh(std::move(position), std::move(triangle));
}

// Icosphere displaced into an uneven organ about 2 x 1.4 x 1 m.
inline TestMesh make_organ(int n) {
    return make_icosphere(n).moved([](const Vec3d& p) {
        const double r = 1 + 0.10 * std::sin(3.1 * p.x() + 1.3 * p.y()) + 0.07 * std::sin(5.3 * p.y() - 2.2 * p.z()) +
                         0.05 * std::sin(7.7 * p.z() + 3.9 * p.x() * p.y()) +
                         0.02 * std::sin(17 * p.x() + 11 * p.z()) * std::cos(13 * p.y());
        return Vec3d(r * p.x(), 0.7 * r * p.y(), 0.5 * r * p.z());
    });
}

// Closed prism over a polygon given counter-clockwise in the x-y plane, between z = 0 and 1, caps fanned
// about `middle`. Its sides are as narrow as the polygon's edges: the slivers' aspect ratios are the edge
// lengths.
inline TestMesh make_prism(const std::vector<std::array<double, 2>>& polygon, std::array<double, 2> middle) {
    const uint32_t n = static_cast<uint32_t>(polygon.size());
    std::vector<Vec3d> position;
    std::vector<Triangle> triangle;
    for (const double z : {0.0, 1.0}) {
        for (const auto& p : polygon) position.push_back({p[0], p[1], z});
        position.push_back({middle[0], middle[1], z});
    }
    for (uint32_t i = 0; i < n; ++i) {
        const uint32_t j = (i + 1) % n, up = n + 1;
        triangle.push_back({i, j, j + up});
        triangle.push_back({i, j + up, i + up});
        triangle.push_back({n, j, i});
        triangle.push_back({n + up, i + up, j + up});
    }
    return TestMesh(std::move(position), std::move(triangle));
}

// Unit cube [0, 1]^3 of 12 triangles.
inline TestMesh make_cube() {
    std::vector<Vec3d> position;
    for (int i = 0; i < 8; ++i) position.push_back({double(i & 1), double(i >> 1 & 1), double(i >> 2)});
    return TestMesh(std::move(position), {{0, 2, 3},
                                          {0, 3, 1},
                                          {4, 5, 7},
                                          {4, 7, 6},
                                          {0, 1, 5},
                                          {0, 5, 4},
                                          {2, 6, 7},
                                          {2, 7, 3},
                                          {0, 4, 6},
                                          {0, 6, 2},
                                          {1, 3, 7},
                                          {1, 7, 5}});
}

inline Vec3d random_direction(std::mt19937_64& random) {
    std::normal_distribution<double> normal;
    for (;;) {
        const Vec3d d(normal(random), normal(random), normal(random));
        if (d.norm() > 1e-3) return d / d.norm();
    }
}

// Points on random triangles, moved by up to `reach` along the normal, in both directions.
inline std::vector<Vec3d> points_near(const TestMesh& mesh, uint32_t count, double reach, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Vec3d> points;
    while (points.size() < count) {
        const Triangle& t = mesh.triangle[random() % mesh.triangle.size()];
        double u = unit(random), v = unit(random);
        if (u + v > 1) u = 1 - u, v = 1 - v;
        const Vec3d a = mesh.position[t[0]], e = mesh.position[t[1]] - a, f = mesh.position[t[2]] - a;
        const Vec3d n(e.y() * f.z() - e.z() * f.y(), e.z() * f.x() - e.x() * f.z(), e.x() * f.y() - e.y() * f.x());
        points.push_back(a + u * e + v * f + reach * (2 * unit(random) - 1) / std::max(n.norm(), 1e-300) * n);
    }
    return points;
}

// Points uniform in the bounding box grown by a tenth on every side.
inline std::vector<Vec3d> points_in_box(const TestMesh& mesh, uint32_t count, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(-0.1, 1.1);
    Vec3d low = Vec3d::Constant(INFINITY), high = -low;
    for (const Vec3d& x : mesh.position) low = low.cwiseMin(x), high = high.cwiseMax(x);
    std::vector<Vec3d> points;
    while (points.size() < count) {
        const Vec3d s(unit(random), unit(random), unit(random));
        points.push_back(low + (high - low).cwiseProduct(s));
    }
    return points;
}

// Points 1e-2 to 1e-7 diagonals away from vertices and points of edges, in any direction.
inline std::vector<Vec3d> points_at_edges(const TestMesh& mesh, uint32_t count, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    const double diagonal = mesh.diagonal();
    std::vector<Vec3d> points;
    while (points.size() < count) {
        const Triangle& t = mesh.triangle[random() % mesh.triangle.size()];
        const uint32_t k = random() % 3;
        const double along = random() % 2 ? 0.0 : unit(random);
        const Vec3d on = mesh.position[t[k]] + along * (mesh.position[t[(k + 1) % 3]] - mesh.position[t[k]]);
        points.push_back(on + diagonal * std::pow(10.0, -2 - 5 * unit(random)) * random_direction(random));
    }
    return points;
}

}  // namespace trocar
