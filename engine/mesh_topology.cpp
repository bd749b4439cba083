#include "engine/mesh_topology.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "engine/check.hpp"
#include "engine/geometry/space_curve.hpp"
#include "engine/mesh_view.hpp"
namespace trocar {
namespace {

constexpr uint32_t next_corner(uint32_t k) { return k == 2 ? 0 : k + 1; }

Range grow(size_t size, size_t count) {
    TROCAR_ASSERT(size + count < kNone);
    return {static_cast<uint32_t>(size), static_cast<uint32_t>(count)};
}

// Half-edges 3 * triangle + corner, grouped by undirected edge, groups ascending by (lower vertex, higher vertex).
struct SortedHalfEdges {
    std::vector<uint32_t> first;   // vertex -> rows of the edges it is the lower end of
    std::vector<uint64_t> packed;  // higher vertex << 32 | half-edge
};

// Counting sort on the lower end, then a tiny sort a vertex: linear for every mesh of bounded degree.
SortedHalfEdges sort_half_edges(const Mesh& mesh) {
    SortedHalfEdges sorted;
    sorted.first.assign(mesh.position.size() + 1, 0);
    sorted.packed.resize(3 * mesh.triangle.size());
    const auto each = [&](auto&& visit) {
        for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
            for (uint32_t k = 0; k < 3; ++k) {
                const uint32_t a = mesh.triangle[t][k], b = mesh.triangle[t][next_corner(k)];
                visit(std::min(a, b), uint64_t{std::max(a, b)} << 32 | (3 * t + k));
            }
        }
    };
    each([&](uint32_t lower, uint64_t) { ++sorted.first[lower + 1]; });
    std::partial_sum(sorted.first.begin(), sorted.first.end(), sorted.first.begin());
    std::vector<uint32_t> fill(sorted.first.begin(), sorted.first.end() - 1);
    each([&](uint32_t lower, uint64_t packed) { sorted.packed[fill[lower]++] = packed; });
    for (size_t v = 0; v + 1 < sorted.first.size(); ++v) {
        std::sort(sorted.packed.begin() + sorted.first[v], sorted.packed.begin() + sorted.first[v + 1]);
    }
    return sorted;
}

uint32_t find_root(std::vector<uint32_t>& parent, uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

// Appends edge, edge_triangle, neighbour and triangle_edge; returns, per triangle, the lowest triangle of its piece.
std::vector<uint32_t> append_edges(Meshes& meshes, const Mesh& mesh, MeshInfo& info) {
    const SortedHalfEdges sorted = sort_half_edges(mesh);
    const size_t first_edge = meshes.edge.size();
    const size_t triangles = mesh.triangle.size();
    meshes.neighbour.resize(info.triangles.first + triangles, {kNone, kNone, kNone});
    meshes.triangle_edge.resize(info.triangles.first + triangles, {kNone, kNone, kNone});
    auto* neighbour = meshes.neighbour.data() + info.triangles.first;
    auto* triangle_edge = meshes.triangle_edge.data() + info.triangles.first;
    std::vector<uint32_t> piece(triangles);
    std::iota(piece.begin(), piece.end(), 0u);
    for (uint32_t lower = 0; lower < mesh.position.size(); ++lower) {
        for (uint32_t i = sorted.first[lower], j; i < sorted.first[lower + 1]; i = j) {
            const uint64_t higher = sorted.packed[i] >> 32;
            for (j = i; j < sorted.first[lower + 1] && sorted.packed[j] >> 32 == higher; ++j) {
            }
            const auto half_edge = [&](uint32_t row) { return static_cast<uint32_t>(sorted.packed[row]); };
            const uint32_t first = half_edge(i);
            for (uint32_t row = i; row < j; ++row) {
                triangle_edge[half_edge(row) / 3][half_edge(row) % 3] =
                    static_cast<uint32_t>(meshes.edge.size() - first_edge);
                const uint32_t a = find_root(piece, first / 3), b = find_root(piece, half_edge(row) / 3);
                piece[std::max(a, b)] = std::min(a, b);
            }
            if (j - i == 2) {
                const uint32_t second = half_edge(i + 1);
                neighbour[first / 3][first % 3] = second / 3;
                neighbour[second / 3][second % 3] = first / 3;
            }
            meshes.edge.push_back({lower, static_cast<uint32_t>(higher)});
            meshes.edge_triangle.push_back({first / 3, j - i > 1 ? half_edge(i + 1) / 3 : kNone});
        }
    }
    info.edges = grow(first_edge, meshes.edge.size() - first_edge);
    for (uint32_t t = 0; t < triangles; ++t) piece[t] = find_root(piece, t);
    return piece;
}

// Pieces are numbered by their lowest triangle; a vertex two pieces share belongs to the lower one, an isolated
// vertex to none.
void append_components(Meshes& meshes, const Mesh& mesh, std::vector<uint32_t> piece, MeshInfo& info) {
    meshes.component.resize(info.vertices.first + mesh.position.size(), kNone);
    uint32_t* component = meshes.component.data() + info.vertices.first;
    for (uint32_t t = 0; t < piece.size(); ++t) {
        // the lowest triangle of a piece comes first, so its slot already holds the piece's number
        piece[t] = piece[t] == t ? info.components++ : piece[piece[t]];
        for (const uint32_t v : mesh.triangle[t]) component[v] = std::min(component[v], piece[t]);
    }
}

void append_incident(Meshes& meshes, const Mesh& mesh, MeshInfo& info) {
    const size_t first_row = meshes.incident_first.size();
    meshes.incident_first.resize(first_row + mesh.position.size() + 1, 0);
    uint32_t* first = meshes.incident_first.data() + first_row;
    for (const Triangle& triangle : mesh.triangle) {
        for (const uint32_t v : triangle) ++first[v + 1];
    }
    for (size_t v = 0; v < mesh.position.size(); ++v) first[v + 1] += first[v];
    info.incident = grow(meshes.incident.size(), 3 * mesh.triangle.size());
    meshes.incident.resize(info.incident.end());
    std::vector<uint32_t> fill(first, first + mesh.position.size());
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        for (const uint32_t v : mesh.triangle[t]) meshes.incident[info.incident.first + fill[v]++] = t;
    }
}

// Corners uv and material of each triangle; a mesh that has none gets zeros and one default material.
void append_looks(Meshes& meshes, const Mesh& mesh, const MeshInfo& info) {
    TROCAR_ASSERT(mesh.uv.empty() || mesh.uv.size() == mesh.triangle.size());
    TROCAR_ASSERT(mesh.triangle_material.empty() || mesh.triangle_material.size() == mesh.triangle.size());
    meshes.uv.insert(meshes.uv.end(), mesh.uv.begin(), mesh.uv.end());
    meshes.uv.resize(info.triangles.end());
    meshes.triangle_material.insert(meshes.triangle_material.end(), mesh.triangle_material.begin(),
                                    mesh.triangle_material.end());
    meshes.triangle_material.resize(info.triangles.end(), 0);
    const size_t first = meshes.material.size();
    meshes.material.insert(meshes.material.end(), mesh.material.begin(), mesh.material.end());
    if (mesh.material.empty()) meshes.material.emplace_back();
    meshes.materials.push_back(grow(first, meshes.material.size() - first));
    for (const uint16_t m : mesh.triangle_material) TROCAR_ASSERT(m < meshes.materials.back().count);
}

double edge_length(const MeshView& mesh, const std::array<uint32_t, 2>& edge) {
    return (mesh.position[edge[0]] - mesh.position[edge[1]]).norm();
}

void measure(MeshInfo& info, const MeshView& mesh) {
    for (const Vec3d& p : mesh.position) {
        info.box.min = info.box.min.cwiseMin(p);
        info.box.max = info.box.max.cwiseMax(p);
        info.radius = std::max(info.radius, p.norm());
    }
    // the volume is summed about the middle of the box: about a far origin its cones would cancel each other away
    const Vec3d middle = mesh.position.empty() ? Vec3d::Zero() : Vec3d(0.5 * (info.box.min + info.box.max));
    for (const Triangle& t : mesh.triangle) {
        const Vec3d a = mesh.position[t[0]] - middle, b = mesh.position[t[1]] - middle,
                    c = mesh.position[t[2]] - middle;
        info.volume += a.dot(b.cross(c)) / 6.0;
        info.area += 0.5 * (b - a).cross(c - a).norm();
    }
    for (const auto& edge : mesh.edge) {
        const double length = edge_length(mesh, edge);
        info.mean_edge += length;
        info.max_edge = std::max(info.max_edge, length);
    }
    if (!mesh.edge.empty()) info.mean_edge /= static_cast<double>(mesh.edge.size());
}

// Sixteen vertices of a slice and their columns of half-edges: the column count of a slice is its largest degree.
struct VertexNeighbours {
    std::vector<uint32_t> first;      // vertex -> rows of neighbour
    std::vector<uint32_t> neighbour;  // ascending within a vertex
};

VertexNeighbours gather_neighbours(const MeshView& mesh) {
    VertexNeighbours out;
    out.first.assign(mesh.position.size() + 1, 0);
    for (const auto& [a, b] : mesh.edge) {
        ++out.first[a + 1];
        ++out.first[b + 1];
    }
    std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
    out.neighbour.resize(2 * mesh.edge.size());
    std::vector<uint32_t> fill(out.first.begin(), out.first.end() - 1);
    // edges ascend by lower end, then by higher end: writing all lower neighbours first keeps every row ascending
    for (const auto& [a, b] : mesh.edge) out.neighbour[fill[b]++] = a;
    for (const auto& [a, b] : mesh.edge) out.neighbour[fill[a]++] = b;
    return out;
}

void append_slices(Springs& springs, const MeshView& mesh) {
    const VertexNeighbours around = gather_neighbours(mesh);
    const uint32_t vertices = static_cast<uint32_t>(mesh.position.size());
    const auto degree = [&](uint32_t v) { return v < vertices ? around.first[v + 1] - around.first[v] : 0u; };
    for (uint32_t begin = 0; begin < vertices; begin += kSliceWidth) {
        const size_t column = springs.neighbour.size() / kSliceWidth;
        uint32_t columns = 0;
        for (uint32_t lane = 0; lane < kSliceWidth; ++lane) columns = std::max(columns, degree(begin + lane));
        springs.slice_column.push_back(grow(column, columns).first);
        springs.neighbour.resize((column + columns) * kSliceWidth);
        springs.rest_length.resize((column + columns) * kSliceWidth, 0.0f);
        for (uint32_t k = 0; k < columns; ++k) {
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const uint32_t v = begin + lane;
                const size_t row = (column + k) * kSliceWidth + lane;
                springs.neighbour[row] = k < degree(v) ? around.neighbour[around.first[v] + k] : v;
                if (k < degree(v)) {
                    springs.rest_length[row] = static_cast<float>(edge_length(mesh, {v, springs.neighbour[row]}));
                }
            }
        }
    }
    springs.slice_column.push_back(grow(springs.neighbour.size() / kSliceWidth, 0).first);
}

