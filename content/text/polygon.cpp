#include "content/text/polygon.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
namespace trocar {
namespace {

using Point = std::array<double, 2>;

// Twice the signed area of a triangle, > 0 when it turns left.
double turn(const Point& a, const Point& b, const Point& c) { return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]); }

// Projects the corners by dropping the normal's largest coordinate, so that nothing is rounded, and orients
// them to turn left. Returns twice the area, or 0 if there is none.
double flatten_corners(std::span<const Vec3d> corner, std::vector<Point>& point) {
    // relative to a corner and scaled to about one, so that distant or huge polygons do not lose their area
    double size = 0;
    for (const Vec3d& c : corner) size = std::max(size, (c - corner[0]).cwiseAbs().maxCoeff());
    if (!(size > 0) || !std::isfinite(size)) return 0;
    const double scale = std::ldexp(1.0, -std::ilogb(size));
    Vec3d normal = Vec3d::Zero();
    Vec3d before = (corner.back() - corner[0]) * scale;
    for (const Vec3d& c : corner) {
        const Vec3d here = (c - corner[0]) * scale;
        normal += before.cross(here);
        before = here;
    }
    int axis = 0;
    if (std::abs(normal[1]) > std::abs(normal[axis])) axis = 1;
    if (std::abs(normal[2]) > std::abs(normal[axis])) axis = 2;
    if (!std::isfinite(normal[axis])) return 0;
    int u = (axis + 1) % 3, v = (axis + 2) % 3;
    if (normal[axis] < 0) std::swap(u, v);
    point.clear();
    for (const Vec3d& c : corner) point.push_back({(c[u] - corner[0][u]) * scale, (c[v] - corner[0][v]) * scale});
    return std::abs(normal[axis]);
}

// Strictly convex and going round once: left turns only, and the x direction changes twice.
bool is_convex(const std::vector<Point>& point) {
    const size_t n = point.size();
    int changes = 0;
    double last_dx = 0, first_dx = 0;
    for (size_t i = 0; i < n; ++i) {
        const Point &a = point[i], &b = point[(i + 1) % n], &c = point[(i + 2) % n];
        if (!(turn(a, b, c) > 0)) return false;
        const double dx = b[0] - a[0];
        if (dx == 0) continue;
        if (last_dx == 0) first_dx = dx;
        changes += last_dx * dx < 0;
        last_dx = dx;
    }
    changes += last_dx * first_dx < 0;
    return changes <= 2;
}

// Whether no other corner lies in or on the triangle before-at-after. Ignores corners at the position of one
// of its own corners: polygons with holes visit the ends of their bridge twice.
bool is_free(const PolygonScratch& s, uint32_t before, uint32_t at, uint32_t after, uint64_t& tests) {
    const Point &a = s.point[before], &b = s.point[at], &c = s.point[after];
    const auto [x_min, x_max] = std::minmax({a[0], b[0], c[0]});
    const auto [y_min, y_max] = std::minmax({a[1], b[1], c[1]});
    tests += s.reflex.size();
    for (const uint32_t k : s.reflex) {
        const Point& p = s.point[k];
        if (p[0] < x_min || p[0] > x_max || p[1] < y_min || p[1] > y_max || !s.is_reflex[k]) continue;
        if (k == before || k == at || k == after || p == a || p == b || p == c) continue;
        if (turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return false;
    }
    return true;
}

void clip(PolygonScratch& s, uint32_t at) {
    const uint32_t before = s.previous[at], after = s.next[at];
    s.next[before] = after;
    s.previous[after] = before;
    s.is_reflex[at] = false;
    for (const uint32_t k : {before, after}) {
        s.is_reflex[k] = s.is_reflex[k] && !(turn(s.point[s.previous[k]], s.point[k], s.point[s.next[k]]) > 0);
    }
}

bool clip_ears(PolygonScratch& s, double area, std::vector<Triangle>& triangle) {
    const auto n = static_cast<uint32_t>(s.point.size());
    s.next.resize(n);
    s.previous.resize(n);
    s.is_reflex.resize(n);
    s.reflex.clear();
    for (uint32_t i = 0; i < n; ++i) {
        s.next[i] = i + 1 == n ? 0 : i + 1;
        s.previous[i] = i == 0 ? n - 1 : i - 1;
    }
    for (uint32_t i = 0; i < n; ++i) {
        s.is_reflex[i] = !(turn(s.point[s.previous[i]], s.point[i], s.point[s.next[i]]) > 0);
        if (s.is_reflex[i]) s.reflex.push_back(i);
    }
    const double flat = 1e-12 * area;  // rounding error of a corner on a straight edge
    uint32_t at = 0, left = n, since_clip = 0, alive_reflex = static_cast<uint32_t>(s.reflex.size());
    bool accept_flat = false;
    while (left > 2) {
        const uint32_t before = s.previous[at], after = s.next[at];
        const double doubled = turn(s.point[before], s.point[at], s.point[after]);
        // corners on straight edges wait until no proper ear is left, so that they get a triangle with area
        const bool ear = doubled > flat ? is_free(s, before, at, after, s.tests) : accept_flat && std::abs(doubled) <= flat;
        if (ear) {
            triangle.push_back({before, at, after});
            clip(s, at);
            --left;
            since_clip = 0;
            accept_flat = false;
            if (alive_reflex > 64 && left % 64 == 0) {
                std::erase_if(s.reflex, [&](uint32_t k) { return !s.is_reflex[k]; });
                alive_reflex = static_cast<uint32_t>(s.reflex.size());
            }
            at = s.next[after];  // skipping one corner prevents a fan of slivers
        } else {
            at = after;
            if (++since_clip >= left) {
                if (accept_flat) return false;
                accept_flat = true;
                since_clip = 0;
            }
        }
        if (s.tests > kPolygonTestLimit) return false;
    }
    return true;
}

}  // namespace

bool triangulate_polygon(std::span<const Vec3d> corner, PolygonScratch& scratch, std::vector<Triangle>& triangle) {
    const auto n = static_cast<uint32_t>(corner.size());
    const auto fan = [&] {
        for (uint32_t i = 1; i + 1 < n; ++i) triangle.push_back({0, i, i + 1});
    };
    if (n <= 3) {
        fan();
        return true;
    }
    const double area = flatten_corners(corner, scratch.point);
    if (area > 0 && is_convex(scratch.point)) {
        fan();
        return true;
    }
    const size_t first = triangle.size();
    if (area > 0 && scratch.tests <= kPolygonTestLimit && clip_ears(scratch, area, triangle)) {
        // the ears of a simple polygon cover exactly its area
        double covered = 0;
        for (size_t i = first; i < triangle.size(); ++i) {
            const Triangle& t = triangle[i];
            covered += std::abs(turn(scratch.point[t[0]], scratch.point[t[1]], scratch.point[t[2]]));
        }
        if (std::abs(covered - area) <= 1e-9 * area) return true;
    }
    triangle.resize(first);
    fan();
    return false;
}

}  // namespace trocar
