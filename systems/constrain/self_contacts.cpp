#include "systems/constrain/self_contacts.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "engine/contact/contact_constraints.hpp"
#include "engine/contact/displacement_bound.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

constexpr double kFarthest = 0.75;            // of a mean edge: displacement of a pass that is looked ahead at most
constexpr double kLookAhead = 0.5;            // of a mean edge, added to the reach of a look; by trial
constexpr double kAboveCosine = 0.5;                // cosine to a triangle's normal of what is above the triangle
constexpr double kCrossing = 0.05;            // sine between edges whose contact is not left to their ends
constexpr double kBeside = 1e-3;              // cosine, by which the nearest point may be beside a feature
constexpr double kSteep = 0.1;                // sine, by which a surface may go on against the normal of its contact
constexpr double kDeepestWarm = 5e-5;         // m, deeper contacts get no warm start: see contact_memory.cpp
constexpr double kLeastGap = 1e-9;            // m, of vertices that coincide at rest
constexpr uint32_t kMeasuredPerChunk = 2048;  // pairs, mostly not near ones

// One body or two whose parts may touch, at present.
struct NearSurfaces {
    const Surfaces& s;
    uint32_t body, other;
    MeshView mesh, other_mesh;
    const Float4 *position, *other_position;
    Vec3d shift;        // m, from the frame of the first's offsets to that of the second's
    double gap, reach;  // m; of the pass, for every pair
    double near;        // m, without velocities
    bool keeps_sides;   // pairs keep the sides on which they came near
    double period;      // s

    bool itself() const { return body == other; }
    Vec3d point(uint32_t v) const { return {position[v].x, position[v].y, position[v].z}; }
    Vec3d other_point(uint32_t v) const { return Vec3d(other_position[v].x, other_position[v].y, other_position[v].z) + shift; }
    Vec3d velocity(uint32_t of, uint32_t v) const {
        const uint32_t i = s.bodies.particles[of].first + v;
        return {s.particles.velocity_x[i], s.particles.velocity_y[i], s.particles.velocity_z[i]};
    }
};

// Fastest vertex relative to the mean velocity, m/s.
double spread_of_velocities(const NearSurfaces& n, uint32_t body, const Vec3d& mean) {
    const uint32_t vertices = n.s.meshes.info[n.s.bodies.mesh[body]].vertices.count;
    double most2 = 0;
    for (uint32_t v = 0; v < vertices; ++v) most2 = std::max(most2, (n.velocity(body, v) - mean).squaredNorm());
    return std::sqrt(most2);
}
Vec3d mean_velocity(const NearSurfaces& n, uint32_t body) {
    const uint32_t vertices = n.s.meshes.info[n.s.bodies.mesh[body]].vertices.count;
    Vec3d sum = Vec3d::Zero();
    for (uint32_t v = 0; v < vertices; ++v) sum += n.velocity(body, v);
    return sum / vertices;
}

// Largest displacement of a vertex since a look, relative to the mean, m; infinite if it is no number.
double displacement_since(std::span<const Float4> before, const Float4* now, bool relative) {
    Vec3d mean = Vec3d::Zero();
    const auto moved = [&](size_t v) {
        return Vec3d(double{now[v].x} - double{before[v].x}, double{now[v].y} - double{before[v].y},
                     double{now[v].z} - double{before[v].z});
    };
    if (relative) {
        for (size_t v = 0; v < before.size(); ++v) mean += moved(v);
        mean /= static_cast<double>(before.size());
    }
    double most2 = 0;
    for (size_t v = 0; v < before.size(); ++v) {
        const double size2 = (moved(v) - mean).squaredNorm();
        if (!(size2 <= most2)) most2 = size2;
    }
    return std::isfinite(most2) ? std::sqrt(most2) : std::numeric_limits<double>::infinity();
}

