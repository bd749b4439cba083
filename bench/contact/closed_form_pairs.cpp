#include "bench/contact/closed_form_pairs.hpp"

#include <algorithm>
#include <cmath>
namespace trocar::bench {
namespace {

using namespace trocar::test;

constexpr double kScale = 0.05;  // m per unit

Mesh scaled(Mesh mesh) {
    for (Vec3d& p : mesh.position) p *= kScale;
    order_for_locality(mesh);
    return mesh;
}
Mesh ball(double r, uint32_t n) {
    return scaled(make_sphere(n, [=](const Vec3d& p) { return Vec3d(r * p); }));
}
Mesh ellipsoid(const Vec3d& half, uint32_t n) {
    return scaled(make_sphere(n, [=](const Vec3d& p) { return Vec3d(half.cwiseProduct(p)); }));
}
Mesh box(const Vec3d& size, uint32_t n) { return scaled(make_box(size, {n, n, n})); }

// Solid of revolution about z from (radius, z) points, the first and the last on the axis.
Mesh lathe(const std::vector<std::array<double, 2>>& outline, uint32_t around) {
    Mesh mesh;
    const uint32_t rings = uint32_t(outline.size()) - 2;
    mesh.position.push_back({0, 0, outline.front()[1]});
    for (uint32_t i = 1; i <= rings; ++i) {
        for (uint32_t j = 0; j < around; ++j) {
            const double u = 2 * M_PI * j / around;
            mesh.position.push_back({outline[i][0] * std::cos(u), outline[i][0] * std::sin(u), outline[i][1]});
        }
    }
    mesh.position.push_back({0, 0, outline.back()[1]});
    const uint32_t top = uint32_t(mesh.position.size()) - 1;
    const auto at = [&](uint32_t ring, uint32_t j) { return 1 + ring * around + j % around; };
    for (uint32_t j = 0; j < around; ++j) {
        mesh.triangle.push_back({0, at(0, j + 1), at(0, j)});
        for (uint32_t i = 0; i + 1 < rings; ++i) {
            mesh.triangle.push_back({at(i, j), at(i, j + 1), at(i + 1, j + 1)});
            mesh.triangle.push_back({at(i, j), at(i + 1, j + 1), at(i + 1, j)});
        }
        mesh.triangle.push_back({top, at(rings - 1, j), at(rings - 1, j + 1)});
    }
    return scaled(mesh);
}
// Segment along z of half length h, swept by a ball of radius r.
Mesh capsule(double h, double r, uint32_t n) {
    std::vector<std::array<double, 2>> outline;
    for (uint32_t i = 0; i <= 2 * n; ++i) {
        const double u = -M_PI / 2 + M_PI / 2 * i / n;
        const bool end = i == 0 || i == 2 * n;
        if (i == n) {
            for (uint32_t k = 0; k <= 2 * n; ++k) outline.push_back({r, -h + h * k / n});
        } else {
            outline.push_back({end ? 0 : r * std::cos(u), (i < n ? -h : h) + r * std::sin(u)});
        }
    }
    return lathe(outline, 4 * n);
}
Mesh cylinder(double h, double r, uint32_t n) {
    std::vector<std::array<double, 2>> outline{{0, -h}};
    for (uint32_t i = 1; i < n; ++i) outline.push_back({r * i / n, -h});
    for (uint32_t i = 0; i <= 2 * n; ++i) outline.push_back({r, -h + h * i / n});
    for (uint32_t i = n; i-- > 1;) outline.push_back({r * i / n, h});
    outline.push_back({0, h});
    return lathe(outline, 4 * n);
}
// Block with a groove along y: walls at `angle` from the vertical, apex at the origin.
Mesh groove(double angle, uint32_t n) {
    const double open = std::tan(angle), wide = open + 0.5;
    const std::array<Vec3d, 7> outline{Vec3d(-wide, 0, -0.5), {wide, 0, -0.5}, {wide, 0, 1}, {open, 0, 1}, {0, 0, 0},
                                       {-open, 0, 1},         {-wide, 0, 1}};
    Mesh mesh;
    for (uint32_t row = 0; row <= n; ++row)
        for (const Vec3d& p : outline) mesh.position.push_back(p + Vec3d(0, -1.5 + 3.0 * row / n, 0));
    for (uint32_t row = 0; row < n; ++row) {
        for (uint32_t i = 0; i < 7; ++i) {
            const uint32_t a = 7 * row + i, b = 7 * row + (i + 1) % 7;
            mesh.triangle.push_back({a, b + 7, b});
            mesh.triangle.push_back({a, a + 7, b + 7});
        }
    }
    const uint32_t last = 7 * n;
    for (const Triangle& t : {Triangle{0, 1, 4}, {1, 2, 3}, {1, 3, 4}, {0, 4, 5}, {0, 5, 6}}) {
        mesh.triangle.push_back({t[0], t[1], t[2]});
        mesh.triangle.push_back({last + t[0], last + t[2], last + t[1]});
    }
    return scaled(mesh);
}
Mesh inside_out(Mesh mesh) {
    for (Triangle& t : mesh.triangle) std::swap(t[1], t[2]);
    return mesh;
}
Mesh together(Mesh mesh, const Mesh& other) {
    const uint32_t first = uint32_t(mesh.position.size());
    mesh.position.insert(mesh.position.end(), other.position.begin(), other.position.end());
    for (const Triangle& t : other.triangle) mesh.triangle.push_back({first + t[0], first + t[1], first + t[2]});
    return mesh;
}

double support_distance(const Vec3d& a0, const Vec3d& a1, const Vec3d& b0, const Vec3d& b1) {
    double best = INFINITY;  // the closest points of both segments lie inside; a fine search suffices
    for (int i = 0; i <= 4000; ++i) {
        const Vec3d p = a0 + i / 4000.0 * (a1 - a0), d = b1 - b0;
        const double t = std::clamp((p - b0).dot(d) / d.squaredNorm(), 0.0, 1.0);
        best = std::min(best, (p - b0 - t * d).norm());
    }
    return best;
}

}  // namespace

std::vector<ClosedFormPair> closed_form_pairs(uint32_t level) {
    const uint32_t n = 4u << level;
    const double none = std::nan("");
    std::vector<ClosedFormPair> pairs;
    const auto add = [&](const char* name, Mesh a, Mesh b, const Vec3d& at, const Quat& turned, double depth, double separation) {
        pairs.push_back({name,
                         {{std::move(a), Motion::kStatic, Vec3d::Zero(), {}}, {std::move(b), Motion::kHand, kScale * at, turned}},
                         kScale * depth,
                         kScale * separation});
    };
    // a slab stands for a half-space, wide enough, its top at z = 0
    const auto slab = [&] {
        Mesh mesh = make_box({12, 12, 6}, {4, 4, 2});
        for (Vec3d& p : mesh.position) p.z() -= 3;
        return scaled(mesh);
    };
    const Quat tilt = turn({1, 2, 0.5}, 0.7);
    const Vec3d axis = rotate(tilt, Vec3d::UnitZ());
    const double c = std::abs(axis.z()), s = std::sqrt(1 - c * c);
    const double sunk = 0.137;  // depth of all bodies that stand on the slab

    add("sphere on half-space", slab(), ball(1, n), {0.1, 0.2, 1 - sunk}, tilt, sunk, sunk);
    add("capsule on half-space", slab(), capsule(0.8, 0.4, n), {0.1, 0.2, 0.8 * c + 0.4 - sunk}, tilt, sunk, sunk);
    add("cylinder on half-space", slab(), cylinder(0.8, 0.5, n), {0.1, 0.2, 0.8 * c + 0.5 * s - sunk}, tilt, sunk, sunk);
    const Vec3d half(0.6, 0.9, 1.3), down = rotate_back(tilt, Vec3d::UnitZ());
    add("ellipsoid on half-space", slab(), ellipsoid(half, n), {0.1, 0.2, half.cwiseProduct(down).norm() - sunk}, tilt, sunk, sunk);
    add("torus on half-space", slab(), scaled(make_torus(1, 0.35, 6 * n, 3 * n)), {0.1, 0.2, s + 0.35 - sunk}, tilt, sunk, sunk);
    add("two spheres, shallow", ball(1, n), ball(1, n), {1.8, 0.1, 0.05}, tilt, 2 - Vec3d(1.8, 0.1, 0.05).norm(),
        2 - Vec3d(1.8, 0.1, 0.05).norm());
    const Vec3d past(0.4, 0.25, 0.1);  // each centre far inside the other
    add("two spheres, past the centres", ball(1, n), ball(0.8, n), past, tilt,
        std::max(0.8 - std::abs(past.norm() - 1), 1 - std::abs(past.norm() - 0.8)), 1.8 - past.norm());
    const Vec3d corner(1.0, 0.9, 0.85);
    const double clear = (corner - corner.cwiseMin(0.8)).norm();
    add("sphere at the corner of a box", box({1.6, 1.6, 1.6}, n), ball(0.5, n), corner, tilt, 0.5 - clear, 0.5 - clear);
    const Quat across = turn({1, 0.1, 0}, 1.3);
    const Vec3d lie = rotate(across, Vec3d::UnitZ());
    const double apart = support_distance(Vec3d(0, 0, -1), Vec3d(0, 0, 1), Vec3d(0.55, 0.1, 0.1) - lie, Vec3d(0.55, 0.1, 0.1) + lie);
    add("two capsules, crossed", capsule(1, 0.3, n), capsule(1, 0.4, n), {0.55, 0.1, 0.1}, across, 0.7 - apart, 0.7 - apart);
    add("two boxes, aligned", box({2, 2, 2}, n), box({2, 2, 2}, n), {0.5, 0, 0}, {}, 0.5, 1.5);
    const Quat onto = turn({1, -1, 0}, std::acos(1 / std::sqrt(3.0)));  // a corner points down
    add("box on its corner in a box", box({2, 2, 2}, n), box({1, 1, 1}, n), {0.1, 0.05, 1 + std::sqrt(0.75) - 0.2}, onto, 0.2, none);
    const Vec3d beside(1.4, 0.5, 0.3);
    const double phi = std::hypot(std::hypot(beside.x(), beside.y()) - 1, beside.z()) - 0.3;
    add("sphere outside on a torus", scaled(make_torus(1, 0.3, 6 * n, 3 * n)), ball(0.4, n), beside, tilt, 0.4 - phi, 0.4 - phi);
    add("sphere in the hole of a torus", scaled(make_torus(1, 0.3, 6 * n, 3 * n)), ball(0.71, n), {0, 0, 0}, tilt, 0.01,
        std::sqrt(1.01 * 1.01 - 1));
    const double angle = 30 * M_PI / 180, delta = 0.05;
    add("sphere in a V-groove", groove(angle, n), ball(0.4, n), {0, 0.02, (0.4 - delta) / std::sin(angle)}, tilt, delta,
        delta / std::sin(angle));
    const Mesh ring = scaled(make_torus(1, 0.55, 6 * n, 4 * n));
    add("two linked tori", ring, ring, {1, 0, 0}, turn({1, 0, 0}, M_PI / 2), 0.1, none);
    add("sphere in a hollow sphere", together(ball(1.2, n), inside_out(ball(1, n))), ball(0.5, n), {0.2, 0.1, 0}, tilt, 0, 0);
    return pairs;
}

}  // namespace trocar::bench
