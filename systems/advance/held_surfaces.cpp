#include "systems/advance/held_surfaces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/contact/sleeping_bodies.hpp"
#include "engine/geometry/point_triangle.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostRings = 6;       // added one by one before the whole body is held
constexpr double kFreeShare = 0.49;      // of a distance that either side may go: below a half by what floats round
constexpr double kFarthestLook = 0.75;   // of a mean edge: farther parts need not be looked for, as none goes half of this

// A body whose surface crosses itself at the end of a pass.
struct CrossedBody {
    uint32_t body;
    MeshView mesh;
    std::span<const Float4> start;  // m, of its particles
    Particles& particles;
    uint32_t first;  // of its particles

    Float4* offset() const { return particles.offset.data() + first; }
};

double energy_of(const EnergyInputs& inputs, uint32_t body, BodyEnergyScratch& scratch) {
    Energy sum;
    add_body_energy(inputs, body, scratch, sum);
    return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
}

void hold_vertex(uint32_t v, HeldSurfacesScratch& scratch) {
    if (scratch.held[v]) return;
    scratch.held[v] = 1;
    scratch.vertex.push_back(v);
}
void hold_faces(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    for (const uint32_t face : scratch.faces)
        for (const uint32_t v : b.mesh.triangle[face]) hold_vertex(v, scratch);
}
void hold_ring(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const size_t count = scratch.vertex.size();
    for (size_t i = 0; i < count; ++i) {
        const uint32_t v = scratch.vertex[i];
        for (uint32_t k = b.mesh.incident_first[v]; k < b.mesh.incident_first[v + 1]; ++k)
            for (const uint32_t w : b.mesh.triangle[b.mesh.incident[k]]) hold_vertex(w, scratch);
    }
}

// Whether none of the held vertices is fixed: they may go along with what carries them.
bool all_free(const CrossedBody& b, std::span<const uint32_t> vertices) {
    return std::ranges::all_of(vertices, [&](uint32_t v) { return b.start[v].w > 0; });
}

// Mean by mass over the held vertices. value(v): Vec3d.
template <typename Value>
Vec3d mean_of(const CrossedBody& b, std::span<const uint32_t> vertices, const Value& value) {
    Vec3d sum = Vec3d::Zero();
    double mass = 0;
    for (const uint32_t v : vertices) sum += value(v) / double{b.start[v].w}, mass += 1 / double{b.start[v].w};
    return sum / mass;
}

Vec3d at(const Float4& p) { return {p.x, p.y, p.z}; }

// Distance of two edges p + s u, q + t v, m: clamped closest points (Ericson, Real-Time Collision Detection, 2005, 5.1.9).
double edge_distance(const Vec3d& p, const Vec3d& u, const Vec3d& q, const Vec3d& v) {
    const Vec3d r = p - q;
    const double a = u.squaredNorm(), e = v.squaredNorm(), f = v.dot(r), c = u.dot(r), b = u.dot(v), sine2 = a * e - b * b;
    const auto from = [&](double s) {
        const double t = e > 0 ? std::clamp((b * s + f) / e, 0.0, 1.0) : 0.0, best = a > 0 ? std::clamp((b * t - c) / a, 0.0, 1.0) : 0.0;
        return (r + best * u - t * v).norm();
    };
    return std::min({from(0), from(1), from(sine2 > 0 ? std::clamp((b * f - c * e) / sine2, 0.0, 1.0) : 0.0)});
}

