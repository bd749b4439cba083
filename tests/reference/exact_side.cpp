#include "tests/reference/exact_side.hpp"

#include <algorithm>
#include <array>

#include "tests/reference/big_integer.hpp"
namespace trocar {
namespace {

using Quad = __float128;
using reference::BigInteger;
constexpr int kShift = 1100;  // every double times 2^1100 is an integer

BigInteger whole(double a, double b) { return reference::scaled(a, kShift) - reference::scaled(b, kShift); }

Quad size_of(Quad x) { return x < 0 ? -x : x; }

// Sign of (a - p) x (b - p) in the plane of x and y. Differences of doubles have relative errors below
// 2^-112, and so have the products and their difference: 2^-108 of the products exceeds their sum.
int turn(const Vec3d& a, const Vec3d& b, const Vec3d& p) {
    const Quad left = (Quad(a.x()) - p.x()) * (Quad(b.y()) - p.y());
    const Quad right = (Quad(a.y()) - p.y()) * (Quad(b.x()) - p.x());
    const Quad det = left - right;
    if (size_of(det) > (size_of(left) + size_of(right)) * Quad(0x1p-108)) return det > 0 ? 1 : -1;
    return reference::sign_of(whole(a.x(), p.x()) * whole(b.y(), p.y()) - whole(a.y(), p.y()) * whole(b.x(), p.x()));
}

// Sign of the determinant of a - p, b - p, c - p: 1 if p is on the inner side of the face, whose corners are
// counter-clockwise from outside.
int side(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& p) {
    const Vec3d* corner[3] = {&a, &b, &c};
    Quad m[3][3], det = 0, permanent = 0;
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) m[i][k] = Quad((*corner[i])[k]) - p[k];
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const Quad plus = m[j][1] * m[k][2], minus = m[j][2] * m[k][1];
        det += m[i][0] * (plus - minus);
        permanent += size_of(m[i][0]) * (size_of(plus) + size_of(minus));
    }
    if (size_of(det) > permanent * Quad(0x1p-106)) return det > 0 ? 1 : -1;
    BigInteger w[3][3], sum;
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) w[i][k] = whole((*corner[i])[k], p[k]);
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        sum = sum + w[i][0] * (w[j][1] * w[k][2] - w[j][2] * w[k][1]);
    }
    return reference::sign_of(sum);
}

// Winding of a face's outline around p, seen along z: edges that cross the line y = p.y (half-open) to the
// right of p.
int around(const std::array<const Vec3d*, 3>& corner, const Vec3d& p) {
    int count = 0;
    for (int k = 0; k < 3; ++k) {
        const Vec3d &a = *corner[k], &b = *corner[(k + 1) % 3];
        const bool up = a.y() <= p.y() && b.y() > p.y(), down = b.y() <= p.y() && a.y() > p.y();
        if (up && turn(a, b, p) > 0) ++count;
        if (down && turn(a, b, p) < 0) --count;
    }
    return count;
}

}  // namespace

bool exact_windings(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p, int& windings) {
    windings = 0;
    for (const Triangle& t : triangle) {
        const std::array<const Vec3d*, 3> corner{&position[t[0]], &position[t[1]], &position[t[2]]};
        bool beside = false;
        for (int k = 0; k < 2; ++k) {
            const auto [low, high] = std::minmax({(*corner[0])[k], (*corner[1])[k], (*corner[2])[k]});
            beside = beside || p[k] < low || p[k] > high;
        }
        if (beside || std::max({corner[0]->z(), corner[1]->z(), corner[2]->z()}) < p.z()) continue;
        const int count = around(corner, p);
        if (count == 0) continue;
        const int s = side(*corner[0], *corner[1], *corner[2], p);
        if (s == 0) return false;
        // counter-clockwise from above (count > 0), the face points up and p below it is on its inner side
        if (s * count > 0) windings += count;
    }
    return true;
}

}  // namespace trocar
