#pragma once
#include <span>
#include <vector>

#include "components/contacts.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar::reference {

// A closed surface in world coordinates, double; queries test every triangle.
struct Surface {
    std::vector<Vec3d> position;
    std::vector<Triangle> triangle;

    Surface(const Surfaces& surfaces, uint32_t body);
    // 1 inside, 0 outside: brute_force_winding.
    double winding_number(const Vec3d& p) const;
    double unsigned_distance(const Vec3d& p) const;
    // < 0 inside; the sign follows from the winding number.
    double signed_distance(const Vec3d& p) const;
};

// One vertex of `body` inside `other` or closer to it than the margin.
struct NearVertex {
    uint32_t body, other, vertex;
    double distance;
};

// Every vertex of both bodies of a pair against every triangle of the other; a's first, ascending.
std::vector<NearVertex> near_vertices(const Surfaces& surfaces, uint32_t a, uint32_t b, double margin);

// Pairs of triangles of two bodies whose boxes, enlarged by `reach_a` and `reach_b`, overlap. Ascending.
std::vector<std::array<uint32_t, 2>> meeting_triangles(const Surface& a, const Surface& b, double reach_a, double reach_b);

// Deepest of `samples` + 1 equally spaced points of the segment pq inside a surface: at most |pq| / (2
// samples) less than the true depth of the edge. Negative if no sample is inside.
double deepest_on_edge(const Surface& surface, const Vec3d& p, const Vec3d& q, uint32_t samples);

// True if the segment pq passes through a triangle of the surface, at least `slack` (m) away from its border.
bool surely_crosses(const Surface& surface, const Vec3d& p, const Vec3d& q, double slack);

}  // namespace trocar::reference
