#include "systems/detect/narrow/contours.hpp"

#include <Eigen/Geometry>
#include <algorithm>

#include "engine/base/append.hpp"
#include "engine/base/subspan.hpp"
#include "engine/geometry/predicates.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

using Corners = std::array<Vec3d, 3>;
using Signs = std::array<int, 3>;

struct Face {
    Corners corner;
    uint32_t index;
    const Triangle* vertex;
    const std::array<uint32_t, 3>* edge;
};

// Sign of the side of b's face on which a point of a lies; b moves.
int side_to_moving(const Corners& face, const Vec3d& p) {
    const int side = orient3d(face[0], face[1], face[2], p);
    return side != 0 ? side : -orient3d_moving_point(face[0], face[1], face[2], p);
}

// Whether the line through an edge of a (p, q) meets the face of b, or an edge of b the face of a.
bool passes_face_of_b(const Vec3d& p, const Vec3d& q, const Corners& b) {
    const int first = orient3d_moving_edge(p, q, b[0], b[1]);
    return first != 0 && orient3d_moving_edge(p, q, b[1], b[2]) == first && orient3d_moving_edge(p, q, b[2], b[0]) == first;
}
bool passes_face_of_a(const Vec3d& p, const Vec3d& q, const Corners& a) {
    const int first = orient3d_moving_edge(a[0], a[1], p, q);
    return first != 0 && orient3d_moving_edge(a[1], a[2], p, q) == first && orient3d_moving_edge(a[2], a[0], p, q) == first;
}

// Intersection of edge k of a face with the plane of another. side: of the face's corners to that plane.
ContourHit make_hit(const Face& own, int k, const Signs& side, const Face& other, bool of_b) {
    int from = k, to = (k + 1) % 3;
    if ((*own.vertex)[from] > (*own.vertex)[to]) std::swap(from, to);
    const Vec3d normal = (other.corner[1] - other.corner[0]).cross(other.corner[2] - other.corner[0]);
    const double height_from = normal.dot(own.corner[from] - other.corner[0]);
    const double height_to = normal.dot(own.corner[to] - other.corner[0]);
    const double change = height_from - height_to;
    ContourHit hit;
    hit.key = uint64_t(of_b) << 63 | uint64_t((*own.edge)[k]) << 32 | other.index;
    hit.along = change != 0 ? std::clamp(height_from / change, 0.0, 1.0) : 0.5;
    hit.outward = side[from] < 0;
    return hit;
}

// Intersection of two faces, if any: a segment with b's inside to its left on a. Going around a face, its
// edges leave the inside where the segment starts on a, and where it ends on b.
bool cross_faces(const Face& a, const Face& b, ContourPiece& piece) {
    const Corners &p = a.corner, &q = b.corner;
    Signs side_b, side_a;
    for (int k = 0; k < 3; ++k) side_b[k] = orient3d_moving_point(p[0], p[1], p[2], q[k]);
    if (side_b[0] == side_b[1] && side_b[1] == side_b[2] && side_b[0] != 0) return false;
    for (int k = 0; k < 3; ++k) side_a[k] = side_to_moving(q, p[k]);
    if (side_a[0] == side_a[1] && side_a[1] == side_a[2] && side_a[0] != 0) return false;
    int hits[2] = {0, 0};
    for (int k = 0; k < 3; ++k) {
        const int l = (k + 1) % 3;
        if (side_a[k] * side_a[l] < 0 && passes_face_of_b(p[k], p[l], q)) {
            const int which = side_a[k] < 0 ? 0 : 1;
            piece.hit[which] = make_hit(a, k, side_a, b, false);
            ++hits[which];
        }
        if (side_b[k] * side_b[l] < 0 && passes_face_of_a(q[k], q[l], p)) {
            const int which = side_b[k] < 0 ? 1 : 0;
            piece.hit[which] = make_hit(b, k, side_b, a, true);
            ++hits[which];
        }
    }
    piece.triangle = {a.index, b.index};
    return hits[0] == 1 && hits[1] == 1;
}

