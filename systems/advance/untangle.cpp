#include "systems/advance/untangle.hpp"

#include <algorithm>
#include <cmath>

#include "engine/contact/contact_constraints.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/predicates.hpp"
#include "engine/tissue/link_energy.hpp"
namespace trocar {
namespace {

constexpr double kMostShift = 0.05;       // of a mean edge, of a vertex in a pass: 6 edges/s at 120 Hz
constexpr double kLeastSlope = 0.1;       // cosine of edge and normal, below which the gradient grows no more
constexpr double kFullGradient = 0.3;     // gradients above this take the whole step
constexpr double kLeastShiftShare = 1.0 / 16;  // of the shifts, that is tried
constexpr double kSpark = 0.0025;         // of a mean edge, by which springs may be longer than what the surface has as energy allows

Vec3d place(const SideBySide& s, uint32_t v) { return {s.position[v].x, s.position[v].y, s.position[v].z}; }

// Adds the edge `k` of a face if it goes through another face: exact.
void add_edge(const SideBySide& s, const Triangle& face, uint32_t k, const Triangle& crossed, std::vector<EdgeThroughFace>& edges) {
    const uint32_t v = face[k], w = face[(k + 1) % 3];
    if (std::ranges::any_of(crossed, [&](uint32_t c) { return c == v || c == w; })) return;
    const Vec3d p = place(s, v), q = place(s, w), a = place(s, crossed[0]), b = place(s, crossed[1]), c = place(s, crossed[2]);
    if (orient3d(a, b, c, p) * orient3d(a, b, c, q) >= 0) return;
    const int first = orient3d(p, q, a, b);
    if (first == 0 || orient3d(p, q, b, c) != first || orient3d(p, q, c, a) != first) return;
    const Vec3d normal = triangle_normal(a, b, c), own = triangle_normal(p, q, place(s, face[(k + 2) % 3]));
    const double from = normal.dot(p - a), to = normal.dot(q - a), share = std::clamp(from / (from - to), 0.0, 1.0);
    EdgeThroughFace e;
    e.vertex = {v, w, crossed[0], crossed[1], crossed[2]};
    const std::array<float, 3> weight = barycentric_weights(p + share * (q - p), a, b, c);
    e.weight = {1 - share, share, -double{weight[0]}, -double{weight[1]}, -double{weight[2]}};
    const Vec3d across = normal.normalized(), along = (q - p).normalized();
    Vec3d line = own.normalized().cross(across);
    if (!(line.norm() > 0)) return;
    line.normalize();
    if (line.dot(own.cross(q - p)) < 0) line = -line;  // into the face
    const double slope = along.dot(across);
    e.shift = line - along.dot(line) / std::copysign(std::max(std::abs(slope), kLeastSlope), slope) * across;
    if (e.shift.allFinite()) edges.push_back(e);
}

void find_edges(UntangleScratch& s) {
    find_crossing_pairs(s.surface.triangle, s.surface.position.data(), s.crossing, s.pairs);
    s.edges.clear();
    for (const auto& [t, u] : s.pairs)
        for (uint32_t k = 0; k < 3; ++k) {
            add_edge(s.surface, s.surface.triangle[t], k, s.surface.triangle[u], s.edges);
            add_edge(s.surface, s.surface.triangle[u], k, s.surface.triangle[t], s.edges);
        }
}

// Sums up what moves each vertex: no edge moves its vertices farther than all edges of one of them may together.
void sum_shifts(double most, UntangleScratch& s) {
    s.count.assign(s.surface.position.size(), 0);
    s.shift.assign(s.surface.position.size(), Vec3d::Zero());
    for (const EdgeThroughFace& e : s.edges)
        for (const uint32_t v : e.vertex) ++s.count[v];
    for (const EdgeThroughFace& e : s.edges) {
        uint32_t crowd = 1;
        double response = 0, greatest = 0;
        for (size_t k = 0; k < 5; ++k) {
            const double w = s.surface.position[e.vertex[k]].w;
            crowd = std::max(crowd, s.count[e.vertex[k]]);
            response += e.weight[k] * e.weight[k] * w;
            greatest = std::max(greatest, std::abs(e.weight[k]) * w);
        }
        if (!(response > 0)) continue;
        const double size = e.shift.norm(), step = most / std::max(size, kFullGradient);
        // as far as it goes, but no vertex farther than `most`
        const double factor = step * std::min(1 / response, most / (greatest * std::max(step * size, 1e-30))) / crowd;
        for (size_t k = 0; k < 5; ++k) s.shift[e.vertex[k]] += (e.weight[k] * double{s.surface.position[e.vertex[k]].w} * factor) * e.shift;
    }
}

// Of the whole body or both, J.
Energy energy_with(const EnergyInputs& inputs, uint32_t body, uint32_t other, BodyEnergyScratch& scratch) {
    Energy sum;
    add_body_energy(inputs, body, scratch, sum);
    if (other != body) add_body_energy(inputs, other, scratch, sum);
    sum.links = energy_of_links(inputs, body, other);
    return sum;
}

double own_energy(const Energy& e) { return e.kinetic + e.elastic + e.pressure + e.bending + e.links; }

// Energy of a surface whose springs are all longer by kSpark of a mean edge, J.
double most_energy(const Surfaces& s, uint32_t body) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const double stretch = kSpark * mesh.info->mean_edge;
    return 0.5 * double{s.bodies.spring_stiffness[body]} * stretch * stretch * static_cast<double>(mesh.edge.size());
}

// visit(vertex of both, its particle) for all vertices that are moved.
template <typename Visit>
void each_shifted(const Bodies& bodies, uint32_t body, uint32_t other, const UntangleScratch& s, const Visit& visit) {
    const uint32_t vertices = s.surface.vertices;
    for (uint32_t v = 0; v < s.surface.position.size(); ++v)
        if (s.shift[v] != Vec3d::Zero())
            visit(v, v < vertices ? bodies.particles[body].first + v : bodies.particles[other].first + v - vertices);
}

void draw_apart(const TangledSurfaces& t, uint32_t body, uint32_t other, UntangleScratch& s, Particles& particles, Energy& energy,
                Report& report) {
    const Bodies& bodies = t.surfaces.bodies;
    put_side_by_side(t.surfaces, body, other, offsets_of(t.surfaces, body), offsets_of(t.surfaces, other), s.surface);
    find_edges(s);
    const auto edge_of = [&](uint32_t b) { return t.surfaces.meshes.info[bodies.mesh[b]].mean_edge; };
    sum_shifts(kMostShift * std::min(edge_of(body), edge_of(other)), s);
    const Energy before = energy_with(t.inputs, body, other, s.energy);
    s.offset.resize(s.surface.position.size());
    each_shifted(bodies, body, other, s, [&](uint32_t v, uint32_t particle) { s.offset[v] = particles.offset[particle]; });
    const double most = std::max(own_energy(before), most_energy(t.surfaces, body) + (other != body ? most_energy(t.surfaces, other) : 0));
    Energy after;
    double share = 1;
    for (; share >= kLeastShiftShare; share *= 0.5) {
        each_shifted(bodies, body, other, s, [&](uint32_t v, uint32_t particle) {
            const Float4& from = s.offset[v];
            const Vec3d shift = share * s.shift[v];
            particles.offset[particle] = {static_cast<float>(from.x + shift.x()), static_cast<float>(from.y + shift.y()),
                                          static_cast<float>(from.z + shift.z()), from.w};
        });
        after = energy_with(t.inputs, body, other, s.energy);
        if (own_energy(after) <= most) break;
    }
    if (share < kLeastShiftShare) {  // stays crossed
        each_shifted(bodies, body, other, s, [&](uint32_t v, uint32_t particle) { particles.offset[particle] = s.offset[v]; });
        return;
    }
    stretch_links(t.inputs, body);
    if (other != body) stretch_links(t.inputs, other);
    report.untangled_edges += s.edges.size();
    if (t.account_energy) energy.work_push += own_energy(after) + after.gravity - own_energy(before) - before.gravity;
}

}  // namespace

