#include "systems/parted_triangles.hpp"

#include <algorithm>
#include <span>

#include "engine/geometry/contact_kernels.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostChunks = 64;

FlatTriangle flatten(const BodyPoints& points, const Triangle& t) {
    const Vec4d a = (Vec4d)points(t[0]), b = (Vec4d)points(t[1]), c = (Vec4d)points(t[2]);
    const Vec4d u = b - a, v = c - a, normal = cross(u, v);
    return {side_by_side(a, b, c, c), a, normal, norm2(u) * norm2(v)};
}

// Whether a triangle surely lies on one side of another's plane: rounding takes 1e-15 of the lengths that are multiplied.
bool is_beside(const FlatTriangle& t, const FlatTriangle& plane) {
    constexpr double kSure = 1e-10;
    const FourPoints q{t.corner.x - plane.start[0], t.corner.y - plane.start[1], t.corner.z - plane.start[2]};
    const Vec4d side = plane.normal[0] * q.x + plane.normal[1] * q.y + plane.normal[2] * q.z;
    const Mask4 sure = side * side > (kSure * kSure * plane.size2) * norm2(q);
    const uint32_t above = mask_bits(sure & (side > 0)), below = mask_bits(sure & (side < 0));
    return above == 15 || below == 15;
}

// Moves the rows of a pair that stay to its front. Returns how many they are.
uint32_t sift(const Surfaces& s, uint32_t a, uint32_t b, std::span<std::array<uint32_t, 2>> rows, PartedTrianglesScratch::Chunk& c) {
    const MeshView mesh_a = mesh_view(s.meshes, s.bodies.mesh[a]), mesh_b = mesh_view(s.meshes, s.bodies.mesh[b]);
    const BodyPoints points_a(s, a, s.poses.origin[a]), points_b(s, b, s.poses.origin[a]);
    c.flat.clear();
    c.row.resize(std::max(c.row.size(), mesh_b.triangle.size()), kNone);
    FlatTriangle own;
    uint32_t last = kNone, kept = 0;
    c.used.clear();
    for (const auto [triangle, other] : rows) {
        if (triangle != last) own = flatten(points_a, mesh_a.triangle[last = triangle]);
        if (c.row[other] == kNone) {
            c.row[other] = uint32_t(c.flat.size());
            c.flat.push_back(flatten(points_b, mesh_b.triangle[other]));
            c.used.push_back(other);
        }
        const FlatTriangle& far = c.flat[c.row[other]];
        if (!is_beside(own, far) && !is_beside(far, own)) rows[kept++] = {triangle, other};
    }
    for (const uint32_t triangle : c.used) c.row[triangle] = kNone;
    return kept;
}

}  // namespace

void drop_parted_triangles(const Surfaces& surfaces, const CandidatePairs& pairs, PartedTrianglesScratch& scratch,
                           CandidateTriangles& candidates) {
    const uint32_t count = uint32_t(pairs.a.size()), grain = std::max(1u, chunk_count(count, kMostChunks));
    if (scratch.chunk.size() < chunk_count(count, grain)) scratch.chunk.resize(chunk_count(count, grain));
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t pair = begin; pair < end; ++pair) {
            Range& range = candidates.pair[pair];
            const auto rows = std::span(candidates.triangle).subspan(range.first, range.count);
            range.count = sift(surfaces, pairs.a[pair], pairs.b[pair], rows, scratch.chunk[begin / grain]);
        }
    });
    uint32_t kept = 0;
    for (Range& range : candidates.pair) {
        const auto from = candidates.triangle.begin() + range.first;
        std::copy(from, from + range.count, candidates.triangle.begin() + kept);
        range.first = kept;
        kept += range.count;
    }
    candidates.triangle.resize(kept);
}

}  // namespace trocar
