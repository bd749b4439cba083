#include "systems/edges_ahead.hpp"

#include <algorithm>
#include <cmath>

#include "engine/bit_rows.hpp"
#include "engine/geometry/contact_kernels.hpp"
#include "engine/pair_sides.hpp"
#include "engine/parallel.hpp"
#include "engine/subspan.hpp"
namespace trocar {
namespace {

constexpr double kAligned = 0.1;  // sine between edges that are left to their ends
constexpr double kEnd = 0.01;     // of an edge: nearer to an end the vertex has the row
constexpr double kBeside = 0.2;   // of an edge: where they meet in the end may lie so far beyond its ends
constexpr double kNear = 0.05;    // of an edge: what comes so near counts as crossing, as bodies bend on their way

// One pair: the edges of `body`, the finer one, against those of `other`.
struct Side {
    uint32_t row, body, other;
    MeshView mesh, other_mesh;
    BodyPoints other_points;
    std::span<const std::array<uint32_t, 2>> crossing, other_crossing;  // edges that have a contact already, ascending
    double margin;                                                      // m, of both bodies
};

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
bool is_within(const LineShares& at, double beyond) { return at.s > -beyond && at.s < 1 + beyond && at.t > -beyond && at.t < 1 + beyond; }

// An edge between two places that move uniformly.
struct MovingEdge {
    Vec4d start, way, start_velocity, way_velocity;
    Vec4d start_after(double time) const { return start + time * start_velocity; }
    Vec4d way_after(double time) const { return way + time * way_velocity; }
};

// Whether two edges that are nearest to each other at `at` are apart now and cross within the period, or nearly. The normal is
// of now.
bool will_cross(const ContactInputs& in, const Side& side, const MovingEdge& a, const MovingEdge& b, const LineShares& at, Vec4d& normal,
                double& distance) {
    const Vec4d apart = a.start + at.s * a.way - b.start - at.t * b.way;
    distance = std::sqrt(norm2(apart));
    const double length = std::sqrt(norm2(a.way));
    if (!(distance < side.margin && distance > 1e-9 * length)) return false;
    normal = apart / distance;
    const Vec4d coming = a.start_velocity + at.s * a.way_velocity - b.start_velocity - at.t * b.way_velocity;
    if (distance + in.period * dot(normal, coming) > kNear * length + in.fall) return false;
    LineShares then;
    return find_nearest_shares(a.start_after(in.period), a.way_after(in.period), b.start_after(in.period), b.way_after(in.period), then) &&
           is_within(then, kBeside);
}

bool has_contact(std::span<const std::array<uint32_t, 2>> crossing, const std::array<uint32_t, 2>& edge) {
    return std::binary_search(crossing.begin(), crossing.end(), edge);
}

// Adds the meeting of an edge, which moves as `a`, with one of the other body's at a triangle.
void ask_pair(const ContactInputs& in, const Side& side, const std::array<uint32_t, 2>& ends, const MovingEdge& a, uint32_t triangle,
              uint32_t other_edge, EdgesAheadChunk& c) {
    const auto& across = side.other_mesh.edge[other_edge];
    const Vec4d q = (Vec4d)side.other_points(across[0]), r = (Vec4d)side.other_points(across[1]);
    MovingEdge b{q, r - q, Vec4d{}, Vec4d{}};
    LineShares at;
    if (!find_nearest_shares(a.start, a.way, b.start, b.way, at) || !is_within(at, -kEnd)) return;
    b.start_velocity = to_vec4(vertex_velocity(in.surfaces, side.other, across[0]));
    b.way_velocity = to_vec4(vertex_velocity(in.surfaces, side.other, across[1])) - b.start_velocity;
    Vec4d normal;
    double distance;
    if (!will_cross(in, side, a, b, at, normal, distance) || has_contact(side.other_crossing, across)) return;
    c.found.push_back({side.body, side.other, ends, across, float(at.s), float(at.t), triangle, to_vec3(normal), distance});
}

void search_edge(const ContactInputs& in, const Side& side, uint32_t edge, EdgesAheadChunk& c) {
    const auto& ends = side.mesh.edge[edge];
    const EdgeAheadEnd &from = c.end[ends[0]], &to = c.end[ends[1]];
    if (from.distance < 0 || to.distance < 0) return;
    const MovingEdge a{from.place, to.place - from.place, from.velocity, to.velocity - from.velocity};
    // no point of the edge is nearer than this
    if (from.distance + to.distance - std::sqrt(norm2(a.way)) > 2 * side.margin) return;
    if (has_contact(side.crossing, ends)) return;
    const auto& first = side.other_mesh.triangle_edge[from.triangle];
    for (const uint32_t e : first) ask_pair(in, side, ends, a, from.triangle, e, c);
    for (const uint32_t e : side.other_mesh.triangle_edge[to.triangle])
        if (std::find(first.begin(), first.end(), e) == first.end()) ask_pair(in, side, ends, a, to.triangle, e, c);
}

// What is known of the vertices near the other body, and the edges between them at triangles near it.
void collect(const Surfaces& s, const CandidateTriangles& candidates, const NearVertices& near, const Side& side, EdgesAheadChunk& c) {
    c.near_vertex.assign((side.mesh.position.size() + 63) / 64, 0);
    c.edge.assign((side.mesh.edge.size() + 63) / 64, 0);
    if (c.end.size() < side.mesh.position.size()) c.end.resize(side.mesh.position.size());
    const BodyPoints points(s, side.body, s.poses.origin[side.other]);
    const Range vertices = near.side[side.row];
    for (uint32_t i = vertices.first; i < vertices.end(); ++i) {
        const uint32_t v = near.vertex[i];
        set_bit(c.near_vertex, v);
        c.end[v] = {(Vec4d)points(v), to_vec4(vertex_velocity(s, side.body, v)), near.distance[i], near.triangle[i]};
    }
    for (const auto& [triangle, nearest] : subspan(candidates.near, candidates.side[side.row]))
        for (const uint32_t edge : side.mesh.triangle_edge[triangle]) {
            const auto [v, w] = side.mesh.edge[edge];
            if (has_bit(c.near_vertex, v) && has_bit(c.near_vertex, w)) set_bit(c.edge, edge);
        }
}

bool is_wanted(const Surfaces& s, uint32_t a, uint32_t b) {
    const auto is_free = [&](uint32_t body) { return s.bodies.motion[body] == Motion::kHand || s.bodies.motion[body] == Motion::kFree; };
    return (is_deformable(s.bodies, a) || is_deformable(s.bodies, b)) && !is_free(a) && !is_free(b) && has_inside(s, a) && has_inside(s, b);
}

// Contacts of one side of a pair, whose contacts are `rows`, that are on edges: their ends, in order.
std::span<const std::array<uint32_t, 2>> edges_of(const Contacts& contacts, Range rows, uint32_t body) {
    const auto is_before = [&](uint32_t i) {
        return contacts.body[i] < body || (contacts.body[i] == body && contacts.vertex[i][0] == contacts.vertex[i][1]);
    };
    uint32_t first = rows.first;
    while (first < rows.end() && is_before(first)) ++first;
    uint32_t last = first;
    while (last < rows.end() && contacts.body[last] == body && contacts.third[last] == kNone) ++last;
    return std::span(contacts.vertex).subspan(first, last - first);
}

void find_in_pair(const ContactInputs& in, const CandidateTriangles& candidates, const NearVertices& near, const Contacts& contacts,
                  Range rows, uint32_t pair, EdgesAheadChunk& c) {
    const Surfaces& s = in.surfaces;
    const uint32_t a = in.pairs.a[pair], b = in.pairs.b[pair];
    if (!is_wanted(s, a, b)) return;
    const auto mean_edge = [&](uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].mean_edge; };
    const bool reversed = mean_edge(b) < mean_edge(a);
    const uint32_t row = 2 * pair + reversed, body = reversed ? b : a, other = reversed ? a : b;
    if (near.side[row].count == 0) return;
    const Side side{row,
                    body,
                    other,
                    mesh_view(s.meshes, s.bodies.mesh[body]),
                    mesh_view(s.meshes, s.bodies.mesh[other]),
                    BodyPoints(s, other, s.poses.origin[other]),
                    edges_of(contacts, rows, body),
                    edges_of(contacts, rows, other),
                    margin_between(in.boxes, a, b)};
    collect(s, candidates, near, side, c);
    for_each_bit(c.edge, [&](uint32_t edge) { search_edge(in, side, edge, c); });
}

}  // namespace

void add_edges_ahead(const ContactInputs& in, const CandidateTriangles& candidates, const NearVertices& near, const Contacts& contacts,
                     EdgesAheadScratch& scratch, ContactRows& rows) {
    const uint32_t count = uint32_t(in.pairs.a.size()), grain = coarse_grain(count);
    find_first_contacts(contacts, count, scratch.contact_first);
    if (scratch.chunk.size() < chunk_count(count, grain)) scratch.chunk.resize(chunk_count(count, grain));
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        EdgesAheadChunk& chunk = scratch.chunk[begin / grain];
        chunk.found.clear();
        for (uint32_t pair = begin; pair < end; ++pair)
            find_in_pair(in, candidates, near, contacts, range_at(scratch.contact_first, pair), pair, chunk);
    });
    for (uint32_t i = 0; i < chunk_count(count, grain); ++i)
        for (const EdgeMeeting& m : scratch.chunk[i].found) append_edge_row(in.surfaces, m, rows);
}

}  // namespace trocar
