#include "engine/mesh/mesh_topology.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "engine/base/check.hpp"
#include "engine/geometry/edge_table.hpp"
#include "engine/geometry/space_curve.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {
namespace {

Range grow(size_t size, size_t count) {
    TROCAR_ASSERT(size + count < kNone);
    return {static_cast<uint32_t>(size), static_cast<uint32_t>(count)};
}

// Appends edge, edge_triangle, neighbour, triangle_edge and component.
void append_edges(Meshes& meshes, const Mesh& mesh, MeshInfo& info) {
    const EdgeTable table = make_edge_table(mesh.triangle, info.vertices.count);
    info.edges = grow(meshes.edge.size(), table.edge.size());
    meshes.edge.insert(meshes.edge.end(), table.edge.begin(), table.edge.end());
    meshes.neighbour.resize(info.triangles.end(), {kNone, kNone, kNone});
    meshes.triangle_edge.resize(info.triangles.end());
    auto* neighbour = meshes.neighbour.data() + info.triangles.first;
    auto* triangle_edge = meshes.triangle_edge.data() + info.triangles.first;
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        for (const uint32_t h : users) triangle_edge[h / 3][h % 3] = e;
        if (users.size() == 2) {
            neighbour[users[0] / 3][users[0] % 3] = users[1] / 3;
            neighbour[users[1] / 3][users[1] % 3] = users[0] / 3;
        }
        meshes.edge_triangle.push_back({users[0] / 3, users.size() > 1 ? users[1] / 3 : kNone});
    }
    // a vertex shared by two pieces belongs to the lower one
    std::vector<uint32_t> piece;
    info.components = number_pieces(table, info.triangles.count, piece);
    meshes.component.resize(info.vertices.end(), kNone);
    uint32_t* component = meshes.component.data() + info.vertices.first;
    for (uint32_t t = 0; t < info.triangles.count; ++t) {
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

// Texture coordinates of the corners and material of each triangle; else zeros and one default material.
void append_looks(Meshes& meshes, const Mesh& mesh, const MeshInfo& info) {
    TROCAR_ASSERT(mesh.uv.empty() || mesh.uv.size() == mesh.triangle.size());
    TROCAR_ASSERT(mesh.triangle_material.empty() || mesh.triangle_material.size() == mesh.triangle.size());
    meshes.uv.insert(meshes.uv.end(), mesh.uv.begin(), mesh.uv.end());
    meshes.uv.resize(info.triangles.end());
    meshes.triangle_material.insert(meshes.triangle_material.end(), mesh.triangle_material.begin(), mesh.triangle_material.end());
    meshes.triangle_material.resize(info.triangles.end(), 0);
    const size_t first = meshes.material.size();
    meshes.material.insert(meshes.material.end(), mesh.material.begin(), mesh.material.end());
    if (mesh.material.empty()) meshes.material.emplace_back();
    meshes.materials.push_back(grow(first, meshes.material.size() - first));
    for (const uint16_t m : mesh.triangle_material) TROCAR_ASSERT(m < meshes.materials.back().count);
}

double edge_length(std::span<const Vec3d> position, const std::array<uint32_t, 2>& edge) {
    return (position[edge[0]] - position[edge[1]]).norm();
}

void measure(MeshInfo& info, const MeshView& mesh) {
    info.box = {};
    info.radius = info.volume = info.area = info.mean_edge = info.max_edge = 0;
    for (const Vec3d& p : mesh.position) {
        info.box.min = info.box.min.cwiseMin(p);
        info.box.max = info.box.max.cwiseMax(p);
        info.radius = std::max(info.radius, p.norm());
    }
    // the volume is summed about the centre of the box: about a far origin its cones would cancel
    const Vec3d middle = mesh.position.empty() ? Vec3d::Zero() : Vec3d(0.5 * (info.box.min + info.box.max));
    for (const Triangle& t : mesh.triangle) {
        const Vec3d a = mesh.position[t[0]] - middle, b = mesh.position[t[1]] - middle, c = mesh.position[t[2]] - middle;
        info.volume += a.dot(b.cross(c)) / 6.0;
        info.area += 0.5 * (b - a).cross(c - a).norm();
    }
    for (const auto& edge : mesh.edge) {
        const double length = edge_length(mesh.position, edge);
        info.mean_edge += length;
        info.max_edge = std::max(info.max_edge, length);
    }
    if (!mesh.edge.empty()) info.mean_edge /= static_cast<double>(mesh.edge.size());
}

// Sixteen vertices of a slice and their columns of half-edges: the column count of a slice is its largest degree.
struct VertexNeighbours {
    std::vector<uint32_t> first;      // vertex -> first element of neighbour
    std::vector<uint32_t> neighbour;  // ascending within a vertex
};

VertexNeighbours gather_neighbours(size_t vertices, std::span<const std::array<uint32_t, 2>> edges) {
    VertexNeighbours out;
    out.first.assign(vertices + 1, 0);
    for (const auto& [a, b] : edges) {
        ++out.first[a + 1];
        ++out.first[b + 1];
    }
    std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
    out.neighbour.resize(2 * edges.size());
    std::vector<uint32_t> fill(out.first.begin(), out.first.end() - 1);
    // edges ascend by lower end, then by higher end: writing lower neighbours first keeps every list
    // ascending
    for (const auto& [a, b] : edges) out.neighbour[fill[b]++] = a;
    for (const auto& [a, b] : edges) out.neighbour[fill[a]++] = b;
    return out;
}

void append_slices(Springs& springs, std::span<const Vec3d> position, std::span<const std::array<uint32_t, 2>> edges) {
    const VertexNeighbours around = gather_neighbours(position.size(), edges);
    const uint32_t vertices = static_cast<uint32_t>(position.size());
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
                const size_t index = (column + k) * kSliceWidth + lane;
                springs.neighbour[index] = k < degree(v) ? around.neighbour[around.first[v] + k] : v;
                if (k < degree(v)) {
                    springs.rest_length[index] = static_cast<float>(edge_length(position, {v, springs.neighbour[index]}));
                }
            }
        }
    }
    springs.slice_column.push_back(grow(springs.neighbour.size() / kSliceWidth, 0).first);
}

