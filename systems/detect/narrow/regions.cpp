#include "systems/detect/narrow/regions.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/base/append.hpp"
#include "engine/base/disjoint_sets.hpp"
#include "engine/base/subspan.hpp"
#include "engine/contact/pair_sides.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

// One body of the pair.
struct Half {
    uint32_t body, first_node;
    Range screened, near;
    MeshView mesh;
    BodyPoints points;  // relative to the pair's centre
};

struct PairInput {
    const ScreenedTriangles& screened;
    const NearVertices& near;
    const Contacts& contacts;
    const Contours& contours;
    std::array<Half, 2> half;  // a, b
    uint32_t pair, first_point_node;
    Range points, segments, contact_range;  // of contours and of contacts
    Vec3d centre;                           // world, m; volumes are computed about it
};

uint32_t point_node(const PairInput& in, uint32_t point) { return in.first_point_node + point - in.points.first; }

void mark_inside(const PairInput& in, RegionsChunk& c) {
    c.inside.assign(in.first_point_node, 0);
    c.certain.assign(in.first_point_node, std::numeric_limits<double>::infinity());
    for (const Half& half : in.half) {
        for (uint32_t i = half.near.first; i < half.near.end(); ++i) {
            const uint32_t node = half.first_node + in.near.vertex[i];
            c.inside[node] = in.near.distance[i] < 0;
            c.certain[node] = std::abs(in.near.distance[i]);
        }
    }
}

// Points of the pair by body, edge and position along the edge.
void sort_points(const PairInput& in, RegionsChunk& c) {
    const Contours& k = in.contours;
    c.order.clear();
    for (uint32_t i = in.points.first; i < in.points.end(); ++i) c.order.push_back(i);
    std::sort(c.order.begin(), c.order.end(), [&](uint32_t x, uint32_t y) {
        if (k.edge_of_b[x] != k.edge_of_b[y]) return k.edge_of_b[x] < k.edge_of_b[y];
        if (k.edge[x] != k.edge[y]) return k.edge[x] < k.edge[y];
        return k.along[x] != k.along[y] ? k.along[x] < k.along[y] : k.pierced[x] < k.pierced[y];
    });
    uint32_t at = 0;
    for (uint32_t side = 0; side < 2; ++side) {
        c.hit_edge[side].clear();
        c.hit_first[side].clear();
        for (; at < c.order.size() && k.edge_of_b[c.order[at]] == side; ++at) {
            const uint32_t edge = k.edge[c.order[at]];
            if (!c.hit_edge[side].empty() && c.hit_edge[side].back() == edge) continue;
            c.hit_edge[side].push_back(edge);
            c.hit_first[side].push_back(at);
        }
        c.hit_first[side].push_back(at);
    }
}

// Points on an edge, in order along it.
std::span<const uint32_t> points_on(uint32_t side, uint32_t edge, const RegionsChunk& c) {
    const auto found = std::lower_bound(c.hit_edge[side].begin(), c.hit_edge[side].end(), edge);
    if (found == c.hit_edge[side].end() || *found != edge) return {};
    const size_t index = size_t(found - c.hit_edge[side].begin());
    return std::span(c.order).subspan(c.hit_first[side][index], c.hit_first[side][index + 1] - c.hit_first[side][index]);
}

// Net number of times the surface is entered along an edge.
int change_along(const PairInput& in, std::span<const uint32_t> points) {
    int change = 0;
    for (const uint32_t p : points) change += in.contours.outward[p] ? -1 : 1;
    return change;
}

// Whether the vertex signs and the crossings on the edges between them contradict each other.
bool is_doubtful(const PairInput& in, const RegionsChunk& c) {
    for (uint32_t side = 0; side < 2; ++side) {
        const Half& half = in.half[side];
        for (uint32_t index = half.screened.first; index < half.screened.end(); ++index) {
            const uint32_t triangle = in.screened.triangle[index];
            for (const uint32_t edge : half.mesh.triangle_edge[triangle]) {
                const auto& [u, v] = half.mesh.edge[edge];
                const int change = int(c.inside[half.first_node + v]) - int(c.inside[half.first_node + u]);
                if (change != change_along(in, points_on(side, edge, c))) return true;
            }
        }
    }
    return false;
}

