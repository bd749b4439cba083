#include "systems/detect/narrow/edge_pass.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/bit_sets.hpp"
#include "engine/base/subspan.hpp"
#include "engine/contact/insert_contacts.hpp"
#include "engine/contact/pair_sides.hpp"
#include "engine/contact/write_contact.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostQueries = 48;  // per edge

void clear_set(RankedBits& set, size_t size) { set.word.assign((size + 63) / 64, 0); }
void count_ranks(RankedBits& set) {
    set.before.resize(set.word.size());
    uint32_t before = 0;
    for (size_t i = 0; i < set.word.size(); ++i) {
        set.before[i] = before;
        before += uint32_t(__builtin_popcountll(set.word[i]));
    }
}
uint32_t rank_of(const RankedBits& set, uint32_t i) {
    const uint64_t below = (uint64_t{1} << (i & 63)) - 1;
    return set.before[i >> 6] + uint32_t(__builtin_popcountll(set.word[i >> 6] & below));
}

// Vertices of a body in its own frame.
struct FramePoints {
    const Float4* offset = nullptr;
    const Vec3d* rest = nullptr;

    FramePoints(const Surfaces& s, uint32_t body) {
        if (is_deformable(s.bodies, body)) {
            offset = s.particles.offset.data() + s.bodies.particles[body].first;
        } else {
            rest = s.meshes.position.data() + s.meshes.info[s.bodies.mesh[body]].vertices.first;
        }
    }
    Vec4d operator()(uint32_t v) const { return offset ? float_vec4(_mm_load_ps(&offset[v].x)) : to_vec4(rest[v]); }
};

// One side of one pair: the edges of `body` against the surface of `other`.
struct Side {
    uint32_t side_index, body, other;
    bool reversed;  // body is the pair's b
    MeshView mesh, other_mesh;
    FramePoints other_points;
    const ClosestPointTree* tree;
    double doubtful;  // m, depth above which a sign is doubtful
};

// Vertices of a body in its own frame.
struct Sample {
    double s;           // m from the first vertex
    double depth;       // m; an upper bound at the ends of an interval, exact at queried points
    uint32_t triangle;  // nearest triangle of other, or kNone
};

// One edge under search, in the frame of the other body. The arrays are not cleared: most edges need none.
struct EdgeSearch {
    const Side& side;
    double tolerance;        // m, of depth
    Vec4d start, direction;  // direction unit
    double length;           // m

    std::array<std::array<Sample, 2>, kMostQueries + 2> interval;
    std::array<double, kMostQueries + 2> bound;
    uint32_t intervals = 0;

    EdgeSearch(const Side& of, double to, Vec4d from, Vec4d along_edge, double metres)
        : side(of), tolerance(to), start(from), direction(along_edge), length(metres) {}
    Vec4d at(double s) const { return start + s * direction; }
    SurfacePoint ask(double s, uint32_t hint, QueryCounters& counters) const {
        const Vec3d p = to_vec3(at(s));
        const double radius = std::numeric_limits<double>::infinity();
        SurfacePoint answer;
        side.tree->query({&p, 1}, {&radius, 1}, {&hint, 1}, {&answer, 1}, counters);
        if (-answer.distance > side.doubtful) counters.settled += side.tree->decide_side(p, answer);
        return answer;
    }
    double distance_to(uint32_t t, double s) const {
        const Triangle& c = side.other_mesh.triangle[t];
        return distance_to_triangle(at(s), side.other_points(c[0]), side.other_points(c[1]), side.other_points(c[2]));
    }
    // Upper bound of the depth between two samples: depth is 1-Lipschitz, and at most the distance to any
    // triangle, which is convex along the edge. The nearest triangles of the two ends may each cover a half.
    double bound_between(const Sample& a, const Sample& b) const {
        double most = 0.5 * (b.s - a.s + a.depth + b.depth);
        if (a.triangle != kNone) most = std::min(most, std::max(std::abs(a.depth), distance_to(a.triangle, b.s)));
        if (b.triangle == kNone || b.triangle == a.triangle) return most;
        most = std::min(most, std::max(std::abs(b.depth), distance_to(b.triangle, a.s)));
        const double ends = std::max(std::abs(a.depth), std::abs(b.depth));
        if (a.triangle == kNone || most <= ends) return most;
        const double middle = 0.5 * (a.s + b.s);
        return std::min(most, std::max({ends, distance_to(a.triangle, middle), distance_to(b.triangle, middle)}));
    }
    void add(const Sample& a, const Sample& b) {
        if (!(b.s > a.s)) return;
        interval[intervals] = {a, b};
        bound[intervals++] = bound_between(a, b);
    }
};

