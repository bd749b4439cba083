#pragma once
#include <cmath>
#include <map>
#include <random>
#include <utility>

#include "components/mesh.hpp"
namespace trocar::reference {

// Small shapes with known properties, oriented outward, welded.

inline Mesh make_tetrahedron(const Vec3d& corner = Vec3d::Zero(), double size = 1) {
    Mesh m;
    m.position = {corner, corner + Vec3d(size, 0, 0), corner + Vec3d(0, size, 0), corner + Vec3d(0, 0, size)};
    m.triangle = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    return m;
}

inline Mesh make_box(const Vec3d& low, const Vec3d& high) {
    Mesh m;
    for (int i = 0; i < 8; ++i) {
        m.position.push_back(Vec3d(i & 1 ? high.x() : low.x(), i & 2 ? high.y() : low.y(), i & 4 ? high.z() : low.z()));
    }
    m.triangle = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                  {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
    return m;
}

// Octahedron subdivided `level` times, every vertex on the sphere: 4^level * 8 triangles.
inline Mesh make_sphere(const Vec3d& centre, double radius, int level) {
    Mesh m;
    m.position = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    m.triangle = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    for (int i = 0; i < level; ++i) {
        std::map<std::pair<uint32_t, uint32_t>, uint32_t> middle;
        const auto split = [&](uint32_t a, uint32_t b) {
            const auto [it, made] = middle.try_emplace(std::minmax(a, b), static_cast<uint32_t>(m.position.size()));
            if (made) m.position.push_back((m.position[a] + m.position[b]).normalized());
            return it->second;
        };
        std::vector<Triangle> finer;
        for (const auto& [a, b, c] : m.triangle) {
            const uint32_t ab = split(a, b), bc = split(b, c), ca = split(c, a);
            finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
        }
        m.triangle = std::move(finer);
    }
    for (Vec3d& p : m.position) p = centre + radius * p;
    return m;
}

// Flat grid of n x n squares over [0, 1]^2, normals up.
inline Mesh make_sheet(uint32_t n) {
    Mesh m;
    for (uint32_t y = 0; y <= n; ++y) {
        for (uint32_t x = 0; x <= n; ++x) m.position.push_back(Vec3d(double(x) / n, double(y) / n, 0));
    }
    for (uint32_t y = 0; y < n; ++y) {
        for (uint32_t x = 0; x < n; ++x) {
            const uint32_t a = y * (n + 1) + x;
            m.triangle.push_back({a, a + 1, a + n + 2});
            m.triangle.push_back({a, a + n + 2, a + n + 1});
        }
    }
    return m;
}

// Band of n quads with half a twist: not orientable.
inline Mesh make_moebius(uint32_t n) {
    Mesh m;
    for (uint32_t i = 0; i < n; ++i) {
        const double u = 2 * M_PI * i / n;
        for (const double w : {-0.3, 0.3}) {
            const double r = 1 + w * std::cos(u / 2);
            m.position.push_back(Vec3d(r * std::cos(u), r * std::sin(u), w * std::sin(u / 2)));
        }
    }
    for (uint32_t i = 0; i < n; ++i) {
        const uint32_t a = 2 * i, b = 2 * i + 1;
        const uint32_t c = i + 1 < n ? 2 * i + 2 : 1, d = i + 1 < n ? 2 * i + 3 : 0;
        m.triangle.push_back({a, c, b});
        m.triangle.push_back({b, c, d});
    }
    return m;
}

inline void append(Mesh& to, const Mesh& from) {
    const uint32_t first = static_cast<uint32_t>(to.position.size());
    to.position.insert(to.position.end(), from.position.begin(), from.position.end());
    for (const auto& [a, b, c] : from.triangle) to.triangle.push_back({a + first, b + first, c + first});
}

inline void turn_inside_out(Mesh& m) {
    for (Triangle& t : m.triangle) std::swap(t[1], t[2]);
}

// Three separate vertices for every triangle, as in an STL file.
inline Mesh make_soup(const Mesh& m) {
    Mesh soup;
    for (const Triangle& t : m.triangle) {
        const uint32_t first = static_cast<uint32_t>(soup.position.size());
        for (const uint32_t v : t) soup.position.push_back(m.position[v]);
        soup.triangle.push_back({first, first + 1, first + 2});
    }
    return soup;
}

inline void shuffle(Mesh& m, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::vector<uint32_t> to(m.position.size());
    for (uint32_t i = 0; i < to.size(); ++i) to[i] = i;
    for (size_t i = to.size(); i > 1; --i) std::swap(to[i - 1], to[random() % i]);
    std::vector<Vec3d> moved(m.position.size());
    for (size_t i = 0; i < to.size(); ++i) moved[to[i]] = m.position[i];
    m.position = std::move(moved);
    for (Triangle& t : m.triangle) t = {to[t[0]], to[t[1]], to[t[2]]};
    for (size_t i = m.triangle.size(); i > 1; --i) std::swap(m.triangle[i - 1], m.triangle[random() % i]);
}

}  // namespace trocar::reference