void untangle(const TangledSurfaces& t, UntangleScratch& scratch, Particles& particles, Energy& energy, Report& report,
              CrossedSurfaces& crossed) {
    const auto at_start = [&](uint32_t body) {
        const auto found = std::ranges::find(t.start.body, body);
        if (found == t.start.body.end()) return offsets_of(t.surfaces, body);  // asleep
        const Range range = t.start.particles[static_cast<size_t>(found - t.start.body.begin())];
        return std::span<const Float4>(t.start.offset).subspan(range.first, range.count);
    };
    const auto cross = [&](uint32_t body, uint32_t other, std::span<const Float4> at, std::span<const Float4> other_at) {
        put_side_by_side(t.surfaces, body, other, at, other_at, scratch.surface);
        const SideBySide& both = scratch.surface;
        if (count_crossing_faces(both.triangle, both.position.data(), scratch.crossing) == 0) return false;
        find_crossing_pairs(both.triangle, both.position.data(), scratch.crossing, scratch.pairs);
        const uint32_t first = both.triangles;
        return std::ranges::any_of(scratch.pairs, [&](const std::array<uint32_t, 2>& p) { return (p[0] < first) != (p[1] < first); });
    };
    for (size_t i = 0; i < t.pairs.a.size(); ++i) {
        const uint32_t body = std::min(t.pairs.a[i], t.pairs.b[i]), other = std::max(t.pairs.a[i], t.pairs.b[i]);
        if (!touch_as_sheets(t.surfaces, body, other) || (is_asleep(t.sleep, body) && is_asleep(t.sleep, other))) continue;
        const auto is_pair = [&](size_t k) { return t.before.body[k] == body && t.before.other[k] == other; };
        bool before = false;
        for (size_t k = 0; k < t.before.body.size(); ++k) before |= is_pair(k);
        if (cross(body, other, offsets_of(t.surfaces, body), offsets_of(t.surfaces, other)) ||
            (before && cross(body, other, at_start(body), at_start(other))))
            crossed.body.push_back(body), crossed.other.push_back(other);
    }
    const auto sleeps = [&](size_t i, const CrossedSurfaces& c) { return is_asleep(t.sleep, c.body[i]) && is_asleep(t.sleep, c.other[i]); };
    for (size_t i = 0; i < t.before.body.size(); ++i)
        if (t.before.body[i] != t.before.other[i] && sleeps(i, t.before))
            crossed.body.push_back(t.before.body[i]), crossed.other.push_back(t.before.other[i]);
    for (size_t i = 0; i < crossed.body.size(); ++i)
        if (!sleeps(i, crossed)) draw_apart(t, crossed.body[i], crossed.other[i], scratch, particles, energy, report);
}

}  // namespace trocar
