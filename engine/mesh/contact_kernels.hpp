#pragma once
#include <immintrin.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "components/contacts.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/mesh/surfaces.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Enlargement of a body's boxes: its speculative margin, and half the thickness of a sheet, m.
inline double reach_of(const Bodies& bodies, const BodyBoxes& boxes, uint32_t body) {
    return boxes.margin[body] + 0.5 * bodies.thickness[body];
}

// Speculative margin of a pair: separation of two surfaces below which there is a contact, m.
inline double margin_between(const BodyBoxes& boxes, uint32_t a, uint32_t b) { return boxes.margin[a] + boxes.margin[b]; }

inline bool boxes_meet(const Box& a, const Box& b) {
    return (a.min.array() <= b.max.array()).all() && (b.min.array() <= a.max.array()).all();
}
inline bool same_boxes(std::span<const Box> a, std::span<const Box> b) {
    return std::ranges::equal(a, b, [](const Box& x, const Box& y) { return x.min == y.min && x.max == y.max; });
}
inline bool contains(const Box& box, const Vec3d& p) {
    return (box.min.array() <= p.array()).all() && (p.array() <= box.max.array()).all();
}

inline void resize_contacts(Contacts& contacts, size_t count) {
    contacts.pair.resize(count);
    contacts.body.resize(count);
    contacts.other.resize(count);
    contacts.vertex.resize(count);
    contacts.along.resize(count);
    contacts.third.assign(count, kNone);
    contacts.across.assign(count, 0);
    contacts.point.resize(count);
    contacts.closest.resize(count);
    contacts.normal.resize(count);
    contacts.distance.resize(count);
    contacts.triangle.resize(count);
}

inline void copy_contact(const Contacts& from, uint32_t i, Contacts& to, uint32_t slot) {
    to.pair[slot] = from.pair[i];
    to.body[slot] = from.body[i];
    to.other[slot] = from.other[i];
    to.vertex[slot] = from.vertex[i];
    to.along[slot] = from.along[i];
    to.third[slot] = from.third[i];
    to.across[slot] = from.across[i];
    to.point[slot] = from.point[i];
    to.closest[slot] = from.closest[i];
    to.normal[slot] = from.normal[i];
    to.distance[slot] = from.distance[i];
    to.triangle[slot] = from.triangle[i];
}

// Fraction of the edge from p to q at which it crosses triangle abc; -1 if it certainly does not.
// Conservative: every comparison includes a bound on its rounding error, so errors are only towards "yes".
inline double edge_crossing(Vec4d p, Vec4d q, Vec4d a, Vec4d b, Vec4d c) {
    const auto lower = [](Vec4d x, Vec4d y) { return (Vec4d)_mm256_min_pd((__m256d)x, (__m256d)y); };
    const auto upper = [](Vec4d x, Vec4d y) { return (Vec4d)_mm256_max_pd((__m256d)x, (__m256d)y); };
    const Vec4d low = lower(lower(a, b), c), high = upper(upper(a, b), c);
    const __m256d apart = _mm256_or_pd(_mm256_cmp_pd((__m256d)high, (__m256d)lower(p, q), _CMP_LT_OQ),
                                       _mm256_cmp_pd((__m256d)low, (__m256d)upper(p, q), _CMP_GT_OQ));
    if (_mm256_movemask_pd(apart) != 0) return -1;
    const Vec4d n = cross(b - a, c - a), pa = a - p, pb = b - p, pc = c - p, pq = q - p;
    const auto size_of = [](Vec4d x) { return (Vec4d)_mm256_andnot_pd(_mm256_set1_pd(-0.0), (__m256d)x); };
    const double size = dot(size_of(pa) + size_of(pb) + size_of(pc) + size_of(pq), make_vec4(1, 1, 1));
    const double slack = 1e-14 * size * size * size;
    const double at_p = -dot(n, pa), at_q = at_p + dot(n, pq);
    if ((at_p > slack && at_q > slack) || (at_p < -slack && at_q < -slack)) return -1;
    const double u = dot(pq, cross(pa, pb)), v = dot(pq, cross(pb, pc)), w = dot(pq, cross(pc, pa));
    const bool left = u >= -slack && v >= -slack && w >= -slack, right = u <= slack && v <= slack && w <= slack;
    if (!left && !right) return -1;
    const double change = at_p - at_q;
    return std::abs(change) > slack ? std::clamp(at_p / change, 0.0, 1.0) : 0.5;
}