// Piyavskii-Shubert search for the deepest point on the given intervals, to the tolerance; only a depth above
// `deepest` counts. `examine`: the edge surely passes through the surface and gets one query however short
// its inside part. Of equal bounds the first interval is split first. True if a deeper point was found.
bool search(EdgeSearch& e, double deepest, bool examine, EdgeContact& best, QueryCounters& counters) {
    bool found = false;
    for (uint32_t query = 0; query < kMostQueries && e.intervals > 0; ++query) {
        const uint32_t pick = uint32_t(std::max_element(e.bound.begin(), e.bound.begin() + e.intervals) - e.bound.begin());
        const double slack = (examine && !found ? 0.01 : 1.0) * e.tolerance;
        if (e.bound[pick] <= deepest + slack && !(examine && query == 0)) break;
        const auto [a, b] = e.interval[pick];
        e.interval[pick] = e.interval[e.intervals - 1];
        e.bound[pick] = e.bound[--e.intervals];
        const double width = b.s - a.s;
        const double peak = 0.5 * (a.s + b.s + b.depth - a.depth);
        const float along = float(std::clamp(peak, a.s + 0.1 * width, b.s - 0.1 * width) / e.length);
        const double s = double(along) * e.length;
        if (!(s > a.s && s < b.s)) continue;
        const SurfacePoint answer = e.ask(s, a.triangle != kNone ? a.triangle : b.triangle, counters);
        if (answer.triangle == kNone) break;
        if (-answer.distance > deepest) {
            found = true;
            deepest = -answer.distance;
            best.along = along;
            best.point = to_vec3(e.at(s));
            best.answer = answer;
        }
        const Sample middle{s, -answer.distance, answer.triangle};
        e.add(a, middle);
        e.add(middle, b);
    }
    return found;
}

struct Crossings {
    uint32_t count;
    Sample first, last;
};

// First and last crossing of the edge with the other surface. A triangle that crosses the edge meets both
// adjacent triangles, so it is a candidate of each: the shorter list suffices, and an edge is not crossed if
// one of its triangles has no candidate.
Crossings find_crossings(const EdgeSearch& e, const std::array<uint32_t, 2>& triangles, const EdgeChunk& c) {
    Crossings found{0, {}, {}};
    Range shortest{0, kNone};
    for (const uint32_t own : triangles) {
        if (own == kNone) continue;
        if (!has_bit(c.near_triangle.word, own)) return found;
        const Range list = range_at(c.opposite_first, rank_of(c.near_triangle, own));
        if (list.count < shortest.count) shortest = list;
    }
    if (shortest.count == kNone) return found;
    const Vec4d p = e.start, q = e.at(e.length);
    const FramePoints& other = e.side.other_points;
    for (uint32_t i = shortest.first; i < shortest.end(); ++i) {
        const Triangle& corner = e.side.other_mesh.triangle[c.opposite[i]];
        const double part = edge_crossing(p, q, other(corner[0]), other(corner[1]), other(corner[2]));
        if (part < 0) continue;
        const Sample sample{part * e.length, 0, c.opposite[i]};
        const auto before = [](const Sample& x, const Sample& y) { return x.s < y.s || (x.s == y.s && x.triangle < y.triangle); };
        if (found.count == 0 || before(sample, found.first)) found.first = sample;
        if (found.count == 0 || before(found.last, sample)) found.last = sample;
        ++found.count;
    }
    return found;
}

// Both ends outside: the inside part lies between the first and the last crossing.
bool search_outside_edge(EdgeSearch& e, const Sample& a, const Sample& b, const std::array<uint32_t, 2>& triangles, EdgeChunk& c,
                         EdgeContact& best) {
    if (0.5 * (e.length + a.depth + b.depth) < 0) return false;
    Crossings x = find_crossings(e, triangles, c);
    if (x.count == 0) return false;
    // a computed crossing is off by its rounding, more where the edge grazes: half of a grazed edge is
    // searched
    const double pad = 1e-9 * e.length;
    const bool single = x.last.s - x.first.s <= pad;
    x.first.s = single ? -a.depth : std::max(x.first.s - pad, 0.0);
    x.last.s = single ? e.length + b.depth : std::min(x.last.s + pad, e.length);
    if (single) x.first.triangle = x.last.triangle = kNone;
    e.add(x.first, x.last);
    return search(e, 1e-12 * e.length, true, best, c.counters);  // smaller depths are rounding: the surfaces only touch
}

