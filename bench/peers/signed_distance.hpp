#pragma once
#include <array>
#include <cmath>

#include "bench/peers/soup.hpp"
namespace trocar::bench {

// Textbook signed distance in one precision: closest point by Voronoi regions (Ericson, Real-Time Collision
// Detection, 5.1.5) without sliver guard, sign by pseudonormal (Baerentzen & Aanaes 2005).
template <typename Real>
struct Vec {
    Real x, y, z;
    friend Vec operator-(const Vec& a, const Vec& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend Vec operator+(const Vec& a, const Vec& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend Vec operator*(Real s, const Vec& a) { return {s * a.x, s * a.y, s * a.z}; }
};
template <typename Real>
Real dot(const Vec<Real>& a, const Vec<Real>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <typename Real>
Vec<Real> cross(const Vec<Real>& a, const Vec<Real>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <typename Real>
Real norm(const Vec<Real>& a) {
    return std::sqrt(dot(a, a));
}
template <typename Real>
Vec<Real> vertex(const Soup& soup, uint32_t row) {
    const Float4& p = soup.position[row];
    return {Real(p.x), Real(p.y), Real(p.z)};
}

template <typename Real>
struct Closest {
    Vec<Real> point;
    uint32_t triangle = 0;
    int corner = -1;  // vertex k: k; edge k -> k+1: 3 + k; face: 6
    Real squared = 0;
};

// The triangles incident to each vertex of the soup.
struct Incidence {
    std::vector<uint32_t> first, triangle;
    explicit Incidence(const Soup& soup) : first(soup.position.size() + 1, 0), triangle(3 * soup.triangle.size()) {
        for (const Triangle& t : soup.triangle)
            for (const uint32_t v : t) ++first[v + 1];
        for (size_t v = 1; v < first.size(); ++v) first[v] += first[v - 1];
        std::vector<uint32_t> next(first.begin(), first.end() - 1);
        for (uint32_t t = 0; t < soup.triangle.size(); ++t)
            for (const uint32_t v : soup.triangle[t]) triangle[next[v]++] = t;
    }
};

template <typename Real>
Closest<Real> closest_on_triangle(const Soup& soup, uint32_t t, const Vec<Real>& p) {
    const Vec<Real> a = vertex<Real>(soup, soup.triangle[t][0]), b = vertex<Real>(soup, soup.triangle[t][1]),
                    c = vertex<Real>(soup, soup.triangle[t][2]);
    const auto at = [&](const Vec<Real>& q, int corner) { return Closest<Real>{q, t, corner, dot(p - q, p - q)}; };
    const Vec<Real> ab = b - a, ac = c - a, ap = p - a;
    const Real d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return at(a, 0);
    const Vec<Real> bp = p - b;
    const Real d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return at(b, 1);
    const Real vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return at(a + d1 / (d1 - d3) * ab, 3);
    const Vec<Real> cp = p - c;
    const Real d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return at(c, 2);
    const Real vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return at(a + d2 / (d2 - d6) * ac, 5);
    const Real va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return at(b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b), 4);
    const Real sum = 1 / (va + vb + vc);
    return at(a + vb * sum * ab + vc * sum * ac, 6);
}

template <typename Real>
Vec<Real> face_normal(const Soup& soup, uint32_t t) {
    const Triangle& c = soup.triangle[t];
    const Vec<Real> a = vertex<Real>(soup, c[0]);
    const Vec<Real> n = cross(vertex<Real>(soup, c[1]) - a, vertex<Real>(soup, c[2]) - a);
    const Real length = norm(n);
    return length > 0 ? 1 / length * n : Vec<Real>{0, 0, 0};
}

template <typename Real>
Vec<Real> pseudonormal(const Soup& soup, const Incidence& incidence, const Closest<Real>& at) {
    if (at.corner == 6) return face_normal<Real>(soup, at.triangle);
    const Triangle& corner = soup.triangle[at.triangle];
    Vec<Real> sum{0, 0, 0};
    const uint32_t v = corner[at.corner % 3], w = corner[(at.corner + 1) % 3];
    for (uint32_t i = incidence.first[v]; i < incidence.first[v + 1]; ++i) {
        const uint32_t t = incidence.triangle[i];
        const Triangle& c = soup.triangle[t];
        if (at.corner >= 3) {  // the two faces of the edge
            if (c[0] == w || c[1] == w || c[2] == w) sum = sum + face_normal<Real>(soup, t);
            continue;
        }
        const int k = c[0] == v ? 0 : c[1] == v ? 1 : 2;
        const Vec<Real> p = vertex<Real>(soup, v), e = vertex<Real>(soup, c[(k + 1) % 3]) - p, f = vertex<Real>(soup, c[(k + 2) % 3]) - p;
        sum = sum + Real(std::atan2(norm(cross(e, f)), dot(e, f))) * face_normal<Real>(soup, t);
    }
    return sum;
}

}  // namespace trocar::bench
