#include "engine/tissue/cut_setup.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "engine/tissue/deformable_setup.hpp"
namespace trocar {
namespace {

// Columns per slice of 16 vertices that are reserved: meshes have 7 to 9, and cuts make more vertices of low degree
// than of high.
constexpr uint32_t kColumnsPerSlice = 12;

uint32_t padded(uint32_t vertices) { return (vertices + kSliceWidth - 1) / kSliceWidth * kSliceWidth; }

// The present surface as a mesh, its elements made anew.
Meshes make_surface(const CutBody& limits, const std::array<uint32_t, 2>& count, const CutSurfaces& cut) {
    Mesh mesh;
    const auto part = [](const auto& from, auto& to, uint32_t first, uint32_t size) {
        to.assign(from.begin() + first, from.begin() + first + size);
    };
    part(cut.position, mesh.position, limits.vertices.first, count[0]);
    part(cut.triangle, mesh.triangle, limits.triangles.first, count[1]);
    part(cut.uv, mesh.uv, limits.triangles.first, count[1]);
    part(cut.material, mesh.triangle_material, limits.triangles.first, count[1]);
    Meshes made;
    // a material for every number that a triangle has
    mesh.material.resize(1 + *std::max_element(mesh.triangle_material.begin(), mesh.triangle_material.end()));
    add_prototype(made, mesh, limits.whole);
    return made;
}

// Largest factors with which no vertex has stiffer springs for its area than the stiffest at load.
void soften(const CutBody& limits, const Springs& made, uint32_t vertices, std::span<float> factor) {
    std::vector<uint32_t> degree(vertices, 0);
    const auto each = [&](const auto& visit) {
        for (uint32_t slice = 0; slice < made.info[0].slices.count; ++slice)
            for (size_t h = size_t{made.slice_column[slice]} * kSliceWidth; h < size_t{made.slice_column[slice + 1]} * kSliceWidth; ++h) {
                const uint32_t v = slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth);
                if (made.neighbour[h] != v) visit(h, v, made.neighbour[h]);
            }
    };
    each([&](size_t, uint32_t v, uint32_t) { ++degree[v]; });
    const auto share = [&](uint32_t v) { return std::min(1.0, double{made.area_share[v]} * limits.lightest / degree[v]); };
    each([&](size_t h, uint32_t v, uint32_t far) { factor[h] = static_cast<float>(std::min(share(v), share(far))); });
}

}  // namespace

void copy_cut_surface(const Meshes& made, uint32_t prototype, Meshes& meshes) {
    MeshInfo& info = meshes.info[prototype];
    const auto copy = [](const auto& from, auto& to, uint32_t first) { std::copy(from.begin(), from.end(), to.begin() + first); };
    copy(made.position, meshes.position, info.vertices.first);
    copy(made.component, meshes.component, info.vertices.first);
    copy(made.incident_first, meshes.incident_first, info.vertices.first + prototype);
    copy(made.incident, meshes.incident, info.incident.first);
    copy(made.triangle, meshes.triangle, info.triangles.first);
    copy(made.neighbour, meshes.neighbour, info.triangles.first);
    copy(made.triangle_edge, meshes.triangle_edge, info.triangles.first);
    copy(made.uv, meshes.uv, info.triangles.first);
    copy(made.triangle_material, meshes.triangle_material, info.triangles.first);
    copy(made.edge, meshes.edge, info.edges.first);
    copy(made.edge_triangle, meshes.edge_triangle, info.edges.first);
    MeshInfo now = made.info[0];
    now.vertices.first = info.vertices.first, now.triangles.first = info.triangles.first;
    now.edges.first = info.edges.first, now.incident.first = info.incident.first;
    // a closed surface that was opened has an inside by winding number only
    const auto open = [](const std::array<uint32_t, 2>& sides) { return sides[1] == kNone; };
    now.admission = info.admission;
    if (now.admission == Admission::kSolid && std::any_of(made.edge_triangle.begin(), made.edge_triangle.end(), open))
        now.admission = Admission::kWinding;
    info = now;
}

CutRoom room_for_cuts(const MeshInfo& info, uint32_t more) {
    // a split edge adds a vertex and up to two triangles, a duplicate of it another vertex; every triangle alone has three edges
    CutRoom room{info.vertices.count + more + 64, info.triangles.count + more, 0};
    room.edges = 3 * room.triangles;
    return room;
}