void append_area_shares(Springs& springs, const MeshView& mesh, Range rows) {
    std::vector<double> share(rows.count, 0.0);
    for (const Triangle& t : mesh.triangle) {
        const Vec3d& a = mesh.position[t[0]];
        const double third = (mesh.position[t[1]] - a).cross(mesh.position[t[2]] - a).norm() / 6.0;
        for (const uint32_t v : t) share[v] += third;
    }
    for (const double s : share) springs.area_share.push_back(static_cast<float>(s));
}

template <typename Row>
void permute(std::vector<Row>& rows, const std::vector<uint32_t>& from) {
    if (rows.empty()) return;
    std::vector<Row> moved;
    moved.reserve(from.size());
    for (const uint32_t i : from) moved.push_back(rows[i]);
    rows = std::move(moved);
}

}  // namespace

uint32_t add_prototype(Meshes& meshes, const Mesh& mesh, Admission admission) {
    for (const Triangle& t : mesh.triangle) {
        TROCAR_ASSERT(t[0] < mesh.position.size() && t[1] < mesh.position.size() && t[2] < mesh.position.size());
        TROCAR_ASSERT(t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
    }
    TROCAR_ASSERT(3 * mesh.triangle.size() < kNone);
    const uint32_t row = static_cast<uint32_t>(meshes.info.size());
    MeshInfo info;
    info.admission = admission;
    info.vertices = grow(meshes.position.size(), mesh.position.size());
    info.triangles = grow(meshes.triangle.size(), mesh.triangle.size());
    meshes.name.push_back(mesh.name);
    meshes.position.insert(meshes.position.end(), mesh.position.begin(), mesh.position.end());
    meshes.triangle.insert(meshes.triangle.end(), mesh.triangle.begin(), mesh.triangle.end());
    append_components(meshes, mesh, append_edges(meshes, mesh, info), info);
    append_incident(meshes, mesh, info);
    append_looks(meshes, mesh, info);
    meshes.info.push_back(info);
    measure(meshes.info[row], mesh_view(meshes, row));
    return row;
}

void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype) {
    TROCAR_ASSERT(prototype < meshes.info.size() && springs.info.size() <= prototype);
    // prototypes without springs (rigid bodies) before this one get an empty row
    while (springs.info.size() < prototype) {
        const size_t skipped = springs.info.size();
        springs.info.push_back({grow(springs.slice_column.size() - skipped, 0), 0.0});
        springs.slice_column.push_back(static_cast<uint32_t>(springs.neighbour.size() / kSliceWidth));
        springs.vertices.push_back(grow(springs.area_share.size(), 0));
    }
    const MeshView mesh = mesh_view(meshes, prototype);
    const size_t slices = (mesh.position.size() + kSliceWidth - 1) / kSliceWidth;
    springs.info.push_back({grow(springs.slice_column.size() - prototype, slices), mesh.info->mean_edge});
    springs.vertices.push_back(grow(springs.area_share.size(), slices * kSliceWidth));
    append_slices(springs, mesh);
    append_area_shares(springs, mesh, springs.vertices.back());
}

