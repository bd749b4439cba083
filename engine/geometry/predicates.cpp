#include "engine/geometry/predicates.hpp"

#include <algorithm>
#include <initializer_list>
namespace trocar {
namespace {

// An exact number as a sum of non-overlapping doubles, smallest first, without zeros: the last one gives the
// sign.
template <int kCapacity>
struct Expansion {
    double term[kCapacity];
    int count = 0;
    void push(double t) {
        if (t != 0) term[count++] = t;
    }
    int sign() const { return count == 0 ? 0 : (term[count - 1] > 0 ? 1 : -1); }
};

struct Pair {
    double high, low;  // exact value = high + low
};

Pair two_sum(double a, double b) {
    const double sum = a + b;
    const double b_part = sum - a;
    return {sum, (a - (sum - b_part)) + (b - b_part)};
}

Pair two_product(double a, double b) {
    const double product = a * b;
    return {product, std::fma(a, b, -product)};
}

Expansion<2> difference(double a, double b) {
    const Pair d = two_sum(a, -b);
    Expansion<2> out;
    out.push(d.low);
    out.push(d.high);
    return out;
}

// e += b. Shewchuk 1997, figure 6 (grow expansion).
template <int kCapacity>
void add(Expansion<kCapacity>& e, double b) {
    int count = 0;
    for (int i = 0; i < e.count; ++i) {
        const Pair s = two_sum(b, e.term[i]);
        if (s.low != 0) e.term[count++] = s.low;
        b = s.high;
    }
    e.count = count;
    e.push(b);
}

// e += f * b. The product is an expansion by figure 13 (scale expansion) and is added term by term.
template <int kCapacity, int kFactor>
void add_scaled(Expansion<kCapacity>& e, const Expansion<kFactor>& f, double b) {
    double carry = 0;
    for (int i = 0; i < f.count; ++i) {
        const Pair product = two_product(f.term[i], b);
        const Pair low = two_sum(carry, product.low);
        const Pair high = two_sum(product.high, low.high);
        add(e, low.low);
        add(e, high.low);
        carry = high.high;
    }
    add(e, carry);
}

// a * d - b * c, where a, b and c, d may be two directions
Expansion<16> minor(const Expansion<2>& a, const Expansion<2>& b, const Expansion<2>& c, const Expansion<2>& d) {
    Expansion<16> out;
    for (int i = 0; i < d.count; ++i) add_scaled(out, a, d.term[i]);
    for (int i = 0; i < c.count; ++i) add_scaled(out, b, -c.term[i]);
    return out;
}

// Power of two that scales the largest of the numbers to about 2^300: then triple products of bits 600 orders
// smaller neither overflow nor are flushed to zero.
double scale_for(std::initializer_list<double> numbers) {
    double largest = 0;
    for (const double x : numbers) largest = std::max(largest, std::abs(x));
    int exponent = 0;
    std::frexp(largest, &exponent);
    return std::ldexp(1.0, std::clamp(300 - exponent, -1000, 1000));
}

}  // namespace

int orient2d_exact(double ax, double ay, double bx, double by, double cx, double cy) {
    // points of one axis-parallel line, or repeated points, are common in synthetic meshes
    if ((ax == bx && ax == cx) || (ay == by && ay == cy) || (ax == cx && ay == cy) || (bx == cx && by == cy)) return 0;
    const double s = scale_for({ax, ay, bx, by, cx, cy});
    return minor(difference(s * ax, s * cx), difference(s * ay, s * cy), difference(s * bx, s * cx), difference(s * by, s * cy)).sign();
}

int orient3d_exact(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    const double s = scale_for({a.x(), a.y(), a.z(), b.x(), b.y(), b.z(), c.x(), c.y(), c.z(), d.x(), d.y(), d.z()});
    Expansion<2> row[3][3];
    const Vec3d* corner[3] = {&b, &c, &d};
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) row[i][k] = difference(s * (*corner[i])[k], s * a[k]);
    }
    Expansion<192> det;
    for (int k = 0; k < 3; ++k) {
        const int l = (k + 1) % 3, m = (k + 2) % 3;
        const Expansion<16> cofactor = minor(row[0][l], row[0][m], row[1][l], row[1][m]);
        for (int i = 0; i < row[2][k].count; ++i) add_scaled(det, cofactor, row[2][k].term[i]);
    }
    return det.sign();
}

int turn_exact(double ux, double uy, double vx, double vy, double sx, double sy, double tx, double ty) {
    const double k = scale_for({ux, uy, vx, vy, sx, sy, tx, ty});
    return minor(difference(k * vx, k * ux), difference(k * vy, k * uy), difference(k * tx, k * sx), difference(k * ty, k * sy)).sign();
}

int orient3d_moving_point(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    const int side = orient3d(a, b, c, d);
    if (side != 0) return side;
    // the determinant increases by the normal (b - a) x (c - a) times the displacement
    const int x = orient2d(a.y(), a.z(), b.y(), b.z(), c.y(), c.z());
    if (x != 0) return x;
    const int y = orient2d(a.z(), a.x(), b.z(), b.x(), c.z(), c.x());
    return y != 0 ? y : orient2d(a.x(), a.y(), b.x(), b.y(), c.x(), c.y());
}

int orient3d_moving_edge(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    const int side = orient3d(a, b, c, d);
    if (side != 0) return side;
    // the determinant increases by (b - a) x (c - d) times the displacement
    const int x = turn_exact(a.y(), a.z(), b.y(), b.z(), d.y(), d.z(), c.y(), c.z());
    if (x != 0) return x;
    const int y = turn_exact(a.z(), a.x(), b.z(), b.x(), d.z(), d.x(), c.z(), c.x());
    return y != 0 ? y : turn_exact(a.x(), a.y(), b.x(), b.y(), d.x(), d.y(), c.x(), c.y());
}

}  // namespace trocar