// Finds what is near anew, unless a former look still holds.
void look(const NearSurfaces& n, double ahead, SelfContactScratch& scratch, SelfContactLook& look) {
    if (look.body == n.body && look.other == n.other && look.position.size() == n.mesh.position.size() &&
        look.other_position.size() == (n.itself() ? 0 : n.other_mesh.position.size())) {
        double moved = 2 * displacement_since(look.position, n.position, n.itself());
        if (!n.itself()) moved = 0.5 * moved + displacement_since(look.other_position, n.other_position, false);
        if (look.reach - moved >= n.reach) return;
    }
    look.body = n.body, look.other = n.other, look.reach = n.reach + ahead;
    look.position.assign(n.position, n.position + n.mesh.position.size());
    look.other_position.clear();
    FeatureTrees& trees = scratch.trees[n.body];
    build_feature_trees(n.mesh, n.position, trees);
    if (n.itself()) return find_near_features(n.mesh, n.position, trees, trees, true, static_cast<float>(look.reach), look.near);
    look.other_position.assign(n.other_position, n.other_position + n.other_mesh.position.size());
    scratch.moved.resize(n.other_mesh.position.size());
    for (uint32_t v = 0; v < scratch.moved.size(); ++v) {
        const Vec3d p = n.other_point(v);
        scratch.moved[v] = {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0};
    }
    build_feature_trees(n.other_mesh, scratch.moved.data(), scratch.trees[n.other]);
    // edges of both are found once
    const auto find = n.body < n.other ? find_near_features : find_near_vertices;
    find(n.mesh, n.position, trees, scratch.trees[n.other], false, static_cast<float>(look.reach), look.near);
}

// Closest points of two edges p + s u, q + t v.
struct EdgeCrossing {
    double s = 0, t = 0, sine2 = 0;  // sine2: of the angle, times the squared lengths
    bool inside = false;             // of both
};
EdgeCrossing cross_edges(const Vec3d& p, const Vec3d& u, const Vec3d& q, const Vec3d& v) {
    EdgeCrossing c;
    const Vec3d across = u.cross(v), apart = q - p;
    c.sine2 = across.squaredNorm();
    if (!(c.sine2 > kCrossing * kCrossing * u.squaredNorm() * v.squaredNorm())) return c;
    c.s = apart.cross(v).dot(across) / c.sine2;
    c.t = apart.cross(u).dot(across) / c.sine2;
    c.inside = c.s >= 0 && c.s <= 1 && c.t >= 0 && c.t <= 1;
    return c;
}

// Distance of two edges at rest, m.
double edge_distance(const Vec3d& p, const Vec3d& u, const Vec3d& q, const Vec3d& v) {
    const EdgeCrossing c = cross_edges(p, u, q, v);
    if (c.inside) return (p + c.s * u - q - c.t * v).norm();
    const auto to = [](const Vec3d& x, const Vec3d& from, const Vec3d& along) {
        const double length2 = along.squaredNorm(), share = length2 > 0 ? std::clamp((x - from).dot(along) / length2, 0.0, 1.0) : 0.0;
        return (x - from - share * along).norm();
    };
    return std::min({to(p, q, v), to(p + u, q, v), to(q, p, u), to(q + v, p, u)});
}

// The remembered pair of these features, kNone if there is none. before: of these bodies.
uint32_t find_before(const SelfContacts& before, Range of_pair, bool edges, const std::array<uint32_t, 2>& feature) {
    const std::array<uint32_t, 3> wanted{edges, feature[0], feature[1]};
    const auto key = [&](uint32_t i) { return std::array<uint32_t, 3>{before.edges[i], before.feature[i][0], before.feature[i][1]}; };
    uint32_t first = of_pair.first, count = of_pair.count;
    while (count > 0) {
        const uint32_t half = count / 2;
        if (key(first + half) < wanted)
            first += half + 1, count -= half + 1;
        else
            count = half;
    }
    return first < of_pair.end() && key(first) == wanted ? first : kNone;
}