// Present vertices of one body relative to a base point, four doubles at a time (x, y, z, 0). m
class BodyPoints {
 public:
    BodyPoints(const Surfaces& s, uint32_t body, const Vec3d& base) {
        const MeshInfo& info = s.meshes.info[s.bodies.mesh[body]];
        const Vec3d shift = s.poses.origin[body] - base;
        origin_ = _mm256_setr_pd(shift.x(), shift.y(), shift.z(), 0);
        if (is_deformable(s.bodies, body)) {
            offset_ = s.particles.offset.data() + s.bodies.particles[body].first;
            return;
        }
        rest_ = s.meshes.position.data() + info.vertices.first;
        const auto column = [&](const Vec3d& axis) {
            const Vec3d c = rotate(s.poses.orientation[body], axis);
            return _mm256_setr_pd(c.x(), c.y(), c.z(), 0);
        };
        column_x_ = column(Vec3d::UnitX());
        column_y_ = column(Vec3d::UnitY());
        column_z_ = column(Vec3d::UnitZ());
    }
    __m256d operator()(uint32_t v) const {
        if (offset_ != nullptr) {
            const __m128 p = _mm_load_ps(&offset_[v].x);
            return _mm256_add_pd(_mm256_cvtps_pd(_mm_blend_ps(p, _mm_setzero_ps(), 8)), origin_);
        }
        const double* p = rest_[v].data();
        const __m256d xy =
            _mm256_add_pd(_mm256_mul_pd(_mm256_broadcast_sd(p), column_x_), _mm256_mul_pd(_mm256_broadcast_sd(p + 1), column_y_));
        return _mm256_add_pd(_mm256_add_pd(xy, _mm256_mul_pd(_mm256_broadcast_sd(p + 2), column_z_)), origin_);
    }
    Vec3d point(uint32_t v) const {
        alignas(32) double p[4];
        _mm256_store_pd(p, (*this)(v));
        return {p[0], p[1], p[2]};
    }

 private:
    const Float4* offset_ = nullptr;
    const Vec3d* rest_ = nullptr;
    __m256d origin_, column_x_, column_y_, column_z_;
};

// True if x, y and z are all finite.
inline bool is_finite(__m256d p) { return _mm256_movemask_pd(_mm256_cmp_pd(_mm256_sub_pd(p, p), p, _CMP_UNORD_Q)) == 0; }

// Doubles to a packed box; both ends are moved outward by more than the rounding error.
inline PackedBox pack_box(__m256d min, __m256d max) {
    const __m256 box = _mm256_set_m128(_mm_sub_ps(_mm_setzero_ps(), _mm256_cvtpd_ps(max)), _mm256_cvtpd_ps(min));
    const __m256 size = _mm256_andnot_ps(_mm256_set1_ps(-0.0f), box);
    const __m256 slack = _mm256_add_ps(_mm256_mul_ps(size, _mm256_set1_ps(0x1p-22f)), _mm256_set1_ps(1e-30f));
    PackedBox packed;
    _mm256_store_ps(packed.min.data(), _mm256_sub_ps(box, slack));
    return packed;
}
inline PackedBox pack_box(const Box& box, const Vec3d& origin) {
    const Vec3d a = box.min - origin, b = box.max - origin;
    return pack_box(_mm256_setr_pd(a.x(), a.y(), a.z(), 0), _mm256_setr_pd(b.x(), b.y(), b.z(), 0));
}
inline __m256 load_box(const PackedBox& box) { return _mm256_load_ps(box.min.data()); }
// The side that load_box of another box is compared with.
inline __m256 facing(__m256 box) { return _mm256_sub_ps(_mm256_setzero_ps(), _mm256_permute2f128_ps(box, box, 1)); }
inline bool meets(__m256 facing_a, __m256 b) { return _mm256_movemask_ps(_mm256_cmp_ps(b, facing_a, _CMP_NLE_UQ)) == 0; }

