#include "content/mend/hole_filling.hpp"

#include <Eigen/Geometry>
#include <algorithm>

#include "content/mend/mesh_box.hpp"
#include "engine/geometry/edge_table.hpp"
namespace trocar {
namespace {

// Half-edges without a face on the other side, indexed by their end vertex.
std::vector<uint32_t> rim_half_edges(const Mesh& mesh, const EdgeTable& table) {
    std::vector<uint32_t> ends_at(mesh.position.size(), kNone);
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        if (users.size() != 1) continue;
        const uint32_t h = users[0];
        ends_at[mesh.triangle[h / 3][(h + 1) % 3]] = h;
    }
    return ends_at;
}

std::vector<std::vector<uint32_t>> trace_rims(const Mesh& mesh, const std::vector<uint32_t>& ends_at) {
    std::vector<std::vector<uint32_t>> rims;
    std::vector<uint8_t> seen(mesh.position.size(), 0);
    for (uint32_t start = 0; start < ends_at.size(); ++start) {
        if (ends_at[start] == kNone || seen[start]) continue;
        std::vector<uint32_t> rim;
        uint32_t v = start;
        while (v != kNone && !seen[v] && ends_at[v] != kNone) {
            seen[v] = 1;
            rim.push_back(v);
            v = half_edge_start(mesh.triangle, ends_at[v]);
        }
        // otherwise it ran into a vertex with several fans
        if (v == start) rims.push_back(std::move(rim));
    }
    return rims;
}

struct Weight {
    double bend = 1e300;  // largest 1 - cosine of the angle between neighbouring normals
    double area = 1e300;
    bool operator<(const Weight& o) const { return bend < o.bend || (bend == o.bend && area < o.area); }
};

// A rim being triangulated. Vertices i to k bound a part; the face at edge i-k has its third corner at
// `apex`.
struct Span {
    const Mesh& mesh;
    const EdgeTable& table;
    const std::vector<uint32_t>& rim;
    std::vector<Vec3d> outer_normal;  // normal of the face beyond the rim edge i, i + 1
    std::vector<Weight> weight;       // [i * n + k]
    std::vector<uint32_t> apex;

