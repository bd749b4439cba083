#include "engine/geometry/point_triangle.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
namespace trocar {
namespace {

// Scalars only: vectorised code would reload pairs just written one by one, and wait for the store.
double dot(const Vec3d& u, const Vec3d& v) { return u.x() * v.x() + u.y() * v.y() + u.z() * v.z(); }
// (u x v) . w
double triple(const Vec3d& u, const Vec3d& v, const Vec3d& w) {
    return (u.y() * v.z() - u.z() * v.y()) * w.x() + (u.z() * v.x() - u.x() * v.z()) * w.y() + (u.x() * v.y() - u.y() * v.x()) * w.z();
}
// x * y - z * w within 1.5 rounding units of the result
double product_difference(double x, double y, double z, double w) {
    const double zw = z * w;
    const double error = std::fma(-z, w, zw);
    return std::fma(x, y, -zw) + error;
}
Vec3d precise_cross(const Vec3d& u, const Vec3d& v) {
    return {product_difference(u.y(), v.z(), u.z(), v.y()), product_difference(u.z(), v.x(), u.x(), v.z()),
            product_difference(u.x(), v.y(), u.y(), v.x())};
}
struct SegmentPoint {
    Vec3d offset;
    double squared_distance;
    int end;  // 0 start, 1 end, 2 between
};

// closest point to the origin on r + t e, 0 <= t <= 1, with r_end = r + e. Ends are taken from their own
// corner, so that two edges that share it give the same bits.
SegmentPoint closest_on_segment(const Vec3d& r, const Vec3d& r_end, const Vec3d& e) {
    const double along = -dot(r, e);
    const double length2 = dot(e, e);
    if (!(along > 0)) return {r, dot(r, r), 0};
    if (!(along < length2)) return {r_end, dot(r_end, r_end), 1};
    // from the nearer end, so that the product t * e is shorter
    const Vec3d q = along <= 0.5 * length2 ? Vec3d(r + (along / length2) * e) : Vec3d(r_end - (dot(r_end, e) / length2) * e);
    return {q, dot(q, q), 2};
}

}  // namespace

Vec3d triangle_normal(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    // rounding u and v equals moving b and c by a rounding unit of the edges; rounding the products does not
    const Vec3d u = b - a, v = c - a;
    const Vec3d n = precise_cross(u, v);
    if (dot(n, n) <= 0x1p-100 * (dot(u, u) * dot(v, v))) return Vec3d::Zero();
    return n;
}

TrianglePoint closest_point_on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d ab = b - a, bc = c - b, ca = a - c;
    const Vec3d ra = a - p, rb = b - p, rc = c - p;
    const Vec3d n = triangle_normal(a, b, c);
    const double n2 = dot(n, n);
    double x, y, z;
    if (n2 > 0 && (x = triple(n, ab, ra)) < 0 && (y = triple(n, bc, rb)) < 0 && (z = triple(n, ca, rc)) < 0) {
        // at a needle's tip rounding lets points far beyond it pass the planes: test the vertex regions too
        const bool beyond_a = dot(ra, ab) > 0 && dot(ra, ca) < 0;
        const bool beyond_b = dot(rb, bc) > 0 && dot(rb, ab) < 0;
        const bool beyond_c = dot(rc, ca) > 0 && dot(rc, bc) < 0;
        if (!beyond_a && !beyond_b && !beyond_c) {
            const double h = dot(n, ra);
            const double k = h / n2;
            return {k * n, h * k, -h / std::sqrt(n2), -std::max({x, y, z}) / n2, Feature::kFace};
        }
    }
    constexpr Feature kFeatures[3][3] = {{Feature::kVertex0, Feature::kVertex1, Feature::kEdge0},
                                         {Feature::kVertex1, Feature::kVertex2, Feature::kEdge1},
                                         {Feature::kVertex2, Feature::kVertex0, Feature::kEdge2}};
    const SegmentPoint side[3] = {closest_on_segment(ra, rb, ab), closest_on_segment(rb, rc, bc), closest_on_segment(rc, ra, ca)};
    int best = 0;
    for (int k = 1; k < 3; ++k)
        if (side[k].squared_distance < side[best].squared_distance) best = k;
    return {side[best].offset, side[best].squared_distance, 0, 0, kFeatures[best][side[best].end]};
}

}  // namespace trocar
