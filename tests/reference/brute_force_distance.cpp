#include "tests/reference/brute_force_distance.hpp"

#include <cmath>
namespace trocar {
namespace {

using Quad = __float128;
struct Quad3 {
    Quad x, y, z;
};
Quad3 difference(const Vec3d& a, const Vec3d& b) {
    return {Quad(a.x()) - Quad(b.x()), Quad(a.y()) - Quad(b.y()), Quad(a.z()) - Quad(b.z())};
}
Quad dot(const Quad3& a, const Quad3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Quad3 combine(const Quad3& r, Quad s, const Quad3& u, Quad t, const Quad3& v) {
    return {r.x + s * u.x + t * v.x, r.y + s * u.y + t * v.y, r.z + s * u.z + t * v.z};
}
// r = start - query
Quad segment_squared(const Quad3& r, const Quad3& e) {
    const Quad ee = dot(e, e);
    Quad t = ee > 0 ? -dot(r, e) / ee : Quad(0);
    t = t < 0 ? Quad(0) : t > 1 ? Quad(1) : t;
    const Quad3 q = combine(r, t, e, 0, e);
    return dot(q, q);
}
// the scale keeps the argument of the root in the range of long double
double root(Quad squared) { return static_cast<double>(std::sqrt(static_cast<long double>(squared))); }

Quad triangle_squared(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Quad3 r = difference(a, p), u = difference(b, a), v = difference(c, a), w = difference(c, b);
    const Quad uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), ru = dot(r, u), rv = dot(r, v);
    const Quad determinant = uu * vv - uv * uv;
    Quad least = INFINITY;
    if (determinant > 0) {
        const Quad s = (uv * rv - vv * ru) / determinant, t = (uv * ru - uu * rv) / determinant;
        if (s >= 0 && t >= 0 && s + t <= 1) {
            const Quad3 q = combine(r, s, u, t, v);
            least = dot(q, q);
        }
    }
    // always compare with the sides: where the determinant is rounding noise, the projection is just some
    // point of the triangle
    const Quad ab = segment_squared(r, u), ac = segment_squared(r, v), bc = segment_squared(difference(b, p), w);
    for (const Quad side : {ab, ac, bc}) least = side < least ? side : least;
    return least;
}

}  // namespace

double exact_triangle_distance(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    return root(triangle_squared(p, a, b, c));
}

BruteForceAnswer brute_force_distance(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p) {
    BruteForceAnswer answer;
    double nearest_vertex = INFINITY;
    for (const Triangle& t : triangle)
        for (const uint32_t v : t) nearest_vertex = std::min(nearest_vertex, (position[v] - p).norm());
    Quad best = INFINITY;
    double reach = nearest_vertex;
    for (uint32_t t = 0; t < triangle.size(); ++t) {
        const Vec3d &a = position[triangle[t][0]], &b = position[triangle[t][1]], &c = position[triangle[t][2]];
        const double radius = std::sqrt(std::max((b - a).squaredNorm(), (c - a).squaredNorm()));
        if ((a - p).norm() - radius > reach * (1 + 1e-9)) continue;
        const Quad squared = triangle_squared(p, a, b, c);
        if (!(squared < best)) continue;
        best = squared;
        answer.triangle = t;
        reach = std::min(reach, root(squared));
    }
    answer.distance = root(best);
    answer.winding = brute_force_winding(position, triangle, p);
    return answer;
}

double brute_force_winding(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p) {
    double sum = 0;
    for (const Triangle& t : triangle) {
        double x[3][3], length[3];
        for (int k = 0; k < 3; ++k) {
            for (int j = 0; j < 3; ++j) x[k][j] = position[t[k]][j] - p[j];
            length[k] = std::sqrt(x[k][0] * x[k][0] + x[k][1] * x[k][1] + x[k][2] * x[k][2]);
        }
        const auto scalar = [&](int i, int j) { return x[i][0] * x[j][0] + x[i][1] * x[j][1] + x[i][2] * x[j][2]; };
        // determinant from differences: the direct formula cancels for distant triangles
        double u[3], v[3];
        for (int j = 0; j < 3; ++j) u[j] = x[1][j] - x[0][j], v[j] = x[2][j] - x[0][j];
        const double determinant =
            x[0][0] * (u[1] * v[2] - u[2] * v[1]) + x[0][1] * (u[2] * v[0] - u[0] * v[2]) + x[0][2] * (u[0] * v[1] - u[1] * v[0]);
        sum += 2 * std::atan2(determinant, length[0] * length[1] * length[2] + scalar(0, 1) * length[2] + scalar(1, 2) * length[0] +
                                               scalar(2, 0) * length[1]);
    }
    return sum / (4 * 3.14159265358979323846);
}

}  // namespace trocar