    size_t at(uint32_t i, uint32_t k) const { return size_t{i} * rim.size() + k; }
    Vec3d normal(uint32_t i, uint32_t m, uint32_t k) const {
        const Vec3d &a = mesh.position[rim[i]], &b = mesh.position[rim[m]], &c = mesh.position[rim[k]];
        return (b - a).cross(c - a);
    }
    bool is_edge(uint32_t i, uint32_t k) const {
        const auto [low, high] = std::minmax(rim[i], rim[k]);
        return std::binary_search(table.edge.begin(), table.edge.end(), std::array<uint32_t, 2>{low, high});
    }
};

double bend_between(const Vec3d& unit, const Vec3d& other) {
    const double length = other.norm();
    return length > 0 ? 1 - unit.dot(other) / length : 2;
}

Weight weigh(const Span& s, uint32_t i, uint32_t m, uint32_t k) {
    const Vec3d normal = s.normal(i, m, k);
    const double length = normal.norm();
    Weight w;
    if (!(length > 0)) return w;
    const Vec3d unit = normal / length;
    w.bend = 0;
    w.area = 0.5 * length;
    for (const auto& [from, to] : {std::pair{i, m}, {m, k}}) {
        const Weight& part = s.weight[s.at(from, to)];
        const bool rim_edge = to == from + 1;
        const Vec3d beyond = rim_edge ? s.outer_normal[from] : s.normal(from, s.apex[s.at(from, to)], to);
        w.bend = std::max({w.bend, part.bend, bend_between(unit, beyond)});
        w.area += part.area;
    }
    // the last rim edge closes the polygon
    if (i == 0 && k + 1 == s.rim.size()) w.bend = std::max(w.bend, bend_between(unit, s.outer_normal[k]));
    return w;
}

bool span_rim(Span& s, std::vector<Triangle>& added) {
    const uint32_t n = static_cast<uint32_t>(s.rim.size());
    s.weight.assign(size_t{n} * n, {});
    s.apex.assign(size_t{n} * n, kNone);
    for (uint32_t i = 0; i + 1 < n; ++i) s.weight[s.at(i, i + 1)] = {0, 0};
    for (uint32_t gap = 2; gap < n; ++gap) {
        for (uint32_t i = 0; i + gap < n; ++i) {
            const uint32_t k = i + gap;
            const bool whole = gap + 1 == n;
            if (!whole && s.is_edge(i, k)) continue;  // the edge would get a third face
            Weight& best = s.weight[s.at(i, k)];
            for (uint32_t m = i + 1; m < k; ++m) {
                if (s.weight[s.at(i, m)].bend > 2 || s.weight[s.at(m, k)].bend > 2) continue;
                const Weight w = weigh(s, i, m, k);
                if (!(w < best)) continue;
                best = w;
                s.apex[s.at(i, k)] = m;
            }
        }
    }
    if (s.apex[s.at(0, n - 1)] == kNone) return false;
    std::vector<std::array<uint32_t, 2>> open{{0, n - 1}};
    while (!open.empty()) {
        const auto [i, k] = open.back();
        open.pop_back();
        if (k == i + 1) continue;
        const uint32_t m = s.apex[s.at(i, k)];
        added.push_back({s.rim[i], s.rim[m], s.rim[k]});
        open.push_back({m, k});
        open.push_back({i, m});
    }
    return true;
}

void add_faces(Mesh& mesh, const std::vector<Triangle>& added, const std::vector<uint32_t>& ends_at) {
    for (const Triangle& t : added) {
        mesh.triangle.push_back(t);
        if (!mesh.triangle_material.empty()) mesh.triangle_material.push_back(mesh.triangle_material[ends_at[t[0]] / 3]);
        if (mesh.uv.empty()) continue;
        std::array<Vec2, 3> row;
        for (size_t k = 0; k < 3; ++k) row[k] = mesh.uv[ends_at[t[k]] / 3][(ends_at[t[k]] + 1) % 3];
        mesh.uv.push_back(row);
    }
}

double diagonal_of(const Mesh& mesh, const std::vector<uint32_t>& rim) {
    Box box;
    for (const uint32_t v : rim) grow(box, mesh.position[v]);
    return (box.max - box.min).norm();
}

}  // namespace

HoleReport fill_holes(Mesh& mesh, const HoleLimits& limits) {
    HoleReport report;
    const Box box = box_of_points(mesh.position);
    if (mesh.triangle.empty()) return report;
    const double most = limits.diagonal * (box.max - box.min).norm();
    const EdgeTable table = make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size()));
    const std::vector<uint32_t> ends_at = rim_half_edges(mesh, table);
    std::vector<Triangle> added;
    for (const std::vector<uint32_t>& rim : trace_rims(mesh, ends_at)) {
        const double diagonal = diagonal_of(mesh, rim);
        const size_t before = added.size();
        bool filled = rim.size() >= 3 && rim.size() <= limits.edges && diagonal <= most;
        if (filled) {
            Span span{mesh, table, rim, {}, {}, {}};
            for (size_t i = 0; i < rim.size(); ++i) {
                const Triangle& t = mesh.triangle[ends_at[rim[i]] / 3];
                span.outer_normal.push_back((mesh.position[t[1]] - mesh.position[t[0]]).cross(mesh.position[t[2]] - mesh.position[t[0]]));
            }
            filled = span_rim(span, added);
        }
        if (filled) {
            ++report.filled;
            report.faces_added += static_cast<uint32_t>(added.size() - before);
        } else {
            ++report.left;
            report.largest_edges = std::max(report.largest_edges, static_cast<uint32_t>(rim.size()));
            report.largest_diagonal = std::max(report.largest_diagonal, diagonal);
        }
    }
    add_faces(mesh, added, ends_at);
    return report;
}

}  // namespace trocar
