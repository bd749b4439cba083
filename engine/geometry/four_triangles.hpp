#pragma once
#include "engine/geometry/four_points.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Four triangles, one per lane.
struct FourTriangles {
    FourPoints a, b, c;
};

namespace four_triangles {

// x * y - z * w within 1.5 rounding units of the result
inline Vec4d product_difference(Vec4d x, Vec4d y, Vec4d z, Vec4d w) {
    const Vec4d zw = z * w;
    const Vec4d error = (Vec4d)_mm256_fnmadd_pd((__m256d)z, (__m256d)w, (__m256d)zw);
    return (Vec4d)_mm256_fmsub_pd((__m256d)x, (__m256d)y, (__m256d)zw) + error;
}

inline FourPoints precise_cross(const FourPoints& u, const FourPoints& v) {
    return {product_difference(u.y, v.z, u.z, v.y), product_difference(u.z, v.x, u.x, v.z), product_difference(u.x, v.y, u.y, v.x)};
}

// Squared distance of the origin from r + t e, 0 <= t <= 1, r_end = r + e; at_start = dot(r, e), at_end =
// dot(r_end, e).
inline Vec4d squared_distance_of_segment(const FourPoints& r, const FourPoints& r_end, const FourPoints& e, Vec4d at_start, Vec4d at_end) {
    const Vec4d length2 = norm2(e), along = -at_start;
    const Mask4 first_half = along <= 0.5 * length2, beyond_start = ~(along > Vec4d{}), beyond_end = ~(along < length2);
    const Vec4d share = (first_half ? along : -at_end) / length2;
    const FourPoints from{first_half ? r.x : r_end.x, first_half ? r.y : r_end.y, first_half ? r.z : r_end.z};
    return beyond_start ? norm2(r) : beyond_end ? norm2(r_end) : norm2(from + share * e);
}

}  // namespace four_triangles

// Squared distances (m^2) of a point, the same in all lanes, from four triangles: bitwise those of
// closest_point_on_triangle.
inline Vec4d squared_distances(const FourPoints& p, const FourTriangles& t) {
    using namespace four_triangles;
    const FourPoints ab = t.b - t.a, bc = t.c - t.b, ca = t.a - t.c, ac = t.c - t.a;
    const FourPoints ra = t.a - p, rb = t.b - p, rc = t.c - p;
    const FourPoints n = precise_cross(ab, ac);
    const Vec4d n2 = norm2(n), none = {};
    const Vec4d ra_ab = dot(ra, ab), rb_ab = dot(rb, ab), rb_bc = dot(rb, bc), rc_bc = dot(rc, bc), rc_ca = dot(rc, ca),
                ra_ca = dot(ra, ca);
    const Mask4 has_area = (n2 > none) & ~(n2 <= 0x1p-100 * (norm2(ab) * norm2(ac)));
    const Mask4 within = (dot(cross(n, ab), ra) < none) & (dot(cross(n, bc), rb) < none) & (dot(cross(n, ca), rc) < none);
    const Mask4 beyond_corner = ((ra_ab > none) & (ra_ca < none)) | ((rb_bc > none) & (rb_ab < none)) | ((rc_ca > none) & (rc_bc < none));
    const Vec4d height = dot(n, ra), of_face = height * (height / n2);
    const Vec4d of_edges =
        least(least(squared_distance_of_segment(ra, rb, ab, ra_ab, rb_ab), squared_distance_of_segment(rb, rc, bc, rb_bc, rc_bc)),
              squared_distance_of_segment(rc, ra, ca, rc_ca, ra_ca));
    return (has_area & within & ~beyond_corner) ? of_face : of_edges;
}

}  // namespace trocar
#pragma GCC diagnostic pop