// Turns a triangle so that its normal is on the side of a direction.
void turn_to(const Vec3d& normal, const Vec3d& triangle_normal, SelfContactPair& pair) {
    if (normal.dot(triangle_normal) >= 0) return;
    std::swap(pair.triangle[1], pair.triangle[2]);
    std::swap(pair.weight[1], pair.weight[2]);
}

// Whether a vertex has no nearer neighbour of the triangle, seen from the nearest point on its edge or corner, and the triangle is
// the first one there.
bool is_nearest_there(const NearSurfaces& n, uint32_t t, Feature feature, const Vec3d& to_vertex, const Vec3d& closest) {
    const Triangle& corner = n.other_mesh.triangle[t];
    const auto is_away = [&](uint32_t v) {
        const Vec3d side = n.other_point(v) - closest;
        return to_vertex.dot(side) <= kBeside * to_vertex.norm() * side.norm();
    };
    if (feature >= Feature::kEdge0) {
        const uint32_t k = static_cast<uint32_t>(feature) - static_cast<uint32_t>(Feature::kEdge0);
        const uint32_t neighbour = n.other_mesh.neighbour[t][k];
        if (neighbour >= n.other_mesh.triangle.size()) return true;
        const Triangle& u = n.other_mesh.triangle[neighbour];
        return t < neighbour &&
               std::ranges::all_of(u, [&](uint32_t v) { return v == corner[k] || v == corner[(k + 1) % 3] || is_away(v); });
    }
    const uint32_t at = corner[static_cast<uint32_t>(feature)];
    for (uint32_t i = n.other_mesh.incident_first[at]; i < n.other_mesh.incident_first[at + 1]; ++i) {
        const uint32_t u = n.other_mesh.incident[i];
        if (u < t) return false;
        if (!std::ranges::all_of(n.other_mesh.triangle[u], [&](uint32_t v) { return v == at || is_away(v); })) return false;
    }
    return true;
}

// Whether a feature of a triangle's border is at the rim of the surface, which may be passed to the other side.
bool is_rim(const MeshView& mesh, uint32_t t, Feature feature) {
    const auto open = [&](uint32_t k) { return mesh.neighbour[t][k] >= mesh.triangle.size(); };
    if (feature >= Feature::kEdge0) return open(static_cast<uint32_t>(feature) - static_cast<uint32_t>(Feature::kEdge0));
    const uint32_t at = mesh.triangle[t][static_cast<uint32_t>(feature)];
    for (uint32_t i = mesh.incident_first[at]; i < mesh.incident_first[at + 1]; ++i) {
        const uint32_t u = mesh.incident[i];
        for (uint32_t k = 0; k < 3; ++k)
            if ((mesh.triangle[u][k] == at || mesh.triangle[u][(k + 1) % 3] == at) && mesh.neighbour[u][k] >= mesh.triangle.size())
                return true;
    }
    return false;
}

// Whether a vertex is what its surface reaches farthest with against a direction, nearly. Only such a vertex can touch a corner or an
// edge along it: a normal of contact is in the normal cones of both sides (Moreau). Others touch faces, or edges touch.
bool is_farthest(const NearSurfaces& n, uint32_t vertex, const Vec3d& normal) {
    const Vec3d at = n.point(vertex);
    for (uint32_t i = n.mesh.incident_first[vertex]; i < n.mesh.incident_first[vertex + 1]; ++i)
        for (const uint32_t v : n.mesh.triangle[n.mesh.incident[i]]) {
            const Vec3d side = n.point(v) - at;
            if (normal.dot(side) < -kSteep * side.norm()) return false;
        }
    return true;
}

// The distance below which a pair is a constraint, from the relative velocity of its points.
bool comes_near(const NearSurfaces& n, const SelfContactPair& pair) {
    Vec3d v = (1 - double{pair.along}) * n.velocity(n.body, pair.vertex[0]) + double{pair.along} * n.velocity(n.body, pair.vertex[1]);
    for (size_t k = 0; k < 3; ++k) v -= double{pair.weight[k]} * n.velocity(n.other, pair.triangle[k]);
    return pair.distance < n.near + 2 * v.norm() * n.period;
}