void keep_cut_room(const CutRoom& room, Meshes& meshes) {
    const MeshInfo& info = meshes.info.back();
    TROCAR_ASSERT(info.vertices.end() == meshes.position.size() && info.triangles.end() == meshes.triangle.size());
    const size_t vertices = size_t{info.vertices.first} + room.vertices, triangles = size_t{info.triangles.first} + room.triangles;
    const size_t edges = size_t{info.edges.first} + room.edges;
    meshes.position.resize(vertices, Vec3d::Zero());
    meshes.component.resize(vertices, 0);
    meshes.incident_first.resize(vertices + meshes.info.size(), meshes.incident_first.back());
    meshes.triangle.resize(triangles, {0, 0, 0});
    meshes.neighbour.resize(triangles, {kNone, kNone, kNone});
    meshes.triangle_edge.resize(triangles);
    meshes.uv.resize(triangles);
    meshes.triangle_material.resize(triangles, 0);
    meshes.edge.resize(edges);
    meshes.edge_triangle.resize(edges, {kNone, kNone});
    meshes.incident.resize(size_t{info.incident.first} + 3 * size_t{room.triangles});
}

uint32_t widen_springs(const CutRoom& room, uint32_t prototype, Springs& springs) {
    SpringInfo& info = springs.info[prototype];
    TROCAR_ASSERT(springs.info.size() == prototype + 1 && info.skin == 0);
    const uint32_t slices = padded(room.vertices) / kSliceWidth, first = springs.slice_column[info.slices.first + prototype];
    const uint32_t used = springs.slice_column.back();
    const uint32_t columns = std::max(used - first, slices * kColumnsPerSlice);
    springs.slice_column.resize(info.slices.first + prototype + slices + 1, used);
    info.slices.count = slices;
    info.varied = 1;
    info.packed = kNone;
    springs.neighbour.resize((size_t{first} + columns) * kSliceWidth, 0);
    springs.rest_length.resize(springs.neighbour.size(), 0.0f);
    springs.factor.resize(springs.neighbour.size(), 1.0f);
    springs.vertices[prototype].count = slices * kSliceWidth;
    springs.area_share.resize(springs.vertices[prototype].end(), 0.0f);
    return columns;
}

void add_cut_body(const CutRoom& room, uint32_t columns, uint32_t body, const Meshes& meshes, Springs& springs, const Anchors& anchors,
                  Bodies& bodies, Actions& actions, CutSurfaces& cut) {
    const uint32_t prototype = bodies.mesh[body];
    const MeshInfo& info = meshes.info[prototype];
    const Tissue& tissue = bodies.tissue[body];
    CutBody limits;
    limits.body = body;
    limits.vertices = {static_cast<uint32_t>(cut.position.size()), room.vertices};
    limits.triangles = {static_cast<uint32_t>(cut.triangle.size()), room.triangles};
    limits.edges = room.edges, limits.columns = columns;
    limits.thickness = bodies.thickness[body] > 0 ? bodies.thickness[body] : tissue.wall;
    limits.edge = info.mean_edge;
    limits.whole = info.admission;
    cut.before.resize(limits.vertices.end(), Vec3d::Zero());
    cut.position.resize(limits.vertices.end(), Vec3d::Zero()), cut.goal.resize(limits.vertices.end(), Vec3::Zero());
    cut.triangle.resize(limits.triangles.end()), cut.uv.resize(limits.triangles.end()), cut.material.resize(limits.triangles.end());
    cut.count.push_back({info.vertices.count, info.triangles.count});
    const auto take = [](const auto& from, uint32_t first, uint32_t size, auto& to, uint32_t at) {
        std::copy_n(from.begin() + first, size, to.begin() + at);
    };
    take(meshes.position, info.vertices.first, info.vertices.count, cut.position, limits.vertices.first);
    take(meshes.triangle, info.triangles.first, info.triangles.count, cut.triangle, limits.triangles.first);
    take(meshes.uv, info.triangles.first, info.triangles.count, cut.uv, limits.triangles.first);
    take(meshes.triangle_material, info.triangles.first, info.triangles.count, cut.material, limits.triangles.first);
    std::vector<uint32_t> degree(info.vertices.count, 0);
    for (const auto& e : mesh_view(meshes, prototype).edge) ++degree[e[0]], ++degree[e[1]];
    for (uint32_t v = 0; v < info.vertices.count; ++v) {
        const uint32_t p = bodies.particles[body].first + v;
        cut.goal[limits.vertices.first + v] = {anchors.rest_x[p], anchors.rest_y[p], anchors.rest_z[p]};
        const double share = springs.area_share[springs.vertices[prototype].first + v];
        if (share > 0) limits.lightest = std::max(limits.lightest, degree[v] / share);
    }
    // Gershgorin: 2 sum k / m and the anchors, of the vertex with most springs for its area; no cut makes another one worse
    const double area_mass =
        info.admission == Admission::kSheet ? tissue.density * limits.thickness : tissue.density * std::abs(info.volume) / info.area;
    const double omega2 = (2 * double{bodies.spring_stiffness[body]} * limits.lightest + tissue.youngs_modulus / tissue.depth) / area_mass;
    const double damping = tissue.damping;
    bodies.stable_dt[body] =
        std::min(bodies.stable_dt[body], kStableShare * (std::sqrt(damping * damping + 4 * omega2) - damping) / omega2);
    actions.cut_body.push_back(limits);
}