struct PairInput {
    MeshView mesh_a, mesh_b;
    BodyPoints points_a, points_b;
    Vec3d origin;
};

Face face_of(const MeshView& mesh, const BodyPoints& points, uint32_t index) {
    const Triangle& t = mesh.triangle[index];
    return {{points.point(t[0]), points.point(t[1]), points.point(t[2])}, index, &t, &mesh.triangle_edge[index]};
}

void find_pieces(const PairInput& in, std::span<const std::array<uint32_t, 2>> candidates, ContourChunk& c) {
    c.piece.clear();
    Face a{};
    a.index = kNone;
    ContourPiece piece;
    for (const auto& [index_a, index_b] : candidates) {
        if (index_a != a.index) a = face_of(in.mesh_a, in.points_a, index_a);
        if (cross_faces(a, face_of(in.mesh_b, in.points_b, index_b), piece)) c.piece.push_back(piece);
    }
}

Vec3d position_of(const PairInput& in, const ContourHit& hit) {
    const bool of_b = hit.key >> 63;
    const auto& [from, to] = (of_b ? in.mesh_b : in.mesh_a).edge[hit.key >> 32 & 0x7FFFFFFF];
    const BodyPoints& points = of_b ? in.points_b : in.points_a;
    const Vec3d p = points.point(from), q = points.point(to);
    return in.origin + p + hit.along * (q - p);
}

// Numbers a pair's points in key order and links every segment end to a start at the same point.
void link_pieces(const PairInput& in, uint32_t first_point, ContourChunk& c) {
    const uint32_t count = uint32_t(c.piece.size());
    c.end.clear();
    for (uint32_t i = 0; i < count; ++i) {
        for (uint32_t which = 0; which < 2; ++which) c.end.push_back({c.piece[i].hit[which].key, i, which});
    }
    std::sort(c.end.begin(), c.end.end(), [](const ContourEnd& x, const ContourEnd& y) {
        return x.key != y.key ? x.key < y.key : x.which != y.which ? x.which < y.which : x.piece < y.piece;
    });
    c.next.assign(count, kNone);
    c.before.assign(count, kNone);
    c.point_of.resize(count);
    Contours& found = c.found;
    for (uint32_t i = 0; i < c.end.size();) {
        uint32_t starts = i, last = i;
        while (last < c.end.size() && c.end[last].key == c.end[i].key) ++last;
        while (starts < last && c.end[starts].which == 0) ++starts;
        for (uint32_t k = 0; i + k < starts && starts + k < last; ++k) {
            c.next[c.end[starts + k].piece] = c.end[i + k].piece;
            c.before[c.end[i + k].piece] = c.end[starts + k].piece;
        }
        const ContourHit& hit = c.piece[c.end[i].piece].hit[c.end[i].which];
        for (; i < last; ++i) c.point_of[c.end[i].piece][c.end[i].which] = uint32_t(found.point.size()) - first_point;
        found.point.push_back(position_of(in, hit));
        found.edge.push_back(uint32_t(hit.key >> 32 & 0x7FFFFFFF));
        found.edge_of_b.push_back(hit.key >> 63);
        found.pierced.push_back(uint32_t(hit.key));
        found.along.push_back(hit.along);
        found.outward.push_back(hit.outward);
    }
}

// Writes the curve that starts with a piece.
void follow(uint32_t piece, bool closed, uint32_t first_segment, ContourChunk& c) {
    Contours& found = c.found;
    const uint32_t first = uint32_t(found.triangle.size());
    for (uint32_t i = piece; i != kNone && !c.done[i]; i = c.next[i]) {
        c.done[i] = 1;
        found.triangle.push_back(c.piece[i].triangle);
        found.end.push_back(c.point_of[i]);
    }
    found.curve.push_back({first - first_segment, uint32_t(found.triangle.size()) - first});
    found.closed.push_back(closed);
}