// Measures a vertex and a triangle.
SelfContactPair measure_vertex(const NearSurfaces& n, const SelfContacts& before, Range of_pair, uint32_t vertex, uint32_t t) {
    SelfContactPair pair;
    pair.feature = {vertex, t}, pair.vertex = {vertex, vertex}, pair.triangle = n.other_mesh.triangle[t];
    const Vec3d p = n.point(vertex);
    std::array<Vec3d, 3> at;
    for (size_t k = 0; k < 3; ++k) at[k] = n.other_point(pair.triangle[k]);
    const TrianglePoint found = closest_point_on_triangle(p, at[0], at[1], at[2]);
    const double distance = std::sqrt(found.squared_distance);
    if (!(distance < n.reach)) return pair;
    const Vec3d face = triangle_normal(at[0], at[1], at[2]).normalized(), closest = p + found.offset;
    const double height = face.dot(p - closest);
    const bool on_face = found.feature == Feature::kFace;
    if (!face.allFinite() || !(on_face || std::abs(height) > kAboveCosine * distance || distance == 0)) return pair;
    pair.kept = true;
    const uint32_t index = find_before(before, of_pair, false, pair.feature);
    const bool keeps_side = index != kNone && n.keeps_sides && (on_face || !is_rim(n.other_mesh, t, found.feature));
    pair.positive = keeps_side ? before.positive[index] != 0 : height >= 0;
    pair.turned = pair.positive != (height >= 0);
    const Vec3d side = pair.positive ? face : Vec3d(-face);
    if (on_face || pair.turned || distance == 0)
        pair.normal = side;
    else if (is_nearest_there(n, t, found.feature, p - closest, closest) && is_farthest(n, vertex, (p - closest) / distance))
        pair.normal = (p - closest) / distance;
    else
        return pair;
    if (index != kNone) pair.force = before.force[index];
    pair.weight = barycentric_weights(closest, at[0], at[1], at[2]);
    turn_to(pair.normal, face, pair);
    pair.gap = n.gap;
    if (n.itself()) {
        const Triangle& r = n.other_mesh.triangle[t];
        const auto rest = [&](size_t k) { return n.mesh.position[r[k]]; };
        pair.gap =
            std::min(pair.gap, std::sqrt(closest_point_on_triangle(n.mesh.position[vertex], rest(0), rest(1), rest(2)).squared_distance));
    }
    pair.distance = (pair.turned ? -std::abs(height) : distance) - pair.gap;
    pair.acts = comes_near(n, pair);
    return pair;
}

// Whether a direction leads away from a face of an edge: not along the surface, as between edges of a plane.
template <typename At>
bool leads_away(const MeshView& mesh, uint32_t edge, const Vec3d& direction, const At& at) {
    return std::ranges::any_of(mesh.edge_triangle[edge], [&](uint32_t t) {
        if (t >= mesh.triangle.size()) return false;
        const auto [a, b, c] = mesh.triangle[t];
        const Vec3d normal = (at(b) - at(a)).cross(at(c) - at(a));
        return std::abs(normal.dot(direction)) > kAboveCosine * normal.norm();
    });
}

