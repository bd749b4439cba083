#include "systems/detect/narrow/overlap.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/bit_sets.hpp"
#include "engine/base/disjoint_sets.hpp"
#include "engine/base/subspan.hpp"
#include "engine/contact/convex_pairs.hpp"
#include "engine/contact/pair_sides.hpp"
#include "engine/contact/write_contact.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/project_vertices.hpp"
namespace trocar {
namespace {

constexpr uint32_t kQueriesPerChunk = 64;
enum Piece : uint8_t { kUnknown, kOutside, kInside };

// One side of one pair: the vertices of `body` against the surface of `other`.
struct Side {
    uint32_t pair, body, other;
    bool reversed;                                        // body is the pair's b
    std::span<const std::array<uint32_t, 2>> crossing;    // triangles of a and of b that may cross
    std::span<const std::array<uint32_t, 2>> near;        // triangles of body near other, each with one of other's near it
    std::span<const uint8_t> near_corners;                // per entry of near
    std::span<const uint32_t> screened;                   // triangles of body
    std::span<const uint32_t> hint_other, hint_triangle;  // per vertex of body
    MeshView mesh;                                        // of body
    double margin;                                        // m, sum of both margins
    double half_thickness;                                // m, of other
    bool solid, sheet;                                    // other
    double doubtful;                                      // m, depth in other above which a sign is doubtful
    const ClosestPointTree* tree;
};

// Marks the triangles near the other body and the vertices to query: corners that may come near, and all
// corners of triangles that may cross. Each gets a nearby triangle as hint.
void mark_near(const Side& side, OverlapChunk& c) {
    c.near_triangle.assign((side.mesh.triangle.size() + 63) / 64, 0);
    c.near_vertex.assign((side.mesh.position.size() + 63) / 64, 0);
    if (c.hint.size() < side.mesh.position.size()) c.hint.resize(side.mesh.position.size());
    const auto mark = [&](uint32_t v, uint32_t across) {
        set_bit(c.near_vertex, v);
        c.hint[v] = across;
    };
    for (const std::array<uint32_t, 2>& triangle : side.crossing) {
        for (const uint32_t v : side.mesh.triangle[triangle[side.reversed]]) mark(v, triangle[!side.reversed]);
    }
    for (size_t i = 0; i < side.near.size(); ++i) {
        const auto [own, across] = side.near[i];
        set_bit(c.near_triangle, own);
        for (uint32_t k = 0; k < 3; ++k) {
            if (side.near_corners[i] >> k & 1) mark(side.mesh.triangle[own][k], across);
        }
    }
}

// Sets the bits of four consecutive indices, the first a multiple of four.
void set_four(std::vector<uint64_t>& bits, uint32_t first, uint32_t four) { bits[first / 64] |= uint64_t{four} << (first % 64); }

// Marks the vertices of a rigid body that are outside the other's box, in the frame of the former.
void mark_beyond_box(const ContactInputs& in, const Side& side, OverlapChunk& c) {
    const Quat& turn = in.surfaces.poses.orientation[side.body];
    const Box& box = in.boxes.box[side.other];
    const Vec3d middle = 0.5 * (box.min + box.max) - in.surfaces.poses.origin[side.body], half = 0.5 * (box.max - box.min);
    const Vec3d own = rotate_back(turn, middle);
    Vec3d reach = Vec3d::Constant(1e-12 * (middle.norm() + half.norm()));
    for (int k = 0; k < 3; ++k) reach += half[k] * rotate_back(turn, Vec3d::Unit(k)).cwiseAbs();
    const uint32_t count = uint32_t(side.mesh.position.size());
    uint32_t v = 0;
    for (; v + 4 <= count; v += 4) {
        const FourPoints p = load_four(&side.mesh.position[v]);
        const auto size_of = [](Vec4d x) { return (Vec4d)_mm256_andnot_pd(_mm256_set1_pd(-0.0), (__m256d)x); };
        const Mask4 beyond =
            (size_of(p.x - own.x()) > reach.x()) | (size_of(p.y - own.y()) > reach.y()) | (size_of(p.z - own.z()) > reach.z());
        set_four(c.beyond, v, mask_bits(beyond));
    }
    for (; v < count; ++v)
        if (((side.mesh.position[v] - own).cwiseAbs().array() > reach.array()).any()) set_bit(c.beyond, v);
}

// Projects both bodies' vertices onto the direction from the first to the second; once for both sides.
void project_pair(const ContactInputs& in, const Side& side, OverlapChunk& c) {
    if (c.projected == side.pair) return;
    c.projected = side.pair;
    const uint32_t a = side.reversed ? side.other : side.body, b = side.reversed ? side.body : side.other;
    const Vec3d origin = in.surfaces.poses.origin[a], direction = direction_between(in.surfaces, in.boxes, a, b);
    project_vertices(in.surfaces, a, origin, direction, c.along[0]);
    project_vertices(in.surfaces, b, origin, direction, c.along[1]);
}

// Least and greatest coordinate; NaN does not count.
double least_of(std::span<const double> along) {
    Vec4d lanes = all_lanes(std::numeric_limits<double>::infinity());
    size_t v = 0;
    for (; v + 4 <= along.size(); v += 4) lanes = least((Vec4d)_mm256_loadu_pd(&along[v]), lanes);
    double nearest = std::min({lanes[0], lanes[1], lanes[2], lanes[3]});
    for (; v < along.size(); ++v) nearest = std::min(nearest, along[v]);
    return nearest;
}
double greatest_of(std::span<const double> along) {
    Vec4d lanes = all_lanes(-std::numeric_limits<double>::infinity());
    size_t v = 0;
    for (; v + 4 <= along.size(); v += 4) lanes = greatest((Vec4d)_mm256_loadu_pd(&along[v]), lanes);
    double farthest = std::max({lanes[0], lanes[1], lanes[2], lanes[3]});
    for (; v < along.size(); ++v) farthest = std::max(farthest, along[v]);
    return farthest;
}

// Marks the vertices separated from the whole other body by a plane across the direction between the bodies,
// and those of a rigid body outside the other's box. No plane is used if the other body has many vertices:
// projecting them all would cost more than it saves.
void mark_beyond(const ContactInputs& in, const Side& side, OverlapChunk& c) {
    constexpr uint32_t kManyVertices = 1024;
    const Surfaces& s = in.surfaces;
    const uint32_t count = uint32_t(side.mesh.position.size());
    c.beyond.assign((count + 63) / 64, 0);
    if (!is_deformable(s.bodies, side.body)) return mark_beyond_box(in, side, c);
    const MeshInfo &own = s.meshes.info[s.bodies.mesh[side.body]], &others = s.meshes.info[s.bodies.mesh[side.other]];
    if (others.vertices.count > kManyVertices) return;
    project_pair(in, side, c);
    const std::vector<double>&along = c.along[side.reversed], &across = c.along[!side.reversed];
    const double nearest = side.reversed ? greatest_of(across) : least_of(across);
    const double apart = direction_between(s, in.boxes, side.body, side.other).norm();
    const double size = (s.poses.origin[side.other] - s.poses.origin[side.body]).norm() + own.radius + others.radius;
    const double slack = 1e-12 * (size * apart + std::abs(nearest));             // far above rounding: the direction is not normalised
    const double sign = side.reversed ? -1 : 1, limit = sign * nearest - slack;  // along the direction to the other body
    uint32_t v = 0;
    for (; v + 4 <= count; v += 4) set_four(c.beyond, v, mask_bits(sign * (Vec4d)_mm256_loadu_pd(&along[v]) < all_lanes(limit)));
    for (; v < count; ++v)
        if (sign * along[v] < limit) set_bit(c.beyond, v);
}

// Whether some vertex without a query may be inside the other body.
bool is_any_unknown(const Side& side, const OverlapChunk& c) {
    const size_t count = side.mesh.position.size();
    for (size_t word = 0; word < c.beyond.size(); ++word) {
        const uint64_t all = 64 * (word + 1) <= count ? ~uint64_t{0} : (uint64_t{1} << (count % 64)) - 1;
        if ((~(c.beyond[word] | c.near_vertex[word]) & all) != 0) return true;
    }
    return false;
}

// Union-find over the corners of screened triangles that are not near: nothing crosses them, so they lie on
// one side. A vertex outside the other body's box, or beyond the separating plane, makes its piece outside.
void flood_pieces(const ContactInputs& in, const Side& side, OverlapChunk& c) {
    const uint32_t count = uint32_t(side.mesh.position.size());
    c.region_vertex.assign((count + 63) / 64, 0);
    if (c.parent.size() < count) {
        c.parent.resize(count);
        c.piece.resize(count);
    }
    for (uint32_t v = 0; v < count; ++v) c.parent[v] = v;
    const Vec3d origin = in.surfaces.poses.origin[side.body];
    const BodyPoints points(in.surfaces, side.body, origin);
    for (const uint32_t triangle : side.screened) {
        const Triangle& corner = side.mesh.triangle[triangle];
        if (has_bit(c.beyond, corner[0]) && has_bit(c.beyond, corner[1]) && has_bit(c.beyond, corner[2])) continue;
        if (has_bit(c.near_triangle, triangle)) continue;
        for (const uint32_t v : corner) set_bit(c.region_vertex, v);
        join_sets(c.parent, corner[0], corner[1]);
        join_sets(c.parent, corner[1], corner[2]);
    }
    const Box box = in.boxes.box[side.other];
    const Vec3d a = box.min - origin, b = box.max - origin;
    const __m256d low = _mm256_setr_pd(a.x(), a.y(), a.z(), -1), high = _mm256_setr_pd(b.x(), b.y(), b.z(), 1);
    for_each_bit(c.region_vertex, [&](uint32_t v) { c.piece[v] = kUnknown; });
    for_each_bit(c.region_vertex, [&](uint32_t v) {
        const __m256d p = points(v);
        const __m256d beyond = _mm256_or_pd(_mm256_cmp_pd(p, low, _CMP_LT_OQ), _mm256_cmp_pd(p, high, _CMP_GT_OQ));
        if (has_bit(c.beyond, v) || _mm256_movemask_pd(beyond) != 0) c.piece[find_set(c.parent, v)] = kOutside;
    });
}

void add_query(const ContactInputs& in, const Side& side, const BodyPoints& points, uint32_t v, uint32_t hint, OverlapChunk& c) {
    const uint32_t remembered = side.hint_other[v] == side.other ? side.hint_triangle[v] : kNone;
    const uint32_t most = in.surfaces.meshes.info[in.surfaces.bodies.mesh[side.other]].triangles.count;
    const Vec3d p = points.point(v);
    c.query_vertex.push_back(v);
    c.query_hint.push_back(remembered < most ? remembered : hint);
    c.query_point.push_back(is_deformable(in.surfaces.bodies, side.other) ? p : rotate_back(in.surfaces.poses.orientation[side.other], p));
    c.query_radius.push_back(side.sheet ? side.margin + side.half_thickness : std::numeric_limits<double>::infinity());
}

void clear_queries(OverlapChunk& c) {
    c.query_vertex.clear();
    c.query_hint.clear();
    c.query_point.clear();
    c.query_radius.clear();
    c.decided.clear();
}

// Answers the queries from index `first` on. A sheet is a solid of its thickness.
void run_queries(const Side& side, uint32_t first, OverlapChunk& c) {
    const uint32_t count = uint32_t(c.query_vertex.size()) - first;
    c.query_answer.resize(c.query_vertex.size());
    c.query_counters.assign(chunk_count(count, kQueriesPerChunk), {});
    parallel_for(count, kQueriesPerChunk, [&](uint32_t begin, uint32_t end) {
        const uint32_t at = first + begin, n = end - begin;
        side.tree->query(std::span(c.query_point).subspan(at, n), std::span(c.query_radius).subspan(at, n),
                         std::span(c.query_hint).subspan(at, n), std::span(c.query_answer).subspan(at, n),
                         c.query_counters[begin / kQueriesPerChunk]);
        if (!side.sheet) return;
        for (uint32_t i = at; i < at + n; ++i) {
            SurfacePoint& answer = c.query_answer[i];
            if (answer.triangle != kNone) answer.distance -= side.half_thickness;
        }
    });
    for (const QueryCounters& counters : c.query_counters) c.counters += counters;
    for (uint32_t i = first; i < c.query_vertex.size(); ++i) c.answer_of_vertex[c.query_vertex[i]] = i;
    c.decided.resize((c.query_vertex.size() + 63) / 64, 0);
}

// Decides the side of one vertex by winding number, once. True if that changed its side.
bool decide_sign(const Side& side, uint32_t index, OverlapChunk& c) {
    if (has_bit(c.decided, index)) return false;
    set_bit(c.decided, index);
    const bool changed = side.tree->decide_side(c.query_point[index], c.query_answer[index]);
    c.counters.settled += changed;
    return changed;
}

double longest_edge_at(const Side& side, const BodyPoints& points, uint32_t v) {
    const Vec3d p = points.point(v);
    double longest2 = 0;
    for (uint32_t k = side.mesh.incident_first[v]; k < side.mesh.incident_first[v + 1]; ++k)
        for (const uint32_t w : side.mesh.triangle[side.mesh.incident[k]])
            longest2 = std::max(longest2, (points.point(w) - p).squaredNorm());
    return std::sqrt(longest2);
}

// Decides the sides of vertices that seem doubtfully deep, but no deeper than their edges are long:
// check_signs cannot detect those.
void decide_doubtful(const Side& side, const BodyPoints& points, uint32_t first, OverlapChunk& c) {
    if (!std::isfinite(side.doubtful)) return;
    for (uint32_t index = first; index < c.query_vertex.size(); ++index) {
        const double depth = -c.query_answer[index].distance;
        if (depth > side.doubtful && depth < longest_edge_at(side, points, c.query_vertex[index])) decide_sign(side, index, c);
    }
}

// Signed distance is 1-Lipschitz, so it changes along an edge by at most its length. If it changes sign by
// more, a sign is wrong: the surface is folded there and pseudonormals are unreliable.
bool is_too_short(uint32_t i, uint32_t j, const OverlapChunk& c) {
    const double a = c.query_answer[i].distance, b = c.query_answer[j].distance;
    return !(a * b >= 0) && !(std::abs(a - b) <= (c.query_point[i] - c.query_point[j]).norm() * (1 + 1e-9));
}

// Whether any triangle with all corners queried has such an edge; only inside vertices' edges matter.
bool is_any_edge_too_short(const Side& side, const OverlapChunk& c) {
    for (uint32_t i = 0; i < c.query_vertex.size(); ++i) {
        if (!(c.query_answer[i].distance < 0)) continue;
        const uint32_t v = c.query_vertex[i];
        for (uint32_t k = side.mesh.incident_first[v]; k < side.mesh.incident_first[v + 1]; ++k)
            for (const uint32_t w : side.mesh.triangle[side.mesh.incident[k]])
                if (has_bit(c.near_vertex, w) && is_too_short(i, c.answer_of_vertex[w], c)) return true;
    }
    return false;
}

// A corrected vertex may make its neighbours doubtful.
bool check_triangle(const Side& side, const Triangle& corner, OverlapChunk& c) {
    bool changed = false;
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t i = c.answer_of_vertex[corner[k]], j = c.answer_of_vertex[corner[(k + 1) % 3]];
        if (!is_too_short(i, j, c)) continue;
        changed = decide_sign(side, i, c) || changed;
        changed = decide_sign(side, j, c) || changed;
    }
    return changed;
}

void check_signs(const Side& side, OverlapChunk& c) {
    const auto is_inside = [](const SurfacePoint& answer) { return answer.distance < 0; };
    const auto inside = std::count_if(c.query_answer.begin(), c.query_answer.end(), is_inside);
    if (inside == 0 || size_t(inside) == c.query_answer.size()) return;  // no edge has a sign change
    if (!is_any_edge_too_short(side, c)) return;
    for (bool changed = true; changed;) {
        changed = false;
        for (const uint32_t triangle : side.screened) {
            const Triangle& corner = side.mesh.triangle[triangle];
            if (!has_bit(c.near_vertex, corner[0]) || !has_bit(c.near_vertex, corner[1]) || !has_bit(c.near_vertex, corner[2])) continue;
            changed = check_triangle(side, corner, c) || changed;
        }
    }
}

// Side of every piece: that of a near vertex of it, or of its first vertex by an extra query.
void decide_pieces(const ContactInputs& in, const Side& side, const BodyPoints& points, OverlapChunk& c) {
    const uint32_t asked = uint32_t(c.query_vertex.size());
    for (uint32_t index = 0; index < asked; ++index) {
        const uint32_t v = c.query_vertex[index];
        if (!has_bit(c.region_vertex, v)) continue;
        uint8_t& piece = c.piece[find_set(c.parent, v)];
        if (piece == kUnknown) piece = c.query_answer[index].distance < 0 ? kInside : kOutside;
    }
    for_each_bit(c.region_vertex, [&](uint32_t v) {
        if (c.parent[v] == v && c.piece[v] == kUnknown) add_query(in, side, points, v, kNone, c);
    });
    if (c.query_vertex.size() == asked) return;
    run_queries(side, asked, c);
    for (uint32_t index = asked; index < c.query_vertex.size(); ++index) {
        if (-c.query_answer[index].distance > side.doubtful) decide_sign(side, index, c);  // a whole piece depends on it
        c.piece[c.query_vertex[index]] = c.query_answer[index].distance < 0 ? kInside : kOutside;
    }
}

// Depth of every vertex of the inside pieces.
void measure_inside(const ContactInputs& in, const Side& side, const BodyPoints& points, OverlapChunk& c) {
    const uint32_t asked = uint32_t(c.query_vertex.size());
    for (uint32_t index = 0; index < asked; ++index) set_bit(c.near_vertex, c.query_vertex[index]);
    uint32_t hint = asked > 0 ? c.query_answer[0].triangle : kNone;
    for_each_bit(c.region_vertex, [&](uint32_t v) {
        if (c.piece[find_set(c.parent, v)] != kInside || has_bit(c.near_vertex, v)) return;
        add_query(in, side, points, v, hint, c);
    });
    if (c.query_vertex.size() == asked) return;
    run_queries(side, asked, c);
    for (uint32_t index = asked; index < c.query_vertex.size(); ++index) {
        set_bit(c.near_vertex, c.query_vertex[index]);
        if (side.solid && c.query_answer[index].distance >= 0) decide_sign(side, index, c);
    }
    decide_doubtful(side, points, asked, c);
}

void find_side(const ContactInputs& in, const Side& side, OverlapSide& found, OverlapChunk& c) {
    found = {{uint32_t(c.vertex.size()), 0}, 0};
    if (side.tree == nullptr) return;
    const BodyPoints points(in.surfaces, side.body, in.surfaces.poses.origin[side.other]);
    if (c.answer_of_vertex.size() < side.mesh.position.size()) c.answer_of_vertex.resize(side.mesh.position.size());
    clear_queries(c);
    mark_near(side, c);
    for_each_bit(c.near_vertex, [&](uint32_t v) { add_query(in, side, points, v, c.hint[v], c); });
    run_queries(side, 0, c);
    if (!side.sheet) {
        decide_doubtful(side, points, 0, c);
        if (side.solid) check_signs(side, c);
        mark_beyond(in, side, c);
        if (is_any_unknown(side, c)) {
            flood_pieces(in, side, c);
            decide_pieces(in, side, points, c);
            measure_inside(in, side, points, c);
            if (side.solid) check_signs(side, c);
        }
    }
    for_each_bit(c.near_vertex, [&](uint32_t v) {
        const SurfacePoint& answer = c.query_answer[c.answer_of_vertex[v]];
        if (answer.triangle == kNone) return;
        c.vertex.push_back(v);
        c.point.push_back(c.query_point[c.answer_of_vertex[v]]);
        c.answer.push_back(answer);
        found.near += answer.distance < side.margin;
    });
    found.answers.count = uint32_t(c.vertex.size()) - found.answers.first;
}

Side make_side(const ContactInputs& in, const ScreenedTriangles& screened, const CandidateTriangles& candidates,
               const OverlapScratch& scratch, uint32_t index) {
    const Surfaces& s = in.surfaces;
    const auto [pair, body, other, reversed] = pair_side(in.pairs, index);
    const Range vertices = range_at(scratch.vertex_first, body);
    const Admission admission = s.meshes.info[s.bodies.mesh[other]].admission;
    return {pair,
            body,
            other,
            reversed,
            subspan(candidates.triangle, candidates.pair[pair]),
            subspan(candidates.near, candidates.side[index]),
            subspan(candidates.near_corners, candidates.side[index]),
            subspan(screened.triangle, screened.body[body]),
            subspan(scratch.hint_other, vertices),
            subspan(scratch.hint_triangle, vertices),
            mesh_view(s.meshes, s.bodies.mesh[body]),
            margin_between(in.boxes, body, other),
            admission == Admission::kSheet ? 0.5 * s.bodies.thickness[other] : 0.0,
            admission == Admission::kSolid,
            admission == Admission::kSheet,
            doubtful_depth(s, other),
            admission == Admission::kRefused || touch_as_hulls(in, pair) ? nullptr : in.trees[s.bodies.tree[other]].get()};
}

void prepare_hints(const Surfaces& s, OverlapScratch& scratch) {
    const uint32_t bodies = uint32_t(s.bodies.mesh.size());
    scratch.vertex_first.resize(bodies + 1);
    uint32_t first = 0;
    for (uint32_t body = 0; body < bodies; ++body) {
        scratch.vertex_first[body] = first;
        first += s.meshes.info[s.bodies.mesh[body]].vertices.count;
    }
    scratch.vertex_first[bodies] = first;
    if (scratch.hint_other.size() == first) return;
    scratch.hint_other.assign(first, kNone);
    scratch.hint_triangle.assign(first, kNone);
}

// Copies one side's answers, from `index` of scratch, into the outputs.
void write_side(const ContactInputs& in, const OverlapScratch& scratch, uint32_t index, const OverlapChunk& c, NearVertices& near,
                Contacts& contacts) {
    const auto [pair, body, other, reversed] = pair_side(in.pairs, index);
    const double margin = margin_between(in.boxes, body, other);
    const Range answers = scratch.side[index].answers;
    uint32_t contact = scratch.contact_first[index];
    for (uint32_t i = 0; i < answers.count; ++i) {
        const uint32_t from = answers.first + i, to = near.side[index].first + i, v = c.vertex[from];
        const SurfacePoint& answer = c.answer[from];
        near.vertex[to] = v;
        near.distance[to] = answer.distance;
        near.triangle[to] = answer.triangle;
        if (answer.distance < margin) write_contact(in.surfaces, {pair, body, other, {v, v}}, c.point[from], answer, contacts, contact++);
    }
}

// Keeps each vertex's nearest triangle for the next pass.
void keep_hints(const BroadPhasePairs& pairs, const NearVertices& near, OverlapScratch& scratch) {
    for (uint32_t index = 0; index < near.side.size(); ++index) {
        const PairSide side = pair_side(pairs, index);
        for (uint32_t i = near.side[index].first; i < near.side[index].end(); ++i) {
            const uint32_t memory = scratch.vertex_first[side.body] + near.vertex[i];
            scratch.hint_other[memory] = side.other;
            scratch.hint_triangle[memory] = near.triangle[i];
        }
    }
}

void resize_outputs(uint32_t sides, OverlapScratch& scratch, NearVertices& near, Contacts& contacts) {
    near.side.resize(sides);
    scratch.contact_first.resize(sides + 1);
    uint32_t answers = 0, contact_count = 0;
    for (uint32_t i = 0; i < sides; ++i) {
        near.side[i] = {answers, scratch.side[i].answers.count};
        scratch.contact_first[i] = contact_count;
        answers += scratch.side[i].answers.count;
        contact_count += scratch.side[i].near;
    }
    near.vertex.resize(answers);
    near.distance.resize(answers);
    near.triangle.resize(answers);
    resize_contacts(contacts, contact_count);
}

}  // namespace