void find_contours_of(const PairInput& in, std::span<const std::array<uint32_t, 2>> candidates, ContourChunk& c) {
    const uint32_t point = uint32_t(c.found.point.size()), segment = uint32_t(c.found.triangle.size()),
                   curve = uint32_t(c.found.curve.size());
    find_pieces(in, candidates, c);
    link_pieces(in, point, c);
    c.done.assign(c.piece.size(), 0);
    for (uint32_t i = 0; i < c.piece.size(); ++i) {
        if (c.before[i] == kNone) follow(i, false, segment, c);
    }
    for (uint32_t i = 0; i < c.piece.size(); ++i) {
        if (!c.done[i]) follow(i, true, segment, c);
    }
    c.points.push_back({point, uint32_t(c.found.point.size()) - point});
    c.segments.push_back({segment, uint32_t(c.found.triangle.size()) - segment});
    c.found.pair.push_back({curve, uint32_t(c.found.curve.size()) - curve});
}

void clear(Contours& c) {
    c.pair.clear(), c.curve.clear(), c.closed.clear(), c.triangle.clear(), c.end.clear(), c.point.clear();
    c.edge.clear(), c.edge_of_b.clear(), c.pierced.clear(), c.along.clear(), c.outward.clear();
}

// Appends the pairs of a chunk; their indices then count from the first of all pairs.
void append_chunk(const ContourChunk& c, Contours& out) {
    const uint32_t curve = uint32_t(out.curve.size());
    for (uint32_t p = 0; p < c.found.pair.size(); ++p) {
        const uint32_t point = uint32_t(out.point.size()) + c.points[p].first,
                       segment = uint32_t(out.triangle.size()) + c.segments[p].first;
        const Range curves = c.found.pair[p], segments = c.segments[p];
        out.pair.push_back({curve + curves.first, curves.count});
        for (uint32_t i = curves.first; i < curves.end(); ++i)
            out.curve.push_back({segment + c.found.curve[i].first, c.found.curve[i].count});
        for (uint32_t i = segments.first; i < segments.end(); ++i)
            out.end.push_back({point + c.found.end[i][0], point + c.found.end[i][1]});
    }
    append(c.found.closed, out.closed), append(c.found.triangle, out.triangle), append(c.found.point, out.point);
    append(c.found.edge, out.edge), append(c.found.edge_of_b, out.edge_of_b), append(c.found.pierced, out.pierced);
    append(c.found.along, out.along), append(c.found.outward, out.outward);
}

}  // namespace

void find_contours(const ContactInputs& in, const CandidateTriangles& candidates, ContoursScratch& scratch, Contours& contours) {
    const Surfaces& s = in.surfaces;
    const BroadPhasePairs& pairs = in.pairs;
    const uint32_t count = uint32_t(pairs.a.size()), grain = coarse_grain(count), chunks = chunk_count(count, grain);
    if (scratch.chunk.size() < chunks) scratch.chunk.resize(chunks);
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        ContourChunk& chunk = scratch.chunk[begin / grain];
        clear(chunk.found);
        chunk.points.clear();
        chunk.segments.clear();
        for (uint32_t pair = begin; pair < end; ++pair) {
            const uint32_t a = pairs.a[pair], b = pairs.b[pair];
            const Vec3d origin = s.poses.origin[a];
            const PairInput both{mesh_view(s.meshes, s.bodies.mesh[a]), mesh_view(s.meshes, s.bodies.mesh[b]), BodyPoints(s, a, origin),
                                 BodyPoints(s, b, origin), origin};
            find_contours_of(both, subspan(candidates.triangle, candidates.pair[pair]), chunk);
        }
    });
    clear(contours);
    for (uint32_t i = 0; i < chunks; ++i) append_chunk(scratch.chunk[i], contours);
}

}  // namespace trocar