// Measures two edges.
SelfContactPair measure_edges(const NearSurfaces& n, const SelfContacts& before, Range of_pair, uint32_t edge, uint32_t other_edge) {
    SelfContactPair pair;
    pair.feature = {edge, other_edge}, pair.edges = true, pair.vertex = n.mesh.edge[edge];
    const auto [v, w] = n.other_mesh.edge[other_edge];
    const Vec3d p = n.point(pair.vertex[0]), along = n.point(pair.vertex[1]) - p, q = n.other_point(v), across = n.other_point(w) - q;
    const EdgeCrossing found = cross_edges(p, along, q, across);
    if (!found.inside) return pair;
    const Vec3d normal = along.cross(across) / std::sqrt(found.sine2), a = p + found.s * along, b = q + found.t * across;
    const double height = normal.dot(a - b);
    if (!(std::abs(height) < n.reach)) return pair;
    if (!leads_away(n.mesh, edge, normal, [&](uint32_t i) { return n.point(i); }) &&
        !leads_away(n.other_mesh, other_edge, normal, [&](uint32_t i) { return n.other_point(i); }))
        return pair;
    pair.kept = true;
    const uint32_t index = find_before(before, of_pair, true, pair.feature);
    // the sign of the height also changes where edges that are apart turn past parallel: the direction does not
    const bool above = height >= 0,
               same = index == kNone || !n.keeps_sides || before.normal[index].dot(height >= 0 ? normal : Vec3d(-normal)) >= 0;
    pair.positive = above == same;
    pair.turned = !same;
    pair.normal = pair.positive ? normal : Vec3d(-normal);
    if (index != kNone) pair.force = before.force[index];
    const auto& sides = n.other_mesh.edge_triangle[other_edge];
    const uint32_t t = sides[0] < n.other_mesh.triangle.size() ? sides[0] : sides[1];
    const Triangle& corner = n.other_mesh.triangle[t];
    const uint32_t far = corner[0] != v && corner[0] != w ? corner[0] : corner[1] != v && corner[1] != w ? corner[1] : corner[2];
    pair.along = static_cast<float>(found.s);
    const float share = static_cast<float>(found.t);
    pair.triangle = {far, v, w}, pair.weight = {0, 1 - share, share};
    turn_to(pair.normal, across.cross(n.other_point(far) - q), pair);
    pair.gap = n.gap;
    if (n.itself()) {
        const auto rest = [&](uint32_t i) { return n.mesh.position[i]; };
        const Vec3d from = rest(pair.vertex[0]), to = rest(v);
        pair.gap = std::min(pair.gap, edge_distance(from, rest(pair.vertex[1]) - from, to, rest(w) - to));
    }
    pair.distance = (pair.turned ? -std::abs(height) : std::abs(height)) - pair.gap;
    pair.acts = comes_near(n, pair);
    return pair;
}

void append_pair(uint32_t body, uint32_t other, const SelfContactPair& pair, SelfContacts& to) {
    to.body.push_back(body), to.other.push_back(other);
    to.feature.push_back(pair.feature);
    to.edges.push_back(pair.edges);
    to.positive.push_back(pair.positive);
    to.normal.push_back(pair.normal);
    to.constraint.push_back(kNone);
    to.force.push_back(pair.force);
}

void write_constraint(const Bodies& bodies, uint32_t body, uint32_t other, const SelfContactPair& pair, uint32_t at,
                      ContactConstraints& c) {
    c.contact[at] = kNone;
    c.body[at] = body, c.other[at] = other;
    c.vertex[at] = pair.vertex, c.along[at] = pair.along;
    c.third[at] = kNone, c.across[at] = 0;
    c.triangle[at] = pair.triangle, c.weight[at] = pair.weight;
    c.normal[at] = pair.normal, c.distance[at] = pair.distance;
    c.friction[at] = static_cast<float>(std::max(bodies.tissue[body].friction, bodies.tissue[other].friction));
    c.warm_start[at] = pair.distance < -kDeepestWarm ? Vec3d(Vec3d::Zero()) : pair.force;
    c.gap[at] = std::max(pair.gap, kLeastGap);
}

// A sheet that touches itself is a slab of its thickness, with which it also touches others; see write_constraint for its own contacts.
void keep_half_thickness(const Surfaces& s, ContactConstraints& c) {
    const Bodies& b = s.bodies;
    const auto half = [&](uint32_t body) {
        return s.meshes.info[b.mesh[body]].admission == Admission::kSheet ? 0.5 * b.thickness[body] : 0.0;
    };
    for (size_t i = 0; i < c.body.size(); ++i)
        if (self_contact_of(b, c.body[i]) > 0) c.gap[i] = half(c.body[i]) + half(c.other[i]);
}

