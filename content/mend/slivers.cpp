#include "content/mend/slivers.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "content/mend/clean_mesh.hpp"
#include "engine/geometry/edge_table.hpp"
namespace trocar {
namespace {

constexpr int kRounds = 20;

struct FaceShape {
    double longest = 0, shortest = 0, height = 0;  // height over the longest edge
    uint32_t long_edge = 0, short_edge = 0;        // corner at which the edge starts
};

FaceShape shape_of(const Mesh& mesh, const Triangle& t) {
    FaceShape s;
    const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
    const std::array<double, 3> length{(b - a).norm(), (c - b).norm(), (a - c).norm()};
    for (uint32_t k = 0; k < 3; ++k) {
        if (length[k] > length[s.long_edge]) s.long_edge = k;
        if (length[k] < length[s.short_edge]) s.short_edge = k;
    }
    s.longest = length[s.long_edge];
    s.shortest = length[s.short_edge];
    s.height = s.longest > 0 ? (b - a).cross(c - a).norm() / s.longest : 0;
    return s;
}

bool is_sliver(const FaceShape& s, double height) { return !(s.height > height * s.longest); }

// One pass over the faces with its tables; faces near a change wait for the next pass.
struct Pass {
    Mesh& mesh;
    EdgeTable table;
    std::vector<uint32_t> opposite;             // half-edge -> its opposite, kNone at a boundary
    std::vector<std::vector<uint32_t>> around;  // vertex -> faces
    std::vector<uint8_t> touched;               // faces
    std::vector<uint8_t> dropped;

    explicit Pass(Mesh& m)
        : mesh(m),
          table(make_edge_table(m.triangle, static_cast<uint32_t>(m.position.size()))),
          opposite(3 * m.triangle.size(), kNone),
          around(m.position.size()),
          touched(m.triangle.size(), 0),
          dropped(m.triangle.size(), 0) {
        for (uint32_t e = 0; e < table.edge.size(); ++e) {
            const auto users = table.users(e);
            if (users.size() != 2) continue;
            opposite[users[0]] = users[1];
            opposite[users[1]] = users[0];
        }
        for (uint32_t t = 0; t < m.triangle.size(); ++t) {
            for (const uint32_t v : m.triangle[t]) around[v].push_back(t);
        }
    }
    bool is_free(uint32_t v) const {
        return std::none_of(around[v].begin(), around[v].end(), [&](uint32_t t) { return touched[t]; });
    }
    void touch(uint32_t v) {
        for (const uint32_t t : around[v]) touched[t] = 1;
    }
    std::vector<uint32_t> neighbours(uint32_t v) const {
        std::vector<uint32_t> ring;
        for (const uint32_t t : around[v]) {
            for (const uint32_t u : mesh.triangle[t]) {
                if (u != v) ring.push_back(u);
            }
        }
        std::sort(ring.begin(), ring.end());
        ring.erase(std::unique(ring.begin(), ring.end()), ring.end());
        return ring;
    }
};

bool try_collapse(Pass& p, uint32_t t, uint32_t k) {
    const uint32_t other = p.opposite[3 * t + k];
    if (other == kNone) return false;
    const uint32_t keep = p.mesh.triangle[t][k], gone = p.mesh.triangle[t][(k + 1) % 3];
    if (!p.is_free(keep) || !p.is_free(gone)) return false;
    const std::vector<uint32_t> a = p.neighbours(keep), b = p.neighbours(gone);
    std::vector<uint32_t> common;
    std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(common));
    // link condition: the only common neighbours are the two faces' other corners; a tetrahedron stays
    if (common.size() != 2 || a.size() + b.size() < 7) return false;
    for (const uint32_t v : {keep, gone}) {
        for (const uint32_t f : p.around[v]) {
            for (uint32_t h = 3 * f; h < 3 * f + 3; ++h) {
                if (p.opposite[h] == kNone) return false;  // not at a boundary edge
            }
        }
    }
    p.touch(keep);
    p.touch(gone);
    p.dropped[t] = p.dropped[other / 3] = 1;
    for (const uint32_t f : p.around[gone]) {
        for (uint32_t& v : p.mesh.triangle[f]) v = v == gone ? keep : v;
    }
    return true;
}

bool try_flip(Pass& p, uint32_t t, uint32_t k, double height) {
    const uint32_t other = p.opposite[3 * t + k];
    if (other == kNone || p.touched[t] || p.touched[other / 3]) return false;
    const uint32_t n = other / 3, j = other % 3;
    Triangle& face = p.mesh.triangle[t];
    Triangle& next = p.mesh.triangle[n];
    const uint32_t a = face[k], b = face[(k + 1) % 3], c = face[(k + 2) % 3], d = next[(j + 2) % 3];
    if (next[j] != b || c == d) return false;
    const auto [low, high] = std::minmax(c, d);
    if (std::binary_search(p.table.edge.begin(), p.table.edge.end(), std::array<uint32_t, 2>{low, high})) return false;
    const Triangle first{a, d, c}, second{d, b, c};
    const auto relative = [&](const Triangle& x) {
        const FaceShape s = shape_of(p.mesh, x);
        return s.longest > 0 ? s.height / s.longest : 0;
    };
    // require an improvement, so that flips do not cycle
    const double now = std::min(relative(face), relative(next));
    if (!(std::min(relative(first), relative(second)) > std::max(2 * now, 0.1 * height))) return false;
    for (const uint32_t v : {c, d}) {
        if (!p.is_free(v)) return false;
    }
    if (!p.mesh.uv.empty()) {
        const auto uv_face = p.mesh.uv[t], uv_next = p.mesh.uv[n];
        const Vec2 ua = uv_face[k], ub = uv_face[(k + 1) % 3], uc = uv_face[(k + 2) % 3], ud = uv_next[(j + 2) % 3];
        p.mesh.uv[t] = {ua, ud, uc};
        p.mesh.uv[n] = {ud, ub, uc};
    }
    face = first;
    next = second;
    for (const uint32_t v : {a, b, c, d}) p.touch(v);
    return true;
}

}  // namespace

SliverReport remove_slivers(Mesh& mesh, double height) {
    SliverReport report;
    for (int round = 0; round < kRounds; ++round) {
        Pass pass(mesh);
        report.left = 0;
        bool changed = false;
        for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
            const FaceShape s = shape_of(mesh, mesh.triangle[t]);
            if (!is_sliver(s, height)) continue;
            ++report.left;
            if (pass.touched[t]) {
                changed = true;  // needs another pass
            } else if (s.shortest <= 2 * height * s.longest && try_collapse(pass, t, s.short_edge)) {
                ++report.collapsed;
                changed = true;
            } else if (try_flip(pass, t, s.long_edge, height)) {
                ++report.flipped;
                changed = true;
            }
        }
        drop_faces(mesh, pass.dropped);
        if (!changed) break;
    }
    return report;
}

}  // namespace trocar