// Cells that a box covers. A cell is half-open: it contains its lower faces but not its upper ones.
struct CellRange {
    alignas(16) std::array<uint32_t, 4> first, last;
};
inline CellRange cells_of(__m256 box, float inv_size) {
    const __m128 scale = _mm_set1_ps(inv_size), zero = _mm_setzero_ps();
    const __m128 low = _mm_mul_ps(_mm256_castps256_ps128(box), scale);
    const __m128 high = _mm_mul_ps(_mm_sub_ps(zero, _mm256_extractf128_ps(box, 1)), scale);
    CellRange cells;
    _mm_store_si128(reinterpret_cast<__m128i*>(cells.first.data()), _mm_cvttps_epi32(_mm_max_ps(low, zero)));
    _mm_store_si128(reinterpret_cast<__m128i*>(cells.last.data()), _mm_cvttps_epi32(_mm_max_ps(high, zero)));
    return cells;
}
inline uint64_t pack_cell(uint32_t x, uint32_t y, uint32_t z) { return uint64_t(x) << 42 | uint64_t(y) << 21 | uint64_t(z); }
// Cell of the larger of the lower corners of two boxes, by the same arithmetic as cells_of.
inline uint64_t cell_of_meeting(__m256 a, __m256 b, float inv_size) {
    const __m128 low = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_castps256_ps128(b));
    alignas(16) std::array<uint32_t, 4> cell;
    _mm_store_si128(reinterpret_cast<__m128i*>(cell.data()),
                    _mm_cvttps_epi32(_mm_max_ps(_mm_mul_ps(low, _mm_set1_ps(inv_size)), _mm_setzero_ps())));
    return pack_cell(cell[0], cell[1], cell[2]);
}

// Distance of a point from a triangle, or an upper bound: to the plane if the projection is inside all three
// edges, else to the nearest edge; slivers, whose plane is lost in rounding, use their edges. m
inline double distance_to_triangle(Vec4d p, Vec4d a, Vec4d b, Vec4d c) {
    const Vec4d ab = b - a, bc = c - b, ca = a - c, pa = a - p, pb = b - p, pc = c - p;
    const Vec4d n = cross(bc, ca);
    const double area = norm2(n), longest = std::max({norm2(ab), norm2(bc), norm2(ca)});
    const bool beyond_ab = dot(cross(pa, pb), n) < 0, beyond_bc = dot(cross(pb, pc), n) < 0, beyond_ca = dot(cross(pc, pa), n) < 0;
    const bool flat = area > 1e-12 * longest * longest;
    if (flat && !beyond_ab && !beyond_bc && !beyond_ca) return std::abs(dot(pa, n)) / std::sqrt(area);
    // only an edge that the projection is beyond can be the nearest
    double best = std::numeric_limits<double>::infinity();
    const auto take = [&](Vec4d from, Vec4d along) {
        const double length = norm2(along);
        const double t = length > 0 ? std::clamp(-dot(from, along) / length, 0.0, 1.0) : 0.0;
        best = std::min(best, norm2(from + t * along));
    };
    if (beyond_ab || !flat) take(pa, ab);
    if (beyond_bc || !flat) take(pb, bc);
    if (beyond_ca || !flat) take(pc, ca);
    return std::sqrt(best);
}

}  // namespace trocar
#pragma GCC diagnostic pop