void clear_pairs(SelfContacts& contacts) {
    each_field(contacts, [](const FieldName&, auto& column) { column.clear(); });
}

// Pairs of bodies that may touch in this pass, and those whose pairs of features are kept because they sleep.
void find_bodies(const SelfContactPass& pass, const SelfContacts& before, std::vector<std::array<uint32_t, 2>>& pairs) {
    const Bodies& bodies = pass.surfaces.bodies;
    pairs.clear();
    for (uint32_t body = 0; body < bodies.self_contact.size(); ++body)
        if (bodies.self_contact[body] > 0 && is_deformable(bodies, body) && bodies.mesh[body] != kNone) pairs.push_back({body, body});
    for (uint32_t i = 0; i < pass.pairs.a.size(); ++i)
        if (const uint32_t a = pass.pairs.a[i], b = pass.pairs.b[i]; touch_as_sheets(pass.surfaces, a, b))
            pairs.push_back({a, b}), pairs.push_back({b, a});
    for (uint32_t i = 0; i < before.body.size(); ++i) {
        const std::array<uint32_t, 2> both{before.body[i], before.other[i]};
        if (both[0] != both[1] && is_asleep(pass.sleep, both[0]) && is_asleep(pass.sleep, both[1]) &&
            (pairs.empty() || pairs.back() != both))
            pairs.push_back(both);
    }
    std::sort(pairs.begin(), pairs.end());
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
}

Range remembered(const SelfContacts& before, const std::array<uint32_t, 2>& bodies, uint32_t from) {
    const auto key = [&](uint32_t i) { return std::array<uint32_t, 2>{before.body[i], before.other[i]}; };
    const auto count = static_cast<uint32_t>(before.body.size());
    while (from < count && key(from) < bodies) ++from;
    uint32_t end = from;
    while (end < count && key(end) == bodies) ++end;
    return {from, end - from};
}

NearSurfaces surfaces_near(const SelfContactPass& pass, uint32_t body, uint32_t other, Report& report) {
    const Surfaces& s = pass.surfaces;
    const Bodies& b = s.bodies;
    NearSurfaces n{s,
                   body,
                   other,
                   mesh_view(s.meshes, b.mesh[body]),
                   mesh_view(s.meshes, b.mesh[other]),
                   s.particles.offset.data() + b.particles[body].first,
                   s.particles.offset.data() + b.particles[other].first,
                   s.poses.origin[other] - s.poses.origin[body],
                   body == other ? b.self_contact[body] : 0.5 * (b.thickness[body] + b.thickness[other]),
                   0,
                   0,
                   true,
                   pass.period};
    const double edge = std::max(n.mesh.info->mean_edge, n.other_mesh.info->mean_edge);
    n.near = least_drift_bound(edge) + pass.fall;
    const Vec3d mean = mean_velocity(n, body);
    double fastest = spread_of_velocities(n, body, mean);
    if (!n.itself()) fastest = 0.5 * (fastest + spread_of_velocities(n, other, mean));
    const double ahead = 3 * fastest * pass.period;
    report.unswept_bodies += ahead > kFarthest * edge;
    n.reach = n.gap + n.near + (ahead < kFarthest * edge ? ahead : kFarthest * edge);
    return n;
}

bool have_crossed(const SelfContactPass& pass, uint32_t body, uint32_t other) {
    const uint32_t low = std::min(body, other), high = std::max(body, other);
    for (size_t i = 0; i < pass.crossed.body.size(); ++i)
        if (pass.crossed.body[i] == low && pass.crossed.other[i] == high) return true;
    return false;
}

// Whether hold_surfaces keeps a surface from crossing itself: then no vertex has gone through a triangle from one pass to the next, but
// it may have gone around a fold, and is on the right side wherever it is.
bool is_held_back(const SelfContactPass& pass, uint32_t body, uint32_t other) {
    return body == other && pass.springs.info[pass.surfaces.bodies.mesh[body]].skin == 0;
}