// One end inside (a): searched only if some point can be deeper than a by more than the tolerance.
bool search_crossing_edge(EdgeSearch& e, const Sample& a, const Sample& b, const std::array<uint32_t, 2>& triangles, EdgeChunk& c,
                          EdgeContact& best) {
    const double enough = a.depth + e.tolerance;
    const double sign = a.s < b.s ? 1 : -1;
    // if the surface crosses the edge once, nothing beyond is inside, and up to there the depth is at most
    // the distance to the crossing triangle, which is convex along the edge and zero at the crossing
    Sample at = b;
    const double pad = 1e-9 * e.length;  // rounding of the position
    const Crossings x = find_crossings(e, triangles, c);
    if (x.count > 0 && x.last.s - x.first.s <= pad) {
        at = x.last;
        if (e.distance_to(at.triangle, a.s) <= enough) return false;
        at.s = std::clamp(at.s + sign * pad, 0.0, e.length);
    }
    // no point beyond `last` is deeper than enough; each query there that finds less moves it closer to a
    for (int examine = 0; examine < 4; ++examine) {
        const double last = at.s + sign * (at.depth - enough);
        if ((last - a.s) * sign <= 0 || e.distance_to(a.triangle, last) <= enough) return false;
        const SurfacePoint answer = e.ask(last, a.triangle, c.counters);
        at = {last, -answer.distance, answer.triangle};
        if (at.depth > 0) break;
    }
    sign > 0 ? e.add(a, at) : e.add(at, a);
    return search(e, std::max(a.depth, 0.0), false, best, c.counters);
}

// Both ends inside: only if the edge leaves the other body and can be deeper in between.
bool search_inside_edge(EdgeSearch& e, const Sample& a, const Sample& b, const std::array<uint32_t, 2>& triangles, EdgeChunk& c,
                        EdgeContact& best) {
    const double deepest = std::max(a.depth, b.depth);
    e.add(a, b);
    if (e.intervals == 0 || e.bound[0] <= deepest + e.tolerance) return false;
    if (find_crossings(e, triangles, c).count == 0) return false;
    return search(e, deepest, false, best, c.counters);
}

// False if the surface surely does not cross the edge: a crossing triangle meets both adjacent triangles.
bool may_cross(const std::array<uint32_t, 2>& triangles, const EdgeChunk& c) {
    return std::all_of(triangles.begin(), triangles.end(), [&](uint32_t t) { return t == kNone || has_bit(c.near_triangle.word, t); });
}

bool search_edge(const Side& side, double tolerance, uint32_t edge, EdgeChunk& c, EdgeContact& best) {
    const auto [v0, v1] = side.mesh.edge[edge];
    if (!has_bit(c.near_vertex, v0) || !has_bit(c.near_vertex, v1)) return false;
    const EdgeEnd &from = c.end[v0], &to = c.end[v1];
    Sample a{0, from.depth, from.triangle}, b{0, to.depth, to.triangle};
    const auto& triangles = side.mesh.edge_triangle[edge];
    if ((a.depth > 0) == (b.depth > 0) && !may_cross(triangles, c)) return false;
    const Vec4d p = from.position, q = to.position;
    const double length = std::sqrt(norm2(q - p));
    if (!(length > 0)) return false;
    b.s = length;
    EdgeSearch e(side, tolerance, p, (q - p) / length, length);
    best.vertex = {v0, v1};
    if (a.depth <= 0 && b.depth <= 0) return search_outside_edge(e, a, b, triangles, c, best);
    if (a.depth > 0 && b.depth > 0) return search_inside_edge(e, a, b, triangles, c, best);
    return a.depth > 0 ? search_crossing_edge(e, a, b, triangles, c, best) : search_crossing_edge(e, b, a, triangles, c, best);
}

void collect_crossing(const CandidateTriangles& candidates, uint32_t pair, EdgeChunk& c) {
    const Range contact_count = candidates.pair[pair];
    c.crossing.clear();
    for (uint32_t i = contact_count.first; i < contact_count.end(); ++i)
        if (candidates.beside.empty() || !candidates.beside[i]) c.crossing.push_back(candidates.triangle[i]);
}

// Candidate crossing triangles of the other body for each triangle of this one, and the latter's edges.
void collect_edges(const Side& side, EdgeChunk& c) {
    clear_set(c.near_triangle, side.mesh.triangle.size());
    c.near_edge.assign((side.mesh.edge.size() + 63) / 64, 0);
    const auto& contact_count = c.crossing;
    for (const auto& pair : contact_count) {
        const uint32_t own = pair[side.reversed];
        if (has_bit(c.near_triangle.word, own)) continue;
        set_bit(c.near_triangle.word, own);
        for (const uint32_t edge : side.mesh.triangle_edge[own]) set_bit(c.near_edge, edge);
    }
    count_ranks(c.near_triangle);
    // counting sort of the candidates by triangle of this body
    c.opposite_first.assign(c.near_triangle.before.back() + 66, 0);
    for (const auto& pair : contact_count) ++c.opposite_first[rank_of(c.near_triangle, pair[side.reversed]) + 2];
    for (size_t i = 2; i < c.opposite_first.size(); ++i) c.opposite_first[i] += c.opposite_first[i - 1];
    c.opposite.resize(contact_count.size());
    for (const auto& pair : contact_count) {
        c.opposite[c.opposite_first[rank_of(c.near_triangle, pair[side.reversed]) + 1]++] = pair[!side.reversed];
    }
}

