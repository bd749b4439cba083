#pragma once
#include <algorithm>
#include <array>
#include <vector>

#include "engine/geometry/triangle_triangle.hpp"
namespace trocar::reference {

using Wide = __int128;
using Point = std::array<int64_t, 3>;
using Wide3 = std::array<Wide, 3>;

inline Wide dot(const Wide3& a, const Wide3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Wide3 cross(const Wide3& a, const Wide3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline Wide3 minus(const Wide3& a, const Wide3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline bool is_zero(const Wide3& a) { return a[0] == 0 && a[1] == 0 && a[2] == 0; }

// Position of the origin relative to the hull of the points along n: -1 outside, 0 on the supporting plane, 1
// inside; 2 if the plane through `on` with normal n is not a supporting plane.
inline int beside_support(const std::vector<Wide3>& points, const Wide3& n, const Wide3& on) {
    bool above = false, below = false;
    for (const Wide3& p : points) {
        const Wide d = dot(n, minus(p, on));
        above |= d > 0;
        below |= d < 0;
    }
    if (above == below) return 2;
    const Wide origin = -dot(n, on);
    if (origin == 0) return 0;
    return (origin > 0) == above ? 1 : -1;
}

// Oracle that shares nothing with the code under test: two convex sets have a common point exactly if the
// hull of all differences of their corners contains the origin, and a common interior point if its relative
// interior does. Facets by brute force over triples (pairs in the plane) of the at most nine differences.
inline Meeting meet_by_differences(const std::vector<Point>& a, const std::vector<Point>& b) {
    std::vector<Wide3> d;
    for (const Point& p : a) {
        for (const Point& q : b) d.push_back({Wide{p[0] - q[0]}, Wide{p[1] - q[1]}, Wide{p[2] - q[2]}});
    }
    Wide3 along{}, normal{};
    for (const Wide3& p : d) {
        if (is_zero(along)) along = minus(p, d[0]);
    }
    for (const Wide3& p : d) {
        if (is_zero(normal)) normal = cross(along, minus(p, d[0]));
    }
    bool solid = false;
    for (const Wide3& p : d) solid |= dot(normal, minus(p, d[0])) != 0;
    Meeting best = Meeting::kCrossing;
    const auto judge = [&](const Wide3& n, const Wide3& on) {
        const int where = beside_support(d, n, on);
        if (where == -1) best = Meeting::kDisjoint;
        if (where == 0) best = std::min(best, Meeting::kTouching);
    };
    if (is_zero(along)) return is_zero(d[0]) ? Meeting::kCrossing : Meeting::kDisjoint;
    if (is_zero(normal)) {
        if (!is_zero(cross(along, d[0]))) return Meeting::kDisjoint;
        for (const Wide3& p : d) judge(along, p);
        return best;
    }
    if (!solid && dot(normal, d[0]) != 0) return Meeting::kDisjoint;
    for (size_t i = 0; i < d.size(); ++i) {
        for (size_t j = 0; j < i; ++j) {
            const Wide3 edge = minus(d[i], d[j]);
            if (!solid && !is_zero(edge)) judge(cross(normal, edge), d[i]);
            for (size_t k = 0; solid && k < j; ++k) {
                const Wide3 n = cross(edge, minus(d[k], d[j]));
                if (!is_zero(n)) judge(n, d[i]);
            }
        }
    }
    return best;
}

}  // namespace trocar::reference
