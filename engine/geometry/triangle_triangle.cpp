#include "engine/geometry/triangle_triangle.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/geometry/predicates.hpp"
namespace trocar {
namespace {

// A triangle reduced to its dimension: three corners, the two ends of a segment, or one point.
struct Simplex {
    std::array<Vec3d, 3> corner;
    int count = 0;
};

bool comes_before(const Vec3d& a, const Vec3d& b) {
    if (a.x() != b.x()) return a.x() < b.x();
    if (a.y() != b.y()) return a.y() < b.y();
    return a.z() < b.z();
}

// Along a line the lexicographic order is the order of the points.
Simplex make_segment(const Corners& t) {
    const auto [low, high] = std::minmax_element(t.begin(), t.end(), comes_before);
    if (*low == *high) return {{*low}, 1};
    return {{*low, *high}, 2};
}

Simplex reduce(const Corners& t) { return are_collinear(t[0], t[1], t[2]) ? make_segment(t) : Simplex{t, 3}; }

int turn(const Vec3d& a, const Vec3d& b, const Vec3d& c, int u, int v) { return orient2d(a[u], a[v], b[u], b[v], c[u], c[v]); }

// Coordinate plane (its two axes) in which the projected points are not collinear; the result is exact for
// any such plane. False if a, b, c are collinear.
bool choose_projection(const Vec3d& a, const Vec3d& b, const Vec3d& c, int& u, int& v) {
    const Vec3d normal = (b - a).cross(c - a).cwiseAbs();
    std::array<int, 3> axis{0, 1, 2};
    std::sort(axis.begin(), axis.end(), [&](int i, int k) { return normal[i] > normal[k]; });
    for (const int dropped : axis) {
        u = (dropped + 1) % 3;
        v = (dropped + 2) % 3;
        if (turn(a, b, c, u, v) != 0) return true;
    }
    return false;
}

// Whether an edge line of `a` separates it from b in the plane: kDisjoint strictly, kTouching with contact on the line.
Meeting separate_along_edges(const Simplex& a, const Simplex& b, int u, int v) {
    Meeting best = Meeting::kCrossing;
    const int inner = a.count == 3 ? turn(a.corner[0], a.corner[1], a.corner[2], u, v) : 0;
    const int edges = a.count == 3 ? 3 : a.count - 1;
    for (int k = 0; k < edges; ++k) {
        int low = 1, high = -1;
        for (int i = 0; i < b.count; ++i) {
            const int side = turn(a.corner[k], a.corner[(k + 1) % a.count], b.corner[i], u, v);
            low = std::min(low, side);
            high = std::max(high, side);
        }
        // a triangle is on its inner side; a segment is on its own line, so both sides count
        const bool strictly = (inner >= 0 && high < 0) || (inner <= 0 && low > 0);
        const bool weakly = (inner >= 0 && high <= 0) || (inner <= 0 && low >= 0);
        if (strictly) return Meeting::kDisjoint;
        if (weakly) best = Meeting::kTouching;
    }
    return best;
}

// Two simplices that together span one plane. Their Minkowski difference is a polygon with edges parallel to
// theirs; the result is whether the origin is outside, on or inside it.
Meeting meet_in_plane(const Simplex& a, const Simplex& b, int u, int v) {
    const Meeting first = separate_along_edges(a, b, u, v);
    if (first == Meeting::kDisjoint) return first;
    return std::min(first, separate_along_edges(b, a, u, v));
}

Meeting meet_on_line(const Simplex& a, const Simplex& b) {
    const Vec3d &a_low = a.corner[0], &a_high = a.corner[a.count - 1];
    const Vec3d &b_low = b.corner[0], &b_high = b.corner[b.count - 1];
    if (comes_before(a_high, b_low) || comes_before(b_high, a_low)) return Meeting::kDisjoint;
    const bool same_point = a.count == 1 && b.count == 1;
    return same_point || (comes_before(a_low, b_high) && comes_before(b_low, a_high)) ? Meeting::kCrossing : Meeting::kTouching;
}

// Two segments or points.
Meeting meet_thin(const Simplex& a, const Simplex& b) {
    const Vec3d &p = a.corner[0], &q = a.corner[a.count - 1];
    const Vec3d &r = b.corner[0], &s = b.corner[b.count - 1];
    if (a.count == 2 && b.count == 2 && orient3d(p, q, r, s) != 0) return Meeting::kDisjoint;
    int u = 0, v = 0;
    const bool spans = choose_projection(p, q, r, u, v) || choose_projection(p, q, s, u, v) || choose_projection(r, s, p, u, v);
    if (!spans) return meet_on_line(a, b);
    if (a.count == 1 || b.count == 1) return Meeting::kDisjoint;
    return meet_in_plane(a, b, u, v);
}

Meeting meet_in_plane_of(const Corners& triangle, const Simplex& other) {
    int u = 0, v = 0;
    choose_projection(triangle[0], triangle[1], triangle[2], u, v);
    return meet_in_plane(Simplex{triangle, 3}, other, u, v);
}

// A segment whose ends are strictly on opposite sides of a triangle's plane.
Meeting meet_piercing(const Vec3d& p, const Vec3d& q, const Corners& t) {
    int low = 1, high = -1;
    for (int k = 0; k < 3; ++k) {
        const int side = orient3d(p, q, t[k], t[(k + 1) % 3]);
        low = std::min(low, side);
        high = std::max(high, side);
    }
    if (low < 0 && high > 0) return Meeting::kDisjoint;
    return low > 0 || high < 0 ? Meeting::kCrossing : Meeting::kTouching;
}

// A segment or point and a triangle of positive area.
Meeting meet_thin_triangle(const Simplex& thin, const Corners& t) {
    const Vec3d &p = thin.corner[0], &q = thin.corner[thin.count - 1];
    const int side_p = orient3d(t[0], t[1], t[2], p);
    const int side_q = thin.count == 2 ? orient3d(t[0], t[1], t[2], q) : side_p;
    if (side_p * side_q > 0) return Meeting::kDisjoint;
    if (side_p == 0 && side_q == 0) return meet_in_plane_of(t, thin);
    if (side_p * side_q < 0) return meet_piercing(p, q, t);
    // an end on the plane is not inside the segment
    const Meeting end = meet_in_plane_of(t, Simplex{{side_p == 0 ? p : q}, 1});
    return end == Meeting::kDisjoint ? end : Meeting::kTouching;
}

using Sides = std::array<int, 3>;

bool all_on_one_side(const Sides& s) { return (s[0] > 0 && s[1] > 0 && s[2] > 0) || (s[0] < 0 && s[1] < 0 && s[2] < 0); }
bool on_both_sides(const Sides& s) { return std::min({s[0], s[1], s[2]}) < 0 && std::max({s[0], s[1], s[2]}) > 0; }

// Some corners of a are in b's plane and the rest is on one side of it: only those corners can meet b.
Meeting meet_resting(const Corners& a, const Sides& sides, const Corners& b) {
    Simplex resting;
    for (int k = 0; k < 3; ++k) {
        if (sides[k] == 0) resting.corner[resting.count++] = a[k];
    }
    return meet_in_plane_of(b, resting) == Meeting::kDisjoint ? Meeting::kDisjoint : Meeting::kTouching;
}

// Rotates t so that its first corner is alone on its side of the other plane.
int put_lone_corner_first(Corners& t, const Sides& s) {
    int lone = 0;
    for (int k = 0; k < 3; ++k) {
        const int next = s[(k + 1) % 3], last = s[(k + 2) % 3];
        if (s[k] != 0 && s[k] != next && s[k] != last && next * last >= 0) lone = k;
    }
    // one corner on the plane, one on each side: both are alone, the later in order is taken
    std::rotate(t.begin(), t.begin() + lone, t.end());
    return s[lone];
}

// Both triangles cross the other's plane, so each meets the common line in an interval of positive length.
Meeting meet_on_common_line(Corners a, const Sides& a_sides, Corners b, const Sides& b_sides) {
    const int a_first = put_lone_corner_first(a, a_sides);
    const int b_first = put_lone_corner_first(b, b_sides);
    // reverse each triangle if needed, so that the other's first corner is on its positive side
    if (b_first < 0) std::swap(a[1], a[2]);
    if (a_first < 0) std::swap(b[1], b[2]);
    const int first = orient3d(a[0], a[1], b[0], b[1]);
    const int second = orient3d(a[0], a[2], b[2], b[0]);
    if (first > 0 || second > 0) return Meeting::kDisjoint;
    return first < 0 && second < 0 ? Meeting::kCrossing : Meeting::kTouching;
}

Meeting meet_with_thin(const Corners& a, const Corners& b) {
    const Simplex left = reduce(a), right = reduce(b);
    if (left.count < 3 && right.count < 3) return meet_thin(left, right);
    if (left.count < 3) return meet_thin_triangle(left, b);
    if (right.count < 3) return meet_thin_triangle(right, a);
    return meet_in_plane_of(a, right);
}

}  // namespace

Meeting meet_triangles(const Corners& a, const Corners& b) {
    Sides b_sides, a_sides;
    for (int k = 0; k < 3; ++k) b_sides[k] = orient3d(a[0], a[1], a[2], b[k]);
    if (all_on_one_side(b_sides)) return Meeting::kDisjoint;
    for (int k = 0; k < 3; ++k) a_sides[k] = orient3d(b[0], b[1], b[2], a[k]);
    if (all_on_one_side(a_sides)) return Meeting::kDisjoint;
    // coplanar, or one of them has zero area: it spans no plane and is in the other's
    if (b_sides == Sides{0, 0, 0} || a_sides == Sides{0, 0, 0}) return meet_with_thin(a, b);
    if (!on_both_sides(a_sides)) return meet_resting(a, a_sides, b);
    if (!on_both_sides(b_sides)) return meet_resting(b, b_sides, a);
    return meet_on_common_line(a, a_sides, b, b_sides);
}

Meeting meet_segment_triangle(const Vec3d& p, const Vec3d& q, const Corners& triangle) {
    const Simplex segment = make_segment({p, p, q});
    const Simplex other = reduce(triangle);
    return other.count == 3 ? meet_thin_triangle(segment, triangle) : meet_thin(segment, other);
}

}  // namespace trocar