// Area shares of triangles between `position`, whose elements begin `before` later.
void append_area_shares(Springs& springs, std::span<const Vec3d> position, std::span<const Triangle> triangle, uint32_t before,
                        Range range) {
    std::vector<double> share(range.count, 0.0);
    for (const Triangle& t : triangle) {
        const Vec3d& a = position[t[0]];
        const double third = (position[t[1]] - a).cross(position[t[2]] - a).norm() / 6.0;
        for (const uint32_t v : t) share[before + v] += third;
    }
    for (const double s : share) springs.area_share.push_back(static_cast<float>(s));
}

template <typename Value>
void permute(std::vector<Value>& values, const std::vector<uint32_t>& from) {
    if (values.empty()) return;
    TROCAR_ASSERT(values.size() == from.size());
    std::vector<Value> moved;
    moved.reserve(from.size());
    for (const uint32_t i : from) moved.push_back(values[i]);
    values = std::move(moved);
}

}  // namespace

uint32_t add_prototype(Meshes& meshes, const Mesh& mesh, Admission admission) {
    for (const Triangle& t : mesh.triangle) {
        TROCAR_ASSERT(t[0] < mesh.position.size() && t[1] < mesh.position.size() && t[2] < mesh.position.size());
        TROCAR_ASSERT(t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
    }
    TROCAR_ASSERT(3 * mesh.triangle.size() < kNone);
    const uint32_t index = static_cast<uint32_t>(meshes.info.size());
    MeshInfo info;
    info.admission = admission;
    info.vertices = grow(meshes.position.size(), mesh.position.size());
    info.triangles = grow(meshes.triangle.size(), mesh.triangle.size());
    meshes.name.push_back(mesh.name);
    meshes.position.insert(meshes.position.end(), mesh.position.begin(), mesh.position.end());
    meshes.triangle.insert(meshes.triangle.end(), mesh.triangle.begin(), mesh.triangle.end());
    append_edges(meshes, mesh, info);
    append_incident(meshes, mesh, info);
    append_looks(meshes, mesh, info);
    meshes.info.push_back(info);
    measure(meshes.info[index], mesh_view(meshes, index));
    return index;
}

void measure_prototype(Meshes& meshes, uint32_t prototype) {
    TROCAR_ASSERT(prototype < meshes.info.size());
    measure(meshes.info[prototype], mesh_view(meshes, prototype));
}

void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype) {
    const MeshView mesh = mesh_view(meshes, prototype);
    add_springs(springs, meshes, prototype, mesh.position, mesh.edge);
}