// Root of a vertex and the vertex's winding relative to it.
std::pair<uint32_t, int> find_winding(uint32_t v, RegionsChunk& c) {
    int sum = 0;
    uint32_t root = v;
    for (; c.parent[root] != root; root = c.parent[root]) sum += c.winding[root];
    for (int left = sum; c.parent[v] != root && v != root;) {
        const uint32_t next = c.parent[v];
        const int own = c.winding[v];
        c.parent[v] = root;
        c.winding[v] = left;
        left -= own;
        v = next;
    }
    return {root, sum};
}

// Vertices on the other surface have no side of their own. Sides are propagated along edges from the most
// certain vertex, changed by each crossing, so that they are consistent with the contour.
void decide_doubtful(const PairInput& in, uint32_t side, RegionsChunk& c) {
    const Half& half = in.half[side];
    const uint32_t first = half.first_node, last = first + uint32_t(half.mesh.position.size());
    for (uint32_t v = first; v < last; ++v) c.parent[v] = v, c.winding[v] = 0;
    for (uint32_t index = half.screened.first; index < half.screened.end(); ++index) {
        for (const uint32_t edge : half.mesh.triangle_edge[in.screened.triangle[index]]) {
            const auto& [u, v] = half.mesh.edge[edge];
            const auto [root_u, more_u] = find_winding(first + u, c);
            const auto [root_v, more_v] = find_winding(first + v, c);
            if (root_u == root_v) continue;
            const int change = change_along(in, points_on(side, edge, c));
            c.parent[root_v] = root_u;
            c.winding[root_v] = more_u + change - more_v;
        }
    }
    // per root: its most certain member fixes its winding; if none is certain, the outermost is outside
    const double unsure = 1e-9 * half.mesh.info->radius;
    c.region.assign(c.parent.size(), kNone);
    for (uint32_t v = first; v < last; ++v) {
        uint32_t& best = c.region[find_winding(v, c).first];
        if (best == kNone || c.certain[v] > c.certain[best]) best = v;
    }
    for (uint32_t v = first; v < last; ++v) {
        uint32_t& best = c.region[find_winding(v, c).first];
        if (c.certain[best] > unsure) continue;
        if (find_winding(v, c).second < find_winding(best, c).second) best = v;
        c.inside[best] = 0;
    }
    for (uint32_t v = first; v < last; ++v) {
        const auto [root, more] = find_winding(v, c);
        const uint32_t best = c.region[root];
        if (v != best) c.inside[v] = int(c.inside[best]) + more - find_winding(best, c).second > 0;
    }
}

// Inside parts of an edge: the k-th entry (or the first vertex, if inside) is paired with the k-th exit.
void find_spans(const PairInput& in, uint32_t side, uint32_t edge, RegionsChunk& c) {
    c.span.clear();
    const auto& [u, v] = in.half[side].mesh.edge[edge];
    const uint32_t first = in.half[side].first_node;
    const auto points = points_on(side, edge, c);
    if (c.inside[first + u]) c.span.push_back({first + u, 0, 1});
    for (const uint32_t p : points) {
        if (!in.contours.outward[p]) c.span.push_back({point_node(in, p), in.contours.along[p], 1});
    }
    size_t index = 0;
    for (const uint32_t p : points) {
        if (!in.contours.outward[p] || index >= c.span.size()) continue;
        c.span[index++].to = in.contours.along[p];
    }
}

void join_half(const PairInput& in, uint32_t side, RegionsChunk& c) {
    const Half& half = in.half[side];
    for (uint32_t index = half.screened.first; index < half.screened.end(); ++index) {
        const uint32_t triangle = in.screened.triangle[index];
        for (uint32_t k = 0; k < 3; ++k) {
            const uint32_t u = half.first_node + half.mesh.triangle[triangle][k],
                           v = half.first_node + half.mesh.triangle[triangle][(k + 1) % 3];
            if (c.inside[u] && c.inside[v] && points_on(side, half.mesh.triangle_edge[triangle][k], c).empty()) {
                join_sets(c.parent, u, v);
            }
        }
    }
    for (uint32_t i = 0; i < c.hit_edge[side].size(); ++i) {
        const auto& [u, v] = half.mesh.edge[c.hit_edge[side][i]];
        find_spans(in, side, c.hit_edge[side][i], c);
        size_t index = 0;
        for (const uint32_t p : points_on(side, c.hit_edge[side][i], c)) {
            if (in.contours.outward[p] && index < c.span.size()) join_sets(c.parent, c.span[index++].node, point_node(in, p));
        }
        if (index < c.span.size() && c.inside[half.first_node + v]) join_sets(c.parent, c.span[index].node, half.first_node + v);
    }
}

