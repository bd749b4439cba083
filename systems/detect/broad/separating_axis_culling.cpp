#include "systems/detect/broad/separating_axis_culling.hpp"

#include <algorithm>
#include <bit>
#include <span>

#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

FlatTriangle flatten(const BodyPoints& points, const Triangle& t) {
    const Vec4d a = (Vec4d)points(t[0]), b = (Vec4d)points(t[1]), c = (Vec4d)points(t[2]);
    const Vec4d u = b - a, v = c - a, normal = cross(u, v);
    return {side_by_side(a, b, c, c), a, normal, norm2(u) * norm2(v)};
}

// Heights of a triangle's corners over another's plane. Corners in neither set are within rounding of it.
struct Heights {
    Vec4d height;           // m^3: height times the length of the plane's normal
    uint32_t above, below;  // bits of the corners; the fourth is the third
    double reach2;          // m^2, sum of the squared distances from the plane's first corner

    bool on_one_side() const { return above == 15 || below == 15; }
    bool sure() const { return (above | below) == 15; }
};

// Rounding is at most 1e-15 of the product of the lengths.
Heights heights_over(const FlatTriangle& t, const FlatTriangle& plane) {
    constexpr double kSure = 1e-10;
    const FourPoints q{t.corner.x - plane.start[0], t.corner.y - plane.start[1], t.corner.z - plane.start[2]};
    const Vec4d height = plane.normal[0] * q.x + plane.normal[1] * q.y + plane.normal[2] * q.z, size2 = norm2(q);
    const Mask4 sure = height * height > (kSure * kSure * plane.size2) * size2;
    return {height, mask_bits(sure & (height > 0)), mask_bits(sure & (height < 0)), (size2[0] + size2[1]) + (size2[2] + size2[3])};
}

struct Span {
    double low, high;
};

// Interval that a triangle cuts out of a line in a plane that it crosses. All heights must be certain.
Span cut_of(const FlatTriangle& t, const Heights& h, Vec4d axis, Vec4d base) {
    const Vec4d along = axis[0] * (t.corner.x - base[0]) + axis[1] * (t.corner.y - base[1]) + axis[2] * (t.corner.z - base[2]);
    const uint32_t above = h.above & 7, one = std::popcount(above) == 1 ? above : above ^ 7;  // the corner that is alone on its side
    const int i = std::countr_zero(one), j = (i + 1) % 3, k = (i + 2) % 3;
    const double from = along[i], first = from + (along[j] - from) * (h.height[i] / (h.height[i] - h.height[j])),
                 second = from + (along[k] - from) * (h.height[i] / (h.height[i] - h.height[k]));
    return {std::min(first, second), std::max(first, second)};
}

// Whether two triangles that cross each other's planes surely cut disjoint intervals from the common line
// (Moller, JGT 2, 1997). Heights just above the certainty threshold have a relative error of 1e-5.
bool are_beside_each_other(const FlatTriangle& a, const Heights& over_b, const FlatTriangle& b, const Heights& over_a) {
    constexpr double kParallel = 1e-6, kSure = 1e-4;
    if (!over_a.sure() || !over_b.sure()) return false;
    const Vec4d axis = cross(a.normal, b.normal);
    const double axis2 = norm2(axis);
    if (!(axis2 > kParallel * kParallel * a.size2 * b.size2)) return false;
    const Span of_a = cut_of(a, over_b, axis, b.start), of_b = cut_of(b, over_a, axis, b.start);
    const double separation = std::max(of_a.low - of_b.high, of_b.low - of_a.high);
    return separation > 0 && separation * separation > kSure * kSure * axis2 * (over_a.reach2 + over_b.reach2);
}

// Moves a pair's kept candidates to its front and marks those that do not cross. Returns their number.
uint32_t sift(const Surfaces& s, uint32_t a, uint32_t b, std::span<std::array<uint32_t, 2>> near_pairs, uint8_t* beside,
              SeparatingAxisScratch::Chunk& c) {
    const MeshView mesh_a = mesh_view(s.meshes, s.bodies.mesh[a]), mesh_b = mesh_view(s.meshes, s.bodies.mesh[b]);
    const BodyPoints points_a(s, a, s.poses.origin[a]), points_b(s, b, s.poses.origin[a]);
    c.flat.clear();
    c.flat_index.resize(std::max(c.flat_index.size(), mesh_b.triangle.size()), kNone);
    FlatTriangle own;
    uint32_t last = kNone, kept = 0;
    c.used.clear();
    for (const auto [triangle, other] : near_pairs) {
        if (triangle != last) own = flatten(points_a, mesh_a.triangle[last = triangle]);
        if (c.flat_index[other] == kNone) {
            c.flat_index[other] = uint32_t(c.flat.size());
            c.flat.push_back(flatten(points_b, mesh_b.triangle[other]));
            c.used.push_back(other);
        }
        const FlatTriangle& far = c.flat[c.flat_index[other]];
        const Heights over_far = heights_over(own, far);
        if (over_far.on_one_side()) continue;
        const Heights over_own = heights_over(far, own);
        if (over_own.on_one_side()) continue;
        beside[kept] = are_beside_each_other(own, over_far, far, over_own);
        near_pairs[kept++] = {triangle, other};
    }
    for (const uint32_t triangle : c.used) c.flat_index[triangle] = kNone;
    return kept;
}

}  // namespace

void cull_by_separating_axis(const ContactInputs& in, SeparatingAxisScratch& scratch, CandidateTriangles& candidates) {
    const BroadPhasePairs& pairs = in.pairs;
    const uint32_t count = uint32_t(pairs.a.size()), grain = coarse_grain(count);
    if (scratch.chunk.size() < chunk_count(count, grain)) scratch.chunk.resize(chunk_count(count, grain));
    candidates.beside.resize(candidates.triangle.size());
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t pair = begin; pair < end; ++pair) {
            Range& range = candidates.pair[pair];
            const auto near_pairs = std::span(candidates.triangle).subspan(range.first, range.count);
            range.count = sift(in.surfaces, pairs.a[pair], pairs.b[pair], near_pairs, candidates.beside.data() + range.first,
                               scratch.chunk[begin / grain]);
        }
    });
    uint32_t kept = 0;
    for (Range& range : candidates.pair) {
        const auto from = candidates.triangle.begin() + range.first;
        std::copy(from, from + range.count, candidates.triangle.begin() + kept);
        const auto beside = candidates.beside.begin() + range.first;
        std::copy(beside, beside + range.count, candidates.beside.begin() + kept);
        range.first = kept;
        kept += range.count;
    }
    candidates.triangle.resize(kept);
    candidates.beside.resize(kept);
}

}  // namespace trocar
