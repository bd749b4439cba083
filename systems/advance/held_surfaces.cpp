#include "systems/advance/held_surfaces.hpp"

#include <algorithm>

#include "engine/contact/sleeping_bodies.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostRings = 6;  // added one by one before the whole body is held

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

// Puts the held vertices where they were, displaced by their mean displacement.
void put_back(const CrossedBody& b, const HeldSurfacesScratch& scratch) {
    Vec3d shift = Vec3d::Zero();
    if (all_free(b, scratch.vertex))
        shift = mean_of(b, scratch.vertex, [&](uint32_t v) {
            const Float4 &from = b.start[v], &to = scratch.reached[v];
            return Vec3d(double{to.x} - double{from.x}, double{to.y} - double{from.y}, double{to.z} - double{from.z});
        });
    for (const uint32_t v : scratch.vertex) {
        const Float4& from = b.start[v];
        Float4& to = b.offset()[v];
        to.x = static_cast<float>(double{from.x} + shift.x());
        to.y = static_cast<float>(double{from.y} + shift.y());
        to.z = static_cast<float>(double{from.z} + shift.z());
    }
}

void share_velocity(const CrossedBody& b, std::span<const uint32_t> vertices) {
    Particles& p = b.particles;
    Vec3d mean = Vec3d::Zero();
    if (all_free(b, vertices))
        mean = mean_of(b, vertices, [&](uint32_t v) {
            return Vec3d(p.velocity_x[b.first + v], p.velocity_y[b.first + v], p.velocity_z[b.first + v]);
        });
    for (const uint32_t v : vertices) {
        p.velocity_x[b.first + v] = static_cast<float>(mean.x());
        p.velocity_y[b.first + v] = static_cast<float>(mean.y());
        p.velocity_z[b.first + v] = static_cast<float>(mean.z());
    }
}

// Puts the whole body back where it started.
void hold_all(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    for (uint32_t v = 0; v < b.start.size(); ++v)
        if (v < b.mesh.position.size() || b.start[v].w > 0) hold_vertex(v, scratch);  // not padding
    std::copy(b.start.begin(), b.start.end(), b.offset());
    share_velocity(b, scratch.vertex);
}

void hold_body(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const auto crosses = [&] {
        find_crossing_faces(b.mesh.triangle, b.offset(), scratch.crossing, scratch.faces);
        return !scratch.faces.empty();
    };
    scratch.reached.assign(b.offset(), b.offset() + b.start.size());
    scratch.held.assign(b.start.size(), 0);
    scratch.vertex.clear();
    bool crossed = crosses();
    for (uint32_t ring = 0; crossed && ring < kMostRings; ++ring) {
        hold_faces(b, scratch);
        hold_ring(b, scratch);
        put_back(b, scratch);
        crossed = crosses();
    }
    if (crossed) return hold_all(b, scratch);
    share_velocity(b, scratch.vertex);
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
        const double before = energy_of(inputs, body, scratch.energy);
        hold_body(b, scratch);
        if (!(energy_of(inputs, body, scratch.energy) <= before)) hold_all(b, scratch);
        state.report.held_vertices += scratch.vertex.size();
        if (account_energy) state.energy.work_numeric += energy_of(inputs, body, scratch.energy) - before;
    }
}

}  // namespace trocar