// How far each vertex may go, from the surface at the start of the pass.
void measure_free_paths(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const double reach = kFarthestLook * b.mesh.info->mean_edge;
    build_feature_trees(b.mesh, b.start.data(), scratch.trees);
    find_near_features(b.mesh, b.start.data(), scratch.trees, scratch.trees, true, static_cast<float>(reach), scratch.near);
    std::vector<float>& path = scratch.free_path;
    path.assign(b.start.size(), std::numeric_limits<float>::infinity());  // of particles below the surface
    std::fill_n(path.begin(), b.mesh.position.size(), static_cast<float>(kFreeShare * reach));
    const auto limit = [&](uint32_t v, double distance) { path[v] = std::min(path[v], static_cast<float>(kFreeShare * distance)); };
    const auto place = [&](uint32_t v) { return at(b.start[v]); };
    for (const uint64_t pair : scratch.near.vertex_triangle) {
        const auto vertex = static_cast<uint32_t>(pair >> 32);
        const Triangle& t = b.mesh.triangle[static_cast<uint32_t>(pair)];
        const double distance = std::sqrt(closest_point_on_triangle(place(vertex), place(t[0]), place(t[1]), place(t[2])).squared_distance);
        for (const uint32_t v : {vertex, t[0], t[1], t[2]}) limit(v, distance);
    }
    for (const uint64_t pair : scratch.near.edge_edge) {
        const auto [p, q] = b.mesh.edge[static_cast<uint32_t>(pair >> 32)];
        const auto [r, s] = b.mesh.edge[static_cast<uint32_t>(pair)];
        const double distance = edge_distance(place(p), place(q) - place(p), place(r), place(s) - place(r));
        for (const uint32_t v : {p, q, r, s}) limit(v, distance);
    }
}

// Leaves the held vertices within their free paths, those times `part`, from where they were, displaced by their mean displacement.
void put_back(const CrossedBody& b, double part, HeldSurfacesScratch& scratch) {
    const auto displacement = [&](uint32_t v) -> Vec3d { return at(scratch.reached[v]) - at(b.start[v]); };
    const Vec3d shift = all_free(b, scratch.vertex) ? mean_of(b, scratch.vertex, displacement) : Vec3d(Vec3d::Zero());
    for (const uint32_t v : scratch.vertex) {
        const Vec3d own = displacement(v) - shift;
        const double size = own.norm(), most = part * double{scratch.free_path[v]}, share = size <= most ? 1.0 : most / size;
        const Vec3d to = at(b.start[v]) + shift + share * own;
        Float4& p = b.offset()[v];
        p.x = static_cast<float>(to.x()), p.y = static_cast<float>(to.y()), p.z = static_cast<float>(to.z());
        scratch.share[v] = static_cast<float>(share);
    }
}

// Velocities of vertices, relative to their mean, times their shares; momentum is kept if all are free.
void slow_down(const CrossedBody& b, std::span<const uint32_t> vertices, std::span<const float> share) {
    Particles& p = b.particles;
    const auto velocity = [&](uint32_t v) { return Vec3d(p.velocity_x[b.first + v], p.velocity_y[b.first + v], p.velocity_z[b.first + v]); };
    const auto set = [&](uint32_t v, const Vec3d& to) {
        p.velocity_x[b.first + v] = static_cast<float>(to.x());
        p.velocity_y[b.first + v] = static_cast<float>(to.y());
        p.velocity_z[b.first + v] = static_cast<float>(to.z());
    };
    const bool free = all_free(b, vertices);
    const Vec3d mean = free ? mean_of(b, vertices, velocity) : Vec3d(Vec3d::Zero());
    for (const uint32_t v : vertices) set(v, mean + double{share[v]} * (velocity(v) - mean));
    if (!free) return;
    const Vec3d lost = mean - mean_of(b, vertices, velocity);
    for (const uint32_t v : vertices) set(v, velocity(v) + lost);
}

void hold_every_vertex(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    for (uint32_t v = 0; v < b.start.size(); ++v)
        if (v < b.mesh.position.size() || b.start[v].w > 0) hold_vertex(v, scratch);  // not padding
}

// Puts the whole body back where it started.
void hold_all(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    hold_every_vertex(b, scratch);
    std::copy(b.start.begin(), b.start.end(), b.offset());
    scratch.share.assign(b.start.size(), 0);
    slow_down(b, scratch.vertex, scratch.share);
}