// Marks the vertices beside the contours where a pair of bodies crosses.
void mark_contours(const SelfContactPass& pass, const NearSurfaces& n, SelfContactScratch& s) {
    put_side_by_side(pass.surfaces, n.body, n.other, offsets_of(pass.surfaces, n.body), offsets_of(pass.surfaces, n.other), s.surface);
    find_crossing_pairs(s.surface.triangle, s.surface.position.data(), s.crossing, s.crossing_pairs);
    mark_beside(s.surface.triangle, s.crossing_pairs, s.surface.position.size(), s.ring, s.beside);
}

// Whether both features of a pair are beside a contour.
bool is_beside_contour(const NearSurfaces& n, const SelfContactScratch& s, const SelfContactPair& pair) {
    const uint32_t shift = n.itself() ? 0 : s.surface.vertices;
    const auto& t = pair.triangle;
    return (s.beside[pair.vertex[0]] || s.beside[pair.vertex[1]]) &&
           (s.beside[shift + t[0]] || s.beside[shift + t[1]] || s.beside[shift + t[2]]);
}

FacingSurfaces facing_surfaces(const NearSurfaces& n, const FeatureTrees& trees, const FeatureTrees& other_trees) {
    const auto shift = [&](int k) { return static_cast<float>(n.shift[k]); };
    return {n.other_mesh.triangle,
            n.mesh.edge,
            n.other_mesh.edge,
            n.position,
            n.other_position,
            {shift(0), shift(1), shift(2)},
            std::max(trees.longest, other_trees.longest)};
}

// Measures what a look found, in its order: those that face each other at present; the others are not kept.
void measure_chunk(const NearSurfaces& n, const FacingSurfaces& surfaces, const SelfContacts& before, Range of_pair,
                   std::span<const uint64_t> found, bool edges, std::vector<SelfContactPair>& near) {
    const auto reach = static_cast<float>(n.reach);
    for (size_t i = 0; i < found.size(); i += 8) {
        const std::span<const uint64_t> eight = found.subspan(i, std::min<size_t>(8, found.size() - i));
        for (uint32_t lanes = edges ? facing_edges(surfaces, eight, reach) : facing_vertices(surfaces, eight, reach); lanes != 0;
             lanes &= lanes - 1) {
            const uint64_t key = eight[static_cast<size_t>(std::countr_zero(lanes))];
            const auto first = static_cast<uint32_t>(key >> 32), second = static_cast<uint32_t>(key);
            const SelfContactPair pair =
                edges ? measure_edges(n, before, of_pair, first, second) : measure_vertex(n, before, of_pair, first, second);
            if (pair.kept) near.push_back(pair);
        }
    }
}
// Returns the number of chunks.
uint32_t measure(const NearSurfaces& n, const NearFeatures& near, const FacingSurfaces& surfaces, const SelfContacts& before, Range of_pair,
                 std::vector<std::vector<SelfContactPair>>& measured) {
    const uint32_t vertex_chunks = chunk_count(static_cast<uint32_t>(near.vertex_triangle.size()), kMeasuredPerChunk),
                   chunks = vertex_chunks + chunk_count(static_cast<uint32_t>(near.edge_edge.size()), kMeasuredPerChunk);
    if (measured.size() < chunks) measured.resize(chunks);
    parallel_for(chunks, 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t chunk = begin; chunk < end; ++chunk) {
            measured[chunk].clear();
            const bool edges = chunk >= vertex_chunks;
            const std::span<const uint64_t> all = edges ? near.edge_edge : near.vertex_triangle;
            const size_t first = size_t{kMeasuredPerChunk} * (edges ? chunk - vertex_chunks : chunk);
            measure_chunk(n, surfaces, before, of_pair, all.subspan(first, std::min<size_t>(kMeasuredPerChunk, all.size() - first)), edges,
                          measured[chunk]);
        }
    });
    return chunks;
}