// Numbers the regions: vertices of a, of b, points, ascending.
void number_regions(const PairInput& in, RegionsChunk& c) {
    c.region.assign(c.parent.size(), kNone);
    c.sum.clear();
    for (uint32_t node = 0; node < c.parent.size(); ++node) {
        if (node < in.first_point_node && !c.inside[node]) continue;
        uint32_t& region = c.region[find_set(c.parent, node)];
        if (region == kNone) {
            region = uint32_t(c.sum.size());
            c.sum.emplace_back();
        }
    }
}
RegionSum& region_of(uint32_t node, RegionsChunk& c) { return c.sum[c.region[find_set(c.parent, node)]]; }

// Adds `part` of the boundary piece p -> q of a flat patch through `corner` with unit normal: twice the area
// is the sum of cross products along the boundary, three times the volume below is area times height.
void add_piece(const Vec3d& corner, const Vec3d& unit, const Vec3d& p, const Vec3d& q, double part, RegionSum& sum) {
    const Vec3d area = 0.5 * part * (p - corner).cross(q - corner);
    sum.area += area.dot(unit);
    sum.volume += area.dot(corner) / 3;
    grow(sum.box, p);
    grow(sum.box, q);
}

void measure_half(const PairInput& in, uint32_t side, RegionsChunk& c) {
    const Half& half = in.half[side];
    for (uint32_t index = half.screened.first; index < half.screened.end(); ++index) {
        const uint32_t triangle = in.screened.triangle[index];
        const Triangle& t = half.mesh.triangle[triangle];
        const auto& edges = half.mesh.triangle_edge[triangle];
        const Vec3d corner[3] = {half.points.point(t[0]), half.points.point(t[1]), half.points.point(t[2])};
        const Vec3d unit = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
        for (uint32_t k = 0; k < 3; ++k) {
            const uint32_t l = (k + 1) % 3, node = half.first_node + t[k];
            if (points_on(side, edges[k], c).empty()) {
                if (c.inside[node]) add_piece(corner[0], unit, corner[k], corner[l], 1, region_of(node, c));
                continue;
            }
            find_spans(in, side, edges[k], c);
            for (const InsideSpan& span : c.span) {
                add_piece(corner[0], unit, corner[k], corner[l], span.to - span.from, region_of(span.node, c));
            }
        }
    }
}

// The contour is the boundary of patches: a patch of a is on its left, one of b on its right.
void measure_contour(const PairInput& in, RegionsChunk& c) {
    const Contours& k = in.contours;
    for (uint32_t i = in.segments.first; i < in.segments.end(); ++i) {
        const Vec3d p = k.point[k.end[i][0]] - in.centre, q = k.point[k.end[i][1]] - in.centre;
        RegionSum& sum = region_of(point_node(in, k.end[i][0]), c);
        sum.contour += (q - p).norm();
        for (uint32_t side = 0; side < 2; ++side) {
            const Triangle& t = in.half[side].mesh.triangle[k.triangle[i][side]];
            const BodyPoints& points = in.half[side].points;
            const Vec3d corner = points.point(t[0]);
            const Vec3d unit = (points.point(t[1]) - corner).cross(points.point(t[2]) - corner).normalized();
            add_piece(corner, unit, side == 0 ? p : q, side == 0 ? q : p, 1, sum);
        }
    }
    for (uint32_t i = k.pair[in.pair].first; i < k.pair[in.pair].end(); ++i) {
        ++region_of(point_node(in, k.end[k.curve[i].first][0]), c).curves;
    }
}

// Node of a contact inside a face: that of the nearest contour segment on the face, as no other contour lies
// between; of the face's first corner if no contour crosses it.
uint32_t node_of_face_contact(const PairInput& in, uint32_t index, uint32_t side, RegionsChunk& c) {
    const Contours& k = in.contours;
    const auto [v, w] = in.contacts.vertex[index];
    const uint32_t third = in.contacts.third[index];
    double nearest = std::numeric_limits<double>::infinity();
    uint32_t best = kNone;
    for (uint32_t curve = k.pair[in.pair].first; curve < k.pair[in.pair].end(); ++curve) {
        for (uint32_t i = k.curve[curve].first; i < k.curve[curve].end(); ++i) {
            const Triangle& t = in.half[side].mesh.triangle[k.triangle[i][side]];
            if (t != Triangle{v, w, third}) continue;
            const Vec3d p = k.point[k.end[i][0]], q = k.point[k.end[i][1]], apart = in.contacts.point[index] - p;
            const double size2 = (q - p).squaredNorm();
            const double along = size2 > 0 ? std::clamp(apart.dot(q - p) / size2, 0.0, 1.0) : 0;
            const double distance = (apart - along * (q - p)).norm();
            if (distance < nearest) nearest = distance, best = point_node(in, k.end[i][0]);
        }
    }
    if (best != kNone) return best;
    const uint32_t first = in.half[side].first_node;
    return c.inside[first + v] ? first + v : kNone;
}