// Returns whether nothing crosses.
bool hold_parts(const CrossedBody& b, double part, HeldSurfacesScratch& scratch) {
    const auto crosses = [&] {
        find_crossing_faces(b.mesh.triangle, b.offset(), scratch.crossing, scratch.faces);
        return !scratch.faces.empty();
    };
    scratch.held.assign(b.start.size(), 0);
    scratch.share.assign(b.start.size(), 1);
    scratch.vertex.clear();
    bool crossed = crosses();
    for (uint32_t ring = 0; crossed && ring <= kMostRings; ++ring) {
        if (ring == kMostRings)
            hold_every_vertex(b, scratch);
        else
            hold_faces(b, scratch), hold_ring(b, scratch);
        put_back(b, part, scratch);
        crossed = crosses();
    }
    slow_down(b, scratch.vertex, scratch.share);
    return !crossed;
}

void hold_body(const EnergyInputs& inputs, const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const double before = energy_of(inputs, b.body, scratch.energy);
    Particles& p = b.particles;
    const auto rows = [&](std::vector<float>& column) { return std::span(column).subspan(b.first, b.start.size()); };
    scratch.reached.assign(b.offset(), b.offset() + b.start.size());
    for (size_t axis = 0; axis < 3; ++axis) {
        const auto from = rows(axis == 0 ? p.velocity_x : axis == 1 ? p.velocity_y : p.velocity_z);
        scratch.velocity[axis].assign(from.begin(), from.end());
    }
    measure_free_paths(b, scratch);
    for (const double part : {1.0, 0.25}) {
        std::ranges::copy(scratch.reached, b.offset());
        for (size_t axis = 0; axis < 3; ++axis)
            std::ranges::copy(scratch.velocity[axis], rows(axis == 0 ? p.velocity_x : axis == 1 ? p.velocity_y : p.velocity_z).begin());
        if (hold_parts(b, part, scratch) && energy_of(inputs, b.body, scratch.energy) <= before) return;
    }
    hold_all(b, scratch);
}

}  // namespace

void note_start(const Surfaces& s, const Springs& springs, const Sleep& sleep, SelfContactStart& start) {
    start.body.clear(), start.particles.clear(), start.offset.clear();
    for (uint32_t body = 0; body < s.bodies.self_contact.size(); ++body) {
        const uint32_t mesh = s.bodies.mesh[body];
        if (!(s.bodies.self_contact[body] > 0) || mesh == kNone || !is_deformable(s.bodies, body) || is_asleep(sleep, body) ||
            springs.info[mesh].skin > 0)
            continue;
        const Range range = s.bodies.particles[body];
        start.body.push_back(body);
        start.particles.push_back({static_cast<uint32_t>(start.offset.size()), range.count});
        const auto from = s.particles.offset.begin() + range.first;
        start.offset.insert(start.offset.end(), from, from + range.count);
    }
}

void hold_surfaces(const SelfContactStart& start, const Meshes& meshes, const EnergyInputs& inputs, bool account_energy,
                   HeldSurfacesScratch& scratch, HeldSurfacesState state) {
    for (size_t i = 0; i < start.body.size(); ++i) {
        const uint32_t body = start.body[i];
        const Range range = start.particles[i];
        const CrossedBody b{body, mesh_view(meshes, inputs.bodies.mesh[body]), std::span(start.offset).subspan(range.first, range.count),
                            state.particles, inputs.bodies.particles[body].first};
        if (count_crossing_faces(b.mesh.triangle, b.offset(), scratch.crossing) == 0) continue;
        if (count_crossing_faces(b.mesh.triangle, b.start.data(), scratch.crossing) > 0) continue;
        const double before = account_energy ? energy_of(inputs, body, scratch.energy) : 0;
        hold_body(inputs, b, scratch);
        state.report.held_vertices += std::ranges::count_if(scratch.vertex, [&](uint32_t v) { return scratch.share[v] < 1; });
        if (account_energy) state.energy.work_numeric += energy_of(inputs, body, scratch.energy) - before;
    }
}

}  // namespace trocar
