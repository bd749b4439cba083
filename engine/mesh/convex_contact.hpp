#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "engine/mesh/convex_hull.hpp"
namespace trocar {

// A point of one hull near a plane of the other; in the frame of hull a.
struct HullContact {
    bool of_b = false;               // whose point it is
    std::array<uint32_t, 2> ends{};  // of its hull: the edge with the point, or one corner twice
    double along = 0;                // point = (1 - along) * ends[0] + along * ends[1]
    Vec3d point = Vec3d::Zero();     // m
    Vec3d normal = Vec3d::Zero();    // unit, of the plane, outward from the hull that does not own the point
    double distance = 0;             // m, of the point from the plane, negative inside
    uint32_t face = 0;               // of the hull that does not own the point: the one in that plane, or at its edge
};

struct HullManifold {
    uint32_t count = 0;  // of contact; none if the hulls are farther apart than asked
    std::array<HullContact, 4> contact;
    // m, along `direction`: of hulls that overlap the largest of all directions, up to the preference for faces; of others at most that
    double separation = 0;
    Vec3d direction = Vec3d::Zero();  // unit, from a to b
};

// Reused memory.
struct HullContactScratch {
    struct Side {
        std::vector<Vec3d> point, normal;
        std::vector<double> offset, x, y, z, height;
        std::vector<uint32_t> edge;
    };
    struct Corner {
        Vec3d point = Vec3d::Zero();
        std::array<uint32_t, 2> ends{};
        double along = 0;
        bool of_reference = false;
        uint32_t leaves = 0;  // edge of the polygon that starts here: of the incident face, or that many plus a side of the other face
    };
    Side a, b;
    std::vector<Corner> polygon, clipped;
    std::vector<HullContact> found;
};

// Up to four contacts of two convex hulls that are nearer than `margin` (m): the direction of largest separation among the normals of
// faces and of pairs of edges (Gregorius, "The separating axis test between convex polyhedra", GDC 2013), then the face clipped by the
// sides of the one opposite to it, of which the deepest, the farthest from it and the two that span most area stay. A face is
// preferred to a pair of edges, and a's to b's, that separates by up to `preferred` (m) more, so that resting bodies keep their
// contacts. Directions whose separation cannot exceed the best found are left out by a bound: on an arc between two normals
// the height of any point of the other hull bounds the separation. The pose of b in the frame of a: turn, shift (m).
void find_hull_contacts(const ConvexHull& a, const ConvexHull& b, const Quat& turn, const Vec3d& shift, double margin, double preferred,
                        HullContactScratch& scratch, HullManifold& manifold);

}  // namespace trocar