void order_for_locality(Mesh& mesh) {
    Box box;
    for (const Vec3d& p : mesh.position) {
        box.min = box.min.cwiseMin(p);
        box.max = box.max.cwiseMax(p);
    }
    const auto by_key = [](size_t count, auto&& key_of) {
        std::vector<std::pair<uint64_t, uint32_t>> keyed(count);
        for (uint32_t i = 0; i < count; ++i) keyed[i] = {key_of(i), i};
        std::sort(keyed.begin(), keyed.end());
        std::vector<uint32_t> from(count);
        for (uint32_t i = 0; i < count; ++i) from[i] = keyed[i].second;
        return from;
    };
    const auto vertex_from =
        by_key(mesh.position.size(), [&](uint32_t v) { return hilbert_key(mesh.position[v], box); });
    std::vector<uint32_t> vertex_to(vertex_from.size());
    for (uint32_t v = 0; v < vertex_from.size(); ++v) vertex_to[vertex_from[v]] = v;
    permute(mesh.position, vertex_from);
    for (Triangle& t : mesh.triangle) t = {vertex_to[t[0]], vertex_to[t[1]], vertex_to[t[2]]};
    const auto triangle_from = by_key(mesh.triangle.size(), [&](uint32_t t) {
        const Triangle& c = mesh.triangle[t];
        const auto [lowest, highest] = std::minmax({c[0], c[1], c[2]});
        return uint64_t{lowest} << 32 | highest;
    });
    permute(mesh.triangle, triangle_from);
    permute(mesh.uv, triangle_from);
    permute(mesh.triangle_material, triangle_from);
}

}  // namespace trocar
