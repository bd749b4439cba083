#include "systems/edges_ahead.hpp"

#include <algorithm>
#include <cmath>

#include "engine/bit_rows.hpp"
#include "engine/geometry/contact_kernels.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

constexpr double kAligned = 0.1;  // sine between edges that are left to their ends
constexpr double kEnd = 0.01;      // of an edge: nearer to an end the vertex has the row
constexpr double kBeside = 0.2;    // of an edge: where they meet in the end may lie so far beyond its ends
constexpr double kNear = 0.05;     // of an edge: what comes so near counts as crossing, as bodies bend on their way

// One pair: the edges of `body`, the finer one, against those of `other`.
struct Side {
    uint32_t row, body, other;
    MeshView mesh, other_mesh;
    BodyPoints other_points;
    std::span<const std::array<uint32_t, 2>> crossing, other_crossing;  // edges that have a contact already, ascending
    double period, fall, margin;
};

Vec4d velocity_at(const Surfaces& s, uint32_t body, uint32_t vertex, Vec4d place, const Vec3d& base) {
    if (is_deformable(s.bodies, body)) {
        const uint32_t i = s.bodies.particles[body].first + vertex;
        return make_vec4(s.particles.velocity_x[i], s.particles.velocity_y[i], s.particles.velocity_z[i]);
    }
    const Vec3d arm = to_vec3(place) - (s.poses.origin[body] - base);
    return to_vec4(s.poses.velocity[body] + s.poses.angular_velocity[body].cross(arm));
}

// Where two lines p + s u and q + t v are nearest to each other; false if they are nearly parallel.
struct LineShares {
    double s, t;
};
bool find_nearest_shares(Vec4d p, Vec4d u, Vec4d q, Vec4d v, LineShares& at) {
    const Vec4d r = p - q;
    const double uu = norm2(u), vv = norm2(v), uv = dot(u, v), ru = dot(r, u), rv = dot(r, v);
    const double det = uu * vv - uv * uv;
    if (!(det > kAligned * kAligned * uu * vv)) return false;
    at = {(uv * rv - vv * ru) / det, (uu * rv - uv * ru) / det};
    return true;
}
bool is_within(const LineShares& at, double beyond) {
    return at.s > -beyond && at.s < 1 + beyond && at.t > -beyond && at.t < 1 + beyond;
}

// An edge between two places that move uniformly.
struct MovingEdge {
    Vec4d start, way, start_velocity, way_velocity;
    Vec4d start_after(double time) const { return start + time * start_velocity; }
    Vec4d way_after(double time) const { return way + time * way_velocity; }
};

// Whether two edges that are nearest to each other at `at` are apart now and cross within the period, or nearly. The normal is
// of now.
bool will_cross(const Side& side, const MovingEdge& a, const MovingEdge& b, const LineShares& at, Vec4d& normal, double& distance) {
    const Vec4d apart = a.start + at.s * a.way - b.start - at.t * b.way;
    distance = std::sqrt(norm2(apart));
    const double length = std::sqrt(norm2(a.way));
    if (!(distance < side.margin && distance > 1e-9 * length)) return false;
    normal = apart / distance;
    const Vec4d coming = a.start_velocity + at.s * a.way_velocity - b.start_velocity - at.t * b.way_velocity;
    if (distance + side.period * dot(normal, coming) > kNear * length + side.fall) return false;
    LineShares then;
    return find_nearest_shares(a.start_after(side.period), a.way_after(side.period), b.start_after(side.period), b.way_after(side.period), then) &&
           is_within(then, kBeside);
}

bool has_contact(std::span<const std::array<uint32_t, 2>> crossing, const std::array<uint32_t, 2>& edge) {
    return std::binary_search(crossing.begin(), crossing.end(), edge);
}

void add_found(const Side& side, const std::array<uint32_t, 2>& edge, uint32_t other_edge, const LineShares& at, Vec4d normal, double distance,
               EdgesAheadChunk& c) {
    EdgeAhead& e = c.found.emplace_back();
    e.body = side.body;
    e.other = side.other;
    e.vertex = edge;
    e.along = float(at.s);
    e.triangle = side.other_mesh.triangle[side.other_mesh.edge_triangle[other_edge][0]];
    const float along = float(at.t);
    for (int k = 0; k < 3; ++k) {
        if (e.triangle[k] == side.other_mesh.edge[other_edge][1]) e.weight[k] = along;
        if (e.triangle[k] == side.other_mesh.edge[other_edge][0]) e.weight[k] = 1.0f - along;
    }
    e.normal = to_vec3(normal);
    e.distance = distance;
}