void add_springs(Springs& springs, const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> node,
                 std::span<const std::array<uint32_t, 2>> edge, const EmbeddedSkin& skin) {
    TROCAR_ASSERT(prototype < meshes.info.size() && springs.info.size() <= prototype);
    // prototypes without springs (rigid bodies) before this one get an empty element
    while (springs.info.size() < prototype) {
        const size_t skipped = springs.info.size();
        springs.info.push_back({grow(springs.slice_column.size() - skipped, 0)});
        springs.slice_column.push_back(static_cast<uint32_t>(springs.neighbour.size() / kSliceWidth));
        springs.vertices.push_back(grow(springs.area_share.size(), 0));
    }
    const MeshView mesh = mesh_view(meshes, prototype);
    const size_t slices = (node.size() + kSliceWidth - 1) / kSliceWidth;
    SpringInfo& info = springs.info.emplace_back();
    info.slices = grow(springs.slice_column.size() - prototype, slices);
    for (const auto& e : edge) info.mean_rest += edge_length(node, e);
    if (!edge.empty()) info.mean_rest /= static_cast<double>(edge.size());
    info.skin = (skin.vertices + kSliceWidth - 1) / kSliceWidth * kSliceWidth;
    springs.vertices.push_back(grow(springs.area_share.size(), info.skin + slices * kSliceWidth));
    append_slices(springs, node, edge);
    const bool embedded = info.skin > 0;
    append_area_shares(springs, embedded ? node : mesh.position, embedded ? skin.boundary : mesh.triangle, info.skin,
                       springs.vertices.back());
    pack_springs(springs, prototype);
}

void pack_springs(Springs& springs, uint32_t prototype, size_t beyond) {
    TROCAR_ASSERT(prototype < springs.info.size());
    SpringInfo& info = springs.info[prototype];
    const uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    const size_t first = size_t{column[0]} * kSliceWidth, last = size_t{column[info.slices.count]} * kSliceWidth;
    if (info.packed != kNone || (last - first) * 8 <= beyond) return;
    std::vector<std::array<uint16_t, 2 * kSliceWidth>> packed(column[info.slices.count] - column[0]);
    for (uint32_t slice = 0; slice < info.slices.count; ++slice) {
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const uint32_t near = springs.neighbour[size_t{c} * kSliceWidth + lane] + 32768 - kSliceWidth * slice;
                if (near > 65535) return;
                packed[c - column[0]][lane] = static_cast<uint16_t>(near);
            }
        }
    }
    float longest = 0;
    for (size_t h = first; h < last; ++h) longest = std::max(longest, springs.rest_length[h]);
    info.rest_unit = longest / 65535;
    for (size_t h = first; h < last; ++h) {
        const uint16_t units =
            longest > 0 ? static_cast<uint16_t>(std::lround(double{springs.rest_length[h]} / info.rest_unit)) : uint16_t{0};
        packed[(h - first) / kSliceWidth][kSliceWidth + h % kSliceWidth] = units;
        springs.rest_length[h] = static_cast<float>(units) * info.rest_unit;
    }
    info.packed = static_cast<uint32_t>(springs.packed.size());
    springs.packed.insert(springs.packed.end(), packed.begin(), packed.end());
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
    const auto vertex_from = by_key(mesh.position.size(), [&](uint32_t v) { return hilbert_key(mesh.position[v], box); });
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