void keep_as_they_are(const SelfContacts& before, Range of_pair, SelfContacts& contacts) {
    for (uint32_t i = of_pair.first; i < of_pair.end(); ++i) {
        SelfContactPair pair;
        pair.feature = before.feature[i], pair.edges = before.edges[i] != 0, pair.positive = before.positive[i] != 0;
        pair.normal = before.normal[i];
        pair.force = before.force[i];
        append_pair(before.body[i], before.other[i], pair, contacts);
    }
}

}  // namespace

void find_self_contacts(const SelfContactPass& pass, SelfContactScratch& scratch, Report& report, SelfContacts& contacts,
                        ContactConstraints& constraints) {
    const Bodies& bodies = pass.surfaces.bodies;
    SelfContacts& before = scratch.before;
    std::swap(before, contacts);
    clear_pairs(contacts);
    if (pass.first) resize_constraints(constraints, 0), constraints.warm_start.clear();
    constraints.gap.assign(constraints.body.size(), 0);
    keep_half_thickness(pass.surfaces, constraints);
    find_bodies(pass, before, scratch.pair);
    if (scratch.look.size() < scratch.pair.size()) scratch.look.resize(scratch.pair.size());
    if (scratch.trees.size() < bodies.mesh.size()) scratch.trees.resize(bodies.mesh.size());
    uint32_t at_before = 0;
    for (size_t i = 0; i < scratch.pair.size(); ++i) {
        const auto [body, other] = scratch.pair[i];
        const Range of_pair = remembered(before, scratch.pair[i], at_before);
        at_before = of_pair.end();
        if (is_asleep(pass.sleep, body) && is_asleep(pass.sleep, other)) {
            keep_as_they_are(before, of_pair, contacts);
            continue;
        }
        NearSurfaces n = surfaces_near(pass, body, other, report);
        const bool crossed = have_crossed(pass, body, other);
        n.keeps_sides = !crossed && !is_held_back(pass, body, other);
        look(n, kLookAhead * std::max(n.mesh.info->mean_edge, n.other_mesh.info->mean_edge), scratch, scratch.look[i]);
        const uint32_t chunks =
            measure(n, scratch.look[i].near, facing_surfaces(n, scratch.trees[body], scratch.trees[other]), before, of_pair, scratch.measured);
        const auto measured = std::span(scratch.measured).first(chunks);
        const uint32_t first = static_cast<uint32_t>(constraints.body.size());
        if (crossed) {
            mark_contours(pass, n, scratch);
            for (auto& chunk : measured) std::erase_if(chunk, [&](const SelfContactPair& p) { return is_beside_contour(n, scratch, p); });
        }
        uint32_t acting = 0;
        for (const auto& chunk : measured)
            acting += static_cast<uint32_t>(std::ranges::count_if(chunk, [](const SelfContactPair& p) { return p.acts; }));
        resize_constraints(constraints, first + acting);
        constraints.warm_start.resize(first + acting, Vec3d::Zero());
        constraints.gap.resize(first + acting, 0);
        uint32_t next = first;
        for (const auto& chunk : measured)
            for (const SelfContactPair& pair : chunk) {
                append_pair(body, other, pair, contacts);
                report.turned_sides += pair.acts && pair.turned;
                if (!pair.acts) continue;
                contacts.constraint.back() = next;
                write_constraint(bodies, body, other, pair, next++, constraints);
            }
        report.self_contacts += next - first;
    }
}

void remember_self_contacts(const ContactConstraints& constraints, SelfContacts& contacts) {
    for (uint32_t i = 0; i < contacts.constraint.size(); ++i) {
        const uint32_t constraint = contacts.constraint[i];
        contacts.force[i] = constraint < constraints.warm_start.size() ? constraints.warm_start[constraint] : Vec3d(Vec3d::Zero());
    }
}

}  // namespace trocar