bool lay_cut_surface(const CutBody& limits, uint32_t index, const CutSurfaces& cut, const Bodies& bodies, Meshes& meshes, Springs& springs,
                     Anchors& anchors) {
    const uint32_t prototype = bodies.mesh[limits.body], vertices = cut.count[index][0];
    const Meshes surface = make_surface(limits, cut.count[index], cut);
    Springs made;
    add_springs(made, surface, 0);
    if (made.slice_column.back() > limits.columns) return false;
    std::vector<float> factor(made.neighbour.size(), 1.0f);
    soften(limits, made, vertices, factor);
    copy_cut_surface(surface, prototype, meshes);
    const SpringInfo& info = springs.info[prototype];
    uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    const uint32_t first = column[0];
    for (uint32_t slice = 0; slice <= info.slices.count; ++slice)
        column[slice] = first + made.slice_column[std::min(slice, made.info[0].slices.count)];
    const size_t at = size_t{first} * kSliceWidth;
    std::copy(made.neighbour.begin(), made.neighbour.end(), springs.neighbour.begin() + at);
    std::copy(made.rest_length.begin(), made.rest_length.end(), springs.rest_length.begin() + at);
    std::copy(factor.begin(), factor.end(), springs.factor.begin() + at);
    // what earlier surfaces left beyond is no part of this one
    const size_t used = at + made.neighbour.size(), left = (size_t{first} + limits.columns) * kSliceWidth - used;
    std::fill_n(springs.neighbour.begin() + used, left, 0u);
    std::fill_n(springs.rest_length.begin() + used, left, 0.0f);
    std::fill_n(springs.factor.begin() + used, left, 1.0f);
    const Range shares = springs.vertices[prototype];
    std::fill_n(springs.area_share.begin() + shares.first, shares.count, 0.0f);
    std::copy(made.area_share.begin(), made.area_share.end(), springs.area_share.begin() + shares.first);
    const Tissue& tissue = bodies.tissue[limits.body];
    for (uint32_t v = 0; v < vertices; ++v) {
        const uint32_t p = bodies.particles[limits.body].first + v;
        const Vec3& goal = cut.goal[limits.vertices.first + v];
        anchors.stiffness[p] = static_cast<float>(tissue.youngs_modulus * made.area_share[v] / tissue.depth);
        anchors.rest_x[p] = goal.x(), anchors.rest_y[p] = goal.y(), anchors.rest_z[p] = goal.z();
    }
    return true;
}

bool is_cut_surface_laid(const CutBody& limits, uint32_t index, const CutSurfaces& cut, const Bodies& bodies, const Meshes& meshes) {
    const MeshInfo& info = meshes.info[bodies.mesh[limits.body]];
    if (info.vertices.count != cut.count[index][0] || info.triangles.count != cut.count[index][1]) return false;
    return std::equal(cut.triangle.begin() + limits.triangles.first, cut.triangle.begin() + limits.triangles.first + info.triangles.count,
                      meshes.triangle.begin() + info.triangles.first);
}

void remake_tree(uint32_t body, const Bodies& bodies, const Particles& particles, const Meshes& meshes,
                 std::span<std::unique_ptr<ClosestPointTree>> trees) {
    std::unique_ptr<ClosestPointTree>& tree = trees[bodies.tree[body]];
    const Range range = bodies.particles[body];
    tree = std::make_unique<ClosestPointTree>(mesh_view(meshes, bodies.mesh[body]),
                                              std::span(particles.offset).subspan(range.first, range.count), nullptr, tree->search());
}

void restore_cut_surfaces(const Actions& actions, const CutSurfaces& cut, const Bodies& bodies, const Particles& particles, Meshes& meshes,
                          Springs& springs, Anchors& anchors, std::span<std::unique_ptr<ClosestPointTree>> trees) {
    for (uint32_t index = 0; index < actions.cut_body.size(); ++index) {
        const CutBody& limits = actions.cut_body[index];
        if (is_cut_surface_laid(limits, index, cut, bodies, meshes)) continue;
        lay_cut_surface(limits, index, cut, bodies, meshes, springs, anchors);
        remake_tree(limits.body, bodies, particles, meshes, trees);
    }
}

}  // namespace trocar
