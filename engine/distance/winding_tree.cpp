#include "engine/distance/winding_tree.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

// Far field. The winding number is the integral of n . g(x - p) / 4 pi over the surface, g(d) = d / |d|^3 =
// grad(-1/|d|). With x = c + y, d = c - p and r = |d|, Taylor's series in y up to order two gives, N, M and S
// being the symmetric moments, u = d / r:
//   4 pi w = N.u / r^2 + (tr M - 3 u.M.u) / r^3 + (15 S[u,u,u] - 9 trace(S).u) / 2 r^4.
// Error. 1/r is harmonic: its k-th derivative along unit vectors is at most k! / r^(k+1) (Legendre
// polynomials are at most 1; Banach: a symmetric form is largest on its diagonal). The term of order k is
// thus at most (k + 1) |y|^k / r^(k+2) per unit of area, and the truncation error, with rho = radius / r < 1,
// at most
//   integral |y|^3 / r^5 * sum over k >= 3 of (k + 1) rho^(k-3) = third / r^5 * (4 - 3 rho) / (1 - rho)^2.
namespace trocar {
namespace {

// Adds the moments of area vector n at offset s from the centre.
void add_point(const Vec3d& n, const Vec3d& s, WindingCluster& c) {
    for (int k = 0; k < 3; ++k) c.first[k] += n[k] * s[k];
    c.first[3] += 0.5 * (n.x() * s.y() + n.y() * s.x());
    c.first[4] += 0.5 * (n.x() * s.z() + n.z() * s.x());
    c.first[5] += 0.5 * (n.y() * s.z() + n.z() * s.y());
}

// Adds weight * the symmetric part of n x s x s.
void add_square(double weight, const Vec3d& n, const Vec3d& s, WindingCluster& c) {
    const double third = weight / 3;
    for (int k = 0; k < 3; ++k) c.second[k] += weight * n[k] * s[k] * s[k];
    const auto twice = [&](int i, int j) { return third * (2 * n[i] * s[i] * s[j] + n[j] * s[i] * s[i]); };  // i i j
    c.second[3] += twice(0, 1);
    c.second[4] += twice(0, 2);
    c.second[5] += twice(1, 0);
    c.second[6] += twice(1, 2);
    c.second[7] += twice(2, 0);
    c.second[8] += twice(2, 1);
    c.second[9] += third * (n.x() * s.y() * s.z() + n.y() * s.x() * s.z() + n.z() * s.x() * s.y());
}

// Adds the symmetric part of 2 first x s.
void add_shifted_first(const std::array<double, 6>& m, const Vec3d& s, WindingCluster& c) {
    constexpr int kRow[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
    for (int k = 0; k < 3; ++k) c.second[k] += 2 * m[k] * s[k];
    const auto twice = [&](int i, int j) { return 2.0 / 3 * (m[kRow[i][i]] * s[j] + 2 * m[kRow[i][j]] * s[i]); };
    c.second[3] += twice(0, 1);
    c.second[4] += twice(0, 2);
    c.second[5] += twice(1, 0);
    c.second[6] += twice(1, 2);
    c.second[7] += twice(2, 0);
    c.second[8] += twice(2, 1);
    c.second[9] += 2.0 / 3 * (m[3] * s.z() + m[4] * s.y() + m[5] * s.x());
}

}  // namespace

WindingCluster winding_cluster(std::span<const std::array<Vec3d, 3>> triangles) {
    WindingCluster c;
    Vec3d middle = Vec3d::Zero(), weighted = Vec3d::Zero();
    for (const auto& [a, b, d] : triangles) {
        const Vec3d n = 0.5 * (b - a).cross(d - a);
        const double area = n.norm();
        c.normal += n;
        c.area += area;
        weighted += area / 3 * (a + b + d);
        middle += a;
    }
    c.centre = c.area > 0 ? Vec3d(weighted / c.area) : Vec3d(middle / static_cast<double>(triangles.size()));
    for (const auto& [a, b, d] : triangles) {
        const Vec3d y[3] = {a - c.centre, b - c.centre, d - c.centre};
        const Vec3d n = 0.5 * (b - a).cross(d - a), sum = y[0] + y[1] + y[2];
        add_point(n, sum / 3, c);
        // the mean of y y^T over a triangle: (sum over its corners + term of the corners' sum) / 12
        add_square(1.0 / 12, n, sum, c);
        double cubes = 0;
        for (const Vec3d& v : y) {
            add_square(1.0 / 12, n, v, c);
            const double length = v.norm();
            cubes += length * length * length;
            c.radius = std::max(c.radius, length);
        }
        c.third += n.norm() * cubes / 3;  // convex: its mean over the triangle is at most that over the corners
    }
    return c;
}

WindingCluster join_clusters(std::span<const WindingCluster> parts) {
    WindingCluster c;
    Vec3d weighted = Vec3d::Zero();
    for (const WindingCluster& part : parts) {
        c.normal += part.normal;
        c.area += part.area;
        weighted += part.area * part.centre;
    }
    c.centre = c.area > 0 ? Vec3d(weighted / c.area) : parts[0].centre;
    for (const WindingCluster& part : parts) {
        const Vec3d s = part.centre - c.centre;
        const double shift = s.norm();
        for (int k = 0; k < 6; ++k) c.first[k] += part.first[k];
        for (int k = 0; k < 10; ++k) c.second[k] += part.second[k];
        add_point(part.normal, s, c);
        add_square(1, part.normal, s, c);
        add_shifted_first(part.first, s, c);
        const double root = std::cbrt(part.third) + shift * std::cbrt(part.area);  // Minkowski's inequality
        c.third += root * root * root;
        c.radius = std::max(c.radius, shift + part.radius);
    }
    return c;
}

FarField far_field(const WindingCluster& c, const Vec3d& p) {
    const Vec3d d = c.centre - p;
    const double r2 = d.squaredNorm(), r = std::sqrt(r2), rho = c.radius / r;
    if (!(rho < 1)) return {0, INFINITY};
    constexpr double kPerTurn = 1 / (4 * std::numbers::pi);
    const double per_r = 1 / r, per_r2 = per_r * per_r;
    const double error = kPerTurn * c.third * per_r2 * per_r2 * per_r * (4 - 3 * rho) / ((1 - rho) * (1 - rho));
    const Vec3d u = d * per_r;
    const auto& m = c.first;
    const auto& s = c.second;
    const double x = u.x(), y = u.y(), z = u.z();
    const double along = m[0] * x * x + m[1] * y * y + m[2] * z * z + 2 * (m[3] * x * y + m[4] * x * z + m[5] * y * z);
    const double cubic = x * (x * (s[0] * x + 3 * (s[3] * y + s[4] * z)) + 3 * s[5] * y * y + 6 * s[9] * y * z) +
                         y * (y * (s[1] * y + 3 * s[6] * z)) + z * z * (s[2] * z + 3 * (s[7] * x + s[8] * y));
    const double trace = (s[0] + s[5] + s[7]) * x + (s[3] + s[1] + s[8]) * y + (s[4] + s[6] + s[2]) * z;
    const double value = c.normal.dot(u) + per_r * (m[0] + m[1] + m[2] - 3 * along) + 0.5 * per_r2 * (15 * cubic - 9 * trace);
    return {kPerTurn * per_r2 * value, error};
}

void join_winding_tree(const BoxTree& tree, WindingTree& winding) {
    winding.node.resize(tree.node.size());
    for (size_t at = tree.node.size(); at-- > 0;) {
        const BoxNode& n = tree.node[at];
        std::array<WindingCluster, 8> part;
        for (uint32_t i = 0; i < n.count; ++i)
            part[i] = n.child[i] >= kBoxLeaf ? winding.box[n.child[i] & ~kBoxLeaf] : winding.node[n.child[i]];
        winding.node[at] = join_clusters(std::span(part).first(n.count));
    }
}

}  // namespace trocar