// Node of a contact: its vertex, or the start of the inside part of its edge. kNone: on the surface.
uint32_t node_of_contact(const PairInput& in, uint32_t index, uint32_t side, RegionsChunk& c) {
    const auto& vertex = in.contacts.vertex[index];
    const uint32_t first = in.half[side].first_node;
    if (vertex[0] == vertex[1]) return c.inside[first + vertex[0]] ? first + vertex[0] : kNone;
    if (in.contacts.third[index] != kNone) return node_of_face_contact(in, index, side, c);
    const auto edges = in.half[side].mesh.edge;
    const uint32_t edge = uint32_t(std::lower_bound(edges.begin(), edges.end(), vertex) - edges.begin());
    find_spans(in, side, edge, c);
    uint32_t best = kNone;
    double nearest = std::numeric_limits<double>::infinity();
    for (const InsideSpan& span : c.span) {
        const double along = in.contacts.along[index];
        const double beyond = std::max({0.0, span.from - along, along - span.to});
        if (beyond < nearest) nearest = beyond, best = span.node;
    }
    return best;
}

void add_contacts(const PairInput& in, RegionsChunk& c) {
    for (uint32_t index = in.contact_range.first; index < in.contact_range.end(); ++index) {
        const double depth = -in.contacts.distance[index];
        if (!(depth > 0)) continue;
        const uint32_t side = in.contacts.body[index] == in.half[1].body;
        const uint32_t node = node_of_contact(in, index, side, c);
        if (node == kNone) continue;
        RegionSum& sum = region_of(node, c);
        if (in.contacts.vertex[index][0] == in.contacts.vertex[index][1]) ++(side ? sum.vertices_b : sum.vertices_a);
        if (depth > sum.depth) sum.depth = depth, sum.witness = index;
    }
}

bool holds(const Box& outer, const Box& inner) {
    return (outer.min.array() <= inner.min.array()).all() && (inner.max.array() <= outer.max.array()).all();
}

// Assigns the walls of voids to the smallest region around them.
void merge_voids(RegionsChunk& c) {
    for (RegionSum& cavity : c.sum) {
        if (cavity.volume >= 0) continue;
        RegionSum* around = nullptr;
        for (RegionSum& sum : c.sum) {
            if (sum.volume > -cavity.volume && holds(sum.box, cavity.box) && (!around || sum.volume < around->volume)) {
                around = &sum;
            }
        }
        if (around == nullptr) continue;
        around->vertices_a += cavity.vertices_a;
        around->vertices_b += cavity.vertices_b;
        around->curves += cavity.curves;
        around->contour += cavity.contour;
        around->area += cavity.area;
        around->volume += cavity.volume;
        if (cavity.depth > around->depth) around->depth = cavity.depth, around->witness = cavity.witness;
        cavity = {};
    }
}

void add_regions(const PairInput& in, const RegionsChunk& c, OverlapRegions& out) {
    for (const RegionSum& sum : c.sum) {
        // no point inside and no volume: mere touch. A body on its own copy has volume but no depth.
        const bool seen = sum.witness != kNone;
        if (!seen && !(sum.volume > 1e-9 * sum.area * std::sqrt(sum.area))) continue;
        const Vec3d normal = seen ? in.contacts.normal[sum.witness] : Vec3d(Vec3d::Zero());
        out.pair.push_back(in.pair);
        out.vertices_a.push_back(sum.vertices_a);
        out.vertices_b.push_back(sum.vertices_b);
        out.curves.push_back(sum.curves);
        out.contour.push_back(sum.contour);
        out.area.push_back(sum.area);
        out.volume.push_back(sum.volume);
        out.depth.push_back(sum.depth);
        out.direction.push_back(seen && in.contacts.body[sum.witness] == in.half[0].body ? Vec3d(-normal) : normal);
        out.witness.push_back(sum.witness);
    }
}