// Depths known from the overlap phase, per vertex.
void collect_ends(const Surfaces& s, const NearVertices& near, const Side& side, EdgeChunk& c) {
    c.near_vertex.assign((side.mesh.position.size() + 63) / 64, 0);
    if (c.end.size() < side.mesh.position.size()) c.end.resize(side.mesh.position.size());
    const BodyPoints points(s, side.body, s.poses.origin[side.other]);
    const bool turned = !is_deformable(s.bodies, side.other);
    const Range vertices = near.side[side.side_index];
    for (uint32_t i = vertices.first; i < vertices.end(); ++i) {
        const uint32_t v = near.vertex[i];
        set_bit(c.near_vertex, v);
        const Vec3d p = points.point(v);
        c.end[v] = {to_vec4(turned ? rotate_back(s.poses.orientation[side.other], p) : p), -near.distance[i], near.triangle[i]};
    }
}

void find_side(const ContactInputs& in, const CandidateTriangles& candidates, const NearVertices& near, const Side& side, Range& found,
               EdgeChunk& c) {
    found = {uint32_t(c.found.size()), 0};
    if (side.tree == nullptr) return;
    collect_crossing(candidates, side.side_index / 2, c);
    if (c.crossing.empty()) return;
    collect_edges(side, c);
    collect_ends(in.surfaces, near, side, c);
    for_each_bit(c.near_edge, [&](uint32_t edge) {
        EdgeContact best;
        if (search_edge(side, in.params.tolerance, edge, c, best)) c.found.push_back(best);
    });
    found.count = uint32_t(c.found.size()) - found.first;
}

Side make_side(const ContactInputs& in, uint32_t side_index) {
    const auto [pair, body, other, reversed] = pair_side(in.pairs, side_index);
    const Bodies& bodies = in.surfaces.bodies;
    return {side_index,
            body,
            other,
            reversed,
            mesh_view(in.surfaces.meshes, bodies.mesh[body]),
            mesh_view(in.surfaces.meshes, bodies.mesh[other]),
            FramePoints(in.surfaces, other),
            has_inside(in.surfaces, other) ? in.trees[bodies.tree[other]].get() : nullptr,
            doubtful_depth(in.surfaces, other)};
}

// A side's edges follow its vertices.
void find_positions(const BroadPhasePairs& pairs, const Contacts& contacts, EdgePassScratch& scratch) {
    const uint32_t sides = 2 * uint32_t(pairs.a.size()), vertices = uint32_t(contacts.pair.size());
    scratch.before.clear();
    scratch.first.resize(sides);
    uint32_t contact = 0;
    for (uint32_t side_index = 0; side_index < sides; ++side_index) {
        const PairSide side = pair_side(pairs, side_index);
        while (contact < vertices && contacts.pair[contact] == side.pair && contacts.body[contact] == side.body) ++contact;
        scratch.first[side_index] = contact + uint32_t(scratch.before.size());
        scratch.before.insert(scratch.before.end(), scratch.side[side_index].count, contact);
    }
}

}  // namespace

void find_edge_contacts(const ContactInputs& in, const CandidateTriangles& candidates, const NearVertices& near, EdgePassScratch& scratch,
                        Report& report, Contacts& contacts) {
    const uint32_t count = uint32_t(in.pairs.a.size()), sides = 2 * count;
    const uint32_t grain = coarse_grain(count);
    scratch.side.resize(sides);
    if (scratch.chunk.size() < chunk_count(count, grain)) scratch.chunk.resize(chunk_count(count, grain));
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        EdgeChunk& chunk = scratch.chunk[begin / grain];
        chunk.found.clear();
        chunk.counters = {};
        for (uint32_t pair = begin; pair < end; ++pair) {
            for (const uint32_t side_index : {2 * pair, 2 * pair + 1})
                find_side(in, candidates, near, make_side(in, side_index), scratch.side[side_index], chunk);
        }
    });
    for (uint32_t i = 0; i < chunk_count(count, grain); ++i) add_to_report(scratch.chunk[i].counters, report);
    find_positions(in.pairs, contacts, scratch);
    open_rows(scratch.before, contacts);
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        const EdgeChunk& chunk = scratch.chunk[begin / grain];
        for (uint32_t side_index = 2 * begin; side_index < 2 * end; ++side_index) {
            const PairSide side = pair_side(in.pairs, side_index);
            for (uint32_t i = 0; i < scratch.side[side_index].count; ++i) {
                const EdgeContact& e = chunk.found[scratch.side[side_index].first + i];
                write_contact(in.surfaces, {side.pair, side.body, side.other, e.vertex, e.along}, e.point, e.answer, contacts,
                              scratch.first[side_index] + i);
            }
        }
    });
}

}  // namespace trocar