void find_overlap(const ContactInputs& in, const ScreenedTriangles& screened, const CandidateTriangles& candidates, OverlapScratch& scratch,
                  Report& report, NearVertices& near, Contacts& contacts) {
    const uint32_t sides = 2 * uint32_t(in.pairs.a.size());
    const uint32_t grain = 2 * coarse_grain(sides / 2);  // both sides of a pair in one chunk
    prepare_hints(in.surfaces, scratch);
    scratch.side.resize(sides);
    if (scratch.chunk.size() < chunk_count(sides, grain)) scratch.chunk.resize(chunk_count(sides, grain));
    parallel_for(sides, grain, [&](uint32_t begin, uint32_t end) {
        OverlapChunk& chunk = scratch.chunk[begin / grain];
        chunk.vertex.clear();
        chunk.point.clear();
        chunk.answer.clear();
        chunk.projected = kNone;
        chunk.counters = {};
        for (uint32_t index = begin; index < end; ++index)
            find_side(in, make_side(in, screened, candidates, scratch, index), scratch.side[index], chunk);
    });

    resize_outputs(sides, scratch, near, contacts);
    parallel_for(sides, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t index = begin; index < end; ++index) write_side(in, scratch, index, scratch.chunk[begin / grain], near, contacts);
    });
    for (uint32_t i = 0; i < chunk_count(sides, grain); ++i) add_to_report(scratch.chunk[i].counters, report);
    keep_hints(in.pairs, near, scratch);
}

}  // namespace trocar