void find_pair(const PairInput& in, RegionsChunk& c) {
    const uint32_t nodes = in.first_point_node + in.points.count;
    mark_inside(in, c);
    sort_points(in, c);
    c.parent.resize(nodes);
    if (is_doubtful(in, c)) {
        c.winding.resize(nodes);
        for (uint32_t side = 0; side < 2; ++side) decide_doubtful(in, side, c);
    }
    for (uint32_t node = 0; node < nodes; ++node) c.parent[node] = node;
    for (uint32_t i = in.segments.first; i < in.segments.end(); ++i) {
        const auto& [p, q] = in.contours.end[i];
        join_sets(c.parent, point_node(in, p), point_node(in, q));
    }
    for (uint32_t side = 0; side < 2; ++side) join_half(in, side, c);
    number_regions(in, c);
    if (c.sum.empty()) return;
    for (uint32_t side = 0; side < 2; ++side) measure_half(in, side, c);
    measure_contour(in, c);
    add_contacts(in, c);
    merge_voids(c);
    add_regions(in, c, c.found);
}

// Index ranges of a pair's segments and points; curves, segments and points ascend by pair.
void find_constraints(const Contours& k, uint32_t pair, Range& points, Range& segments) {
    points = segments = {};
    const Range curves = k.pair[pair];
    if (curves.count == 0) return;
    const Range last = k.curve[curves.end() - 1];
    segments = {k.curve[curves.first].first, last.end() - k.curve[curves.first].first};
    uint32_t low = kNone, high = 0;
    for (uint32_t i = segments.first; i < segments.end(); ++i) {
        for (const uint32_t p : k.end[i]) low = std::min(low, p), high = std::max(high, p);
    }
    points = {low, high + 1 - low};
}

void clear(OverlapRegions& r) {
    r.pair.clear(), r.vertices_a.clear(), r.vertices_b.clear(), r.curves.clear(), r.contour.clear(), r.area.clear();
    r.volume.clear(), r.depth.clear(), r.direction.clear(), r.witness.clear();
}

}  // namespace

void find_regions(const ContactInputs& in, const ScreenedTriangles& screened, const NearVertices& near, const Contacts& contacts,
                  const Contours& contours, RegionsScratch& scratch, OverlapRegions& regions) {
    const Surfaces& s = in.surfaces;
    const BroadPhasePairs& pairs = in.pairs;
    const uint32_t count = uint32_t(pairs.a.size()), grain = coarse_grain(count), chunks = chunk_count(count, grain);
    if (scratch.chunk.size() < chunks) scratch.chunk.resize(chunks);
    find_first_contacts(contacts, count, scratch.contact_first);
    const auto input_of = [&](uint32_t pair, Range contact_range) -> PairInput {
        const uint32_t a = pairs.a[pair], b = pairs.b[pair];
        const Vec3d centre = contacts.point[contact_range.first];
        const MeshView mesh_a = mesh_view(s.meshes, s.bodies.mesh[a]), mesh_b = mesh_view(s.meshes, s.bodies.mesh[b]);
        const uint32_t nodes_a = uint32_t(mesh_a.position.size()), nodes_b = uint32_t(mesh_b.position.size());
        const Half half_a{a, 0, screened.body[a], near.side[2 * pair], mesh_a, BodyPoints(s, a, centre)};
        const Half half_b{b, nodes_a, screened.body[b], near.side[2 * pair + 1], mesh_b, BodyPoints(s, b, centre)};
        Range points, segments;
        find_constraints(contours, pair, points, segments);
        return {screened, near, contacts, contours, {half_a, half_b}, pair, nodes_a + nodes_b, points, segments, contact_range, centre};
    };
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        RegionsChunk& chunk = scratch.chunk[begin / grain];
        clear(chunk.found);
        for (uint32_t pair = begin; pair < end; ++pair) {
            const Range contact_range = range_at(scratch.contact_first, pair);
            if (contact_range.count > 0 && has_inside(s, pairs.a[pair]) && has_inside(s, pairs.b[pair]))
                find_pair(input_of(pair, contact_range), chunk);
        }
    });
    clear(regions);
    for (uint32_t i = 0; i < chunks; ++i) {
        const OverlapRegions& f = scratch.chunk[i].found;
        append(f.pair, regions.pair), append(f.vertices_a, regions.vertices_a), append(f.vertices_b, regions.vertices_b);
        append(f.curves, regions.curves), append(f.contour, regions.contour), append(f.area, regions.area);
        append(f.volume, regions.volume), append(f.depth, regions.depth), append(f.direction, regions.direction);
        append(f.witness, regions.witness);
    }
}

}  // namespace trocar