void search_edge(const Surfaces& s, const Side& side, uint32_t edge, EdgesAheadChunk& c) {
    const auto& ends = side.mesh.edge[edge];
    const EdgeAheadEnd &from = c.end[ends[0]], &to = c.end[ends[1]];
    if (from.distance < 0 || to.distance < 0) return;
    const MovingEdge a{from.place, to.place - from.place, from.velocity, to.velocity - from.velocity};
    // no point of the edge is nearer than this
    if (from.distance + to.distance - std::sqrt(norm2(a.way)) > 2 * side.margin) return;
    if (has_contact(side.crossing, ends)) return;
    std::array<uint32_t, 6> asked;
    uint32_t count = 0;
    for (const uint32_t triangle : {from.triangle, to.triangle})
        for (const uint32_t other_edge : side.other_mesh.triangle_edge[triangle])
            if (std::find(asked.begin(), asked.begin() + count, other_edge) == asked.begin() + count) asked[count++] = other_edge;
    for (uint32_t i = 0; i < count; ++i) {
        const auto& across = side.other_mesh.edge[asked[i]];
        const Vec4d q = (Vec4d)side.other_points(across[0]), r = (Vec4d)side.other_points(across[1]);
        MovingEdge b{q, r - q, Vec4d{}, Vec4d{}};
        LineShares at;
        if (!find_nearest_shares(a.start, a.way, b.start, b.way, at) || !is_within(at, -kEnd)) continue;
        const Vec3d& base = s.poses.origin[side.other];
        b.start_velocity = velocity_at(s, side.other, across[0], q, base);
        b.way_velocity = velocity_at(s, side.other, across[1], r, base) - b.start_velocity;
        Vec4d normal;
        double distance;
        if (!will_cross(side, a, b, at, normal, distance) || has_contact(side.other_crossing, across)) continue;
        add_found(side, ends, asked[i], at, normal, distance, c);
    }
}

// What is known of the vertices near the other body, and the edges between them at triangles near it.
void collect(const Surfaces& s, const Side& side, const CandidateTriangles& candidates, const NearVertices& near, EdgesAheadChunk& c) {
    c.near_vertex.assign((side.mesh.position.size() + 63) / 64, 0);
    c.edge.assign((side.mesh.edge.size() + 63) / 64, 0);
    if (c.end.size() < side.mesh.position.size()) c.end.resize(side.mesh.position.size());
    const Vec3d& base = s.poses.origin[side.other];
    const BodyPoints points(s, side.body, base);
    const Range vertices = near.side[side.row];
    for (uint32_t i = vertices.first; i < vertices.end(); ++i) {
        const uint32_t v = near.vertex[i];
        set_bit(c.near_vertex, v);
        const Vec4d place = (Vec4d)points(v);
        c.end[v] = {place, velocity_at(s, side.body, v, place, base), near.distance[i], near.triangle[i]};
    }
    const Range triangles = candidates.side[side.row];
    for (uint32_t i = triangles.first; i < triangles.end(); ++i)
        for (const uint32_t edge : side.mesh.triangle_edge[candidates.near[i][0]]) {
            const auto [v, w] = side.mesh.edge[edge];
            if (has_bit(c.near_vertex, v) && has_bit(c.near_vertex, w)) set_bit(c.edge, edge);
        }
}

bool is_closed(const Surfaces& s, uint32_t body) {
    const Admission admission = s.meshes.info[s.bodies.mesh[body]].admission;
    return admission == Admission::kSolid || admission == Admission::kWinding;
}

bool is_wanted(const Surfaces& s, uint32_t a, uint32_t b) {
    const auto is_free = [&](uint32_t body) { return s.bodies.motion[body] == Motion::kHand || s.bodies.motion[body] == Motion::kFree; };
    return (is_deformable(s.bodies, a) || is_deformable(s.bodies, b)) && !is_free(a) && !is_free(b) && is_closed(s, a) && is_closed(s, b);
}

