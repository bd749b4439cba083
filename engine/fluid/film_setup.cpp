#include "engine/fluid/film_setup.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/geometry/point_triangle.hpp"
namespace trocar {
namespace {

uint32_t padded(size_t count) { return static_cast<uint32_t>((count + kFilmBlock - 1) / kFilmBlock * kFilmBlock); }

void add_spot(uint32_t vertex, double share, Fluids& fluids) { fluids.spot.push_back(vertex), fluids.share.push_back(share); }

}  // namespace

void connect_film(const Meshes& meshes, uint32_t prototype, const FilmBody& film, FluidState& state) {
    const MeshView mesh = mesh_view(meshes, prototype);
    std::vector<float> conductance(mesh.edge.size());
    std::vector<uint32_t> order(mesh.edge.size());
    compute_conductances(mesh.position, mesh.triangle, mesh.triangle_edge, mesh.edge, conductance);
    order_edges(mesh.edge, static_cast<uint32_t>(mesh.position.size()), order);
    std::fill_n(state.crowding.begin() + film.cells.first, film.cells.count, 0.0f);
    for (uint32_t k = 0; k < film.edges.count; ++k) {
        const uint32_t at = film.edges.first + k;
        state.from[at] = state.to[at] = 0, state.conductance[at] = state.flow[at] = 0;
        if (k >= order.size()) continue;
        const auto [a, b] = mesh.edge[order[k]];
        state.from[at] = a, state.to[at] = b, state.conductance[at] = conductance[order[k]];
        state.crowding[film.cells.first + a] += state.conductance[at], state.crowding[film.cells.first + b] += state.conductance[at];
    }
}

uint64_t hash_triangles(std::span<const Triangle> triangles) {
    uint64_t hash = triangles.size();
    for (const Triangle& t : triangles)
        for (const uint32_t v : t) hash = (hash ^ v) * 0x9e3779b97f4a7c15u, hash ^= hash >> 32;
    return hash;
}

void add_film(const Meshes& meshes, uint32_t prototype, uint32_t body, const FilmRoom& room, Fluids& fluids, FluidState& state) {
    const MeshView mesh = mesh_view(meshes, prototype);
    const FilmBody film{body,
                        {static_cast<uint32_t>(state.volume.size()), padded(std::max<size_t>(mesh.position.size(), room.vertices))},
                        {static_cast<uint32_t>(state.flow.size()), padded(std::max<size_t>(mesh.edge.size(), room.edges))},
                        room.changes};
    fluids.body.push_back(film);
    for (auto* each : {&state.volume, &state.blood}) each->resize(film.cells.end(), 0.0);
    for (auto* each : {&state.rise, &state.crowding}) each->resize(film.cells.end(), 0.0f);
    for (auto* each : {&state.flow, &state.conductance}) each->resize(film.edges.end(), 0.0f);
    for (auto* each : {&state.from, &state.to}) each->resize(film.edges.end(), 0u);
    state.triangles.push_back(room.changes ? hash_triangles(mesh.triangle) : 0);
    connect_film(meshes, prototype, film, state);
}

void reserve_drops(uint32_t count, uint32_t puffs, uint32_t edges, Fluids& fluids, FluidState& state) {
    fluids.most_drops = count, fluids.most_puffs = puffs, fluids.most_edges = edges;
    state.puffs.position.reserve(puffs), state.puffs.variance.reserve(puffs);
    state.puffs.mass.reserve(puffs), state.puffs.age.reserve(puffs);
    state.edge.reserve(edges);
    state.drops.position.reserve(count), state.drops.velocity.reserve(count);
    state.drops.volume.reserve(count), state.drops.blood.reserve(count);
}

std::array<double, 3> corner_shares(const Vec3d& point, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d normal = triangle_normal(a, b, c);
    const double size = normal.squaredNorm();
    if (!(size > 0)) return {1, 0, 0};
    const double u = std::clamp((c - b).cross(point - b).dot(normal) / size, 0.0, 1.0);
    const double v = std::clamp((a - c).cross(point - c).dot(normal) / size, 0.0, 1.0 - u);
    return {u, v, 1 - u - v};
}

Wound place_wound(const Meshes& meshes, uint32_t prototype, uint32_t film, const Vec3d& point, double radius, Fluids& fluids) {
    const MeshView mesh = mesh_view(meshes, prototype);
    Wound wound;
    wound.film = film;
    wound.spots.first = static_cast<uint32_t>(fluids.spot.size());
    double area = 0;
    for (uint32_t v = 0; v < mesh.position.size(); ++v) {
        if ((mesh.position[v] - point).norm() > radius) continue;
        double cell = 0;
        for (uint32_t i = mesh.incident_first[v]; i < mesh.incident_first[v + 1]; ++i) {
            const Triangle& t = mesh.triangle[mesh.incident[i]];
            cell += triangle_normal(mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]).norm() / 6;
        }
        if (cell > 0) add_spot(v, cell, fluids), area += cell;
    }
    for (size_t i = wound.spots.first; i < fluids.share.size(); ++i) fluids.share[i] /= area;
    wound.area = area;
    if (!(area > 0)) {
        double least = std::numeric_limits<double>::infinity();
        Triangle nearest{0, 0, 0};
        Vec3d at = point;
        for (const Triangle& t : mesh.triangle) {
            const TrianglePoint p = closest_point_on_triangle(point, mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]);
            if (p.squared_distance < least) least = p.squared_distance, nearest = t, at = point + p.offset;
        }
        const auto share = corner_shares(at, mesh.position[nearest[0]], mesh.position[nearest[1]], mesh.position[nearest[2]]);
        for (size_t k = 0; k < 3; ++k) add_spot(nearest[k], share[k], fluids);
        wound.area = 0.5 * triangle_normal(mesh.position[nearest[0]], mesh.position[nearest[1]], mesh.position[nearest[2]]).norm();
    }
    wound.spots.count = static_cast<uint32_t>(fluids.spot.size()) - wound.spots.first;
    return wound;
}

Film film_of(const Fluids& fluids, FluidState& state, uint32_t film) {
    const Range cells = fluids.body[film].cells, edges = fluids.body[film].edges;
    const auto cut = [](auto& rows, Range range) { return std::span(rows).subspan(range.first, range.count); };
    return {cut(state.from, edges),   cut(state.to, edges),    cut(state.conductance, edges), cut(state.crowding, cells),
            cut(state.volume, cells), cut(state.blood, cells), cut(state.rise, cells),        cut(state.flow, edges)};
}

uint32_t find_film(const Fluids& fluids, uint32_t body) {
    for (uint32_t i = 0; i < fluids.body.size(); ++i)
        if (fluids.body[i].body == body) return i;
    return kNone;
}

}  // namespace trocar