// Contacts of one side of a pair that are on edges: their ends, in order.
std::span<const std::array<uint32_t, 2>> edges_of(const Contacts& contacts, uint32_t first, uint32_t end, uint32_t body) {
    const auto is_before = [&](uint32_t i) {
        return contacts.body[i] < body || (contacts.body[i] == body && contacts.vertex[i][0] == contacts.vertex[i][1]);
    };
    while (first < end && is_before(first)) ++first;
    uint32_t last = first;
    while (last < end && contacts.body[last] == body && contacts.third[last] == kNone) ++last;
    return std::span(contacts.vertex).subspan(first, last - first);
}

void find_in_pair(double period, double fall, const Surfaces& s, const BodyBoxes& boxes, const CandidatePairs& pairs, uint32_t pair,
                  const CandidateTriangles& candidates, const NearVertices& near, const Contacts& contacts,
                  std::span<const uint32_t> contact_first, EdgesAheadChunk& c) {
    const uint32_t a = pairs.a[pair], b = pairs.b[pair];
    if (!is_wanted(s, a, b)) return;
    const auto mean_edge = [&](uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].mean_edge; };
    const bool reversed = mean_edge(b) < mean_edge(a);
    const uint32_t body = reversed ? b : a, other = reversed ? a : b;
    const uint32_t row = 2 * pair + reversed;
    if (near.side[row].count == 0) return;
    const auto crossing = [&](uint32_t of) { return edges_of(contacts, contact_first[pair], contact_first[pair + 1], of); };
    const Side side{row, body, other, mesh_view(s.meshes, s.bodies.mesh[body]), mesh_view(s.meshes, s.bodies.mesh[other]),
                    BodyPoints(s, other, s.poses.origin[other]), crossing(body), crossing(other), period, fall, boxes.margin[a] + boxes.margin[b]};
    collect(s, side, candidates, near, c);
    for_each_bit(c.edge, [&](uint32_t edge) { search_edge(s, side, edge, c); });
}

void append_row(const Surfaces& s, const EdgeAhead& e, ContactRows& rows) {
    rows.contact.push_back(kNone);
    rows.body.push_back(e.body);
    rows.other.push_back(e.other);
    rows.vertex.push_back(e.vertex);
    rows.along.push_back(e.along);
    rows.third.push_back(kNone);
    rows.across.push_back(0);
    rows.triangle.push_back(e.triangle);
    rows.weight.push_back(e.weight);
    rows.normal.push_back(is_deformable(s.bodies, e.other) ? e.normal : rotate_back(s.poses.orientation[e.other], e.normal));
    rows.distance.push_back(e.distance);
    rows.friction.push_back(float(std::max(s.bodies.tissue[e.body].friction, s.bodies.tissue[e.other].friction)));
    rows.impulse.push_back(Vec3d::Zero());
}

}  // namespace

void add_edges_ahead(double period, double fall, const Surfaces& surfaces, const BodyBoxes& boxes, const CandidatePairs& pairs,
                     const CandidateTriangles& candidates, const NearVertices& near, const Contacts& contacts,
                     EdgesAheadScratch& scratch, ContactRows& rows) {
    const uint32_t count = uint32_t(pairs.a.size()), grain = std::max(1u, chunk_count(count, kMostChunks));
    scratch.contact_first.assign(count + 1, 0);
    for (const uint32_t pair : contacts.pair) ++scratch.contact_first[pair + 1];
    for (uint32_t pair = 0; pair < count; ++pair) scratch.contact_first[pair + 1] += scratch.contact_first[pair];
    if (scratch.chunk.size() < chunk_count(count, grain)) scratch.chunk.resize(chunk_count(count, grain));
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        EdgesAheadChunk& chunk = scratch.chunk[begin / grain];
        chunk.found.clear();
        for (uint32_t pair = begin; pair < end; ++pair)
            find_in_pair(period, fall, surfaces, boxes, pairs, pair, candidates, near, contacts, scratch.contact_first, chunk);
    });
    for (uint32_t i = 0; i < chunk_count(count, grain); ++i)
        for (const EdgeAhead& e : scratch.chunk[i].found) append_row(surfaces, e, rows);
}

}  // namespace trocar
