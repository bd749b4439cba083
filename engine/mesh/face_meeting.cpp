#include "engine/mesh/face_meeting.hpp"

#include <Eigen/Geometry>

#include "engine/geometry/predicates.hpp"
namespace trocar {
namespace {

// Quick proof that two faces meet only at their shared corner: a plane through it with both free corners of
// each face clearly on its own side. The margin is far above the rounding of the products (a few 1e-16).
bool separated_at_corner(const Vec3d& a1, const Vec3d& a2, const Vec3d& b1, const Vec3d& b2) {
    const double la1 = a1.norm(), la2 = a2.norm(), lb1 = b1.norm(), lb2 = b2.norm();
    const Vec3d apart = a1 / la1 + a2 / la2 - b1 / lb1 - b2 / lb2;
    const double margin = 1e-12 * apart.norm();
    return apart.dot(a1) > margin * la1 && apart.dot(a2) > margin * la2 && apart.dot(b1) < -margin * lb1 && apart.dot(b2) < -margin * lb2;
}

// Ignores the shared corner itself. If two convex sets with a common point have a second one, they also have
// one on the ray from the corner through it, where the ray leaves one of them. So it suffices to test whether
// an opposite edge reaches the other face.
Meeting meet_at_shared_corner(const Corners& a, int a_shared, const Corners& b, int b_shared) {
    const Vec3d &corner = a[a_shared], &a1 = a[(a_shared + 1) % 3], &a2 = a[(a_shared + 2) % 3];
    const Vec3d &b1 = b[(b_shared + 1) % 3], &b2 = b[(b_shared + 2) % 3];
    if (separated_at_corner(a1 - corner, a2 - corner, b1 - corner, b2 - corner)) return Meeting::kDisjoint;
    if (orient3d(a[0], a[1], a[2], b1) * orient3d(a[0], a[1], a[2], b2) > 0) return Meeting::kDisjoint;
    if (orient3d(b[0], b[1], b[2], a1) * orient3d(b[0], b[1], b[2], a2) > 0) return Meeting::kDisjoint;
    if (meet_segment_triangle(a1, a2, b) == Meeting::kDisjoint && meet_segment_triangle(b1, b2, a) == Meeting::kDisjoint) {
        return Meeting::kDisjoint;
    }
    return meet_triangles(a, b);
}

// Faces with a shared edge overlap only if they are folded onto each other in a common plane. Faces at more
// than a right angle (beyond rounding) are not folded.
Meeting meet_at_shared_edge(const Corners& a, int a_free, const Corners& b, int b_free) {
    const Vec3d& free_end = a[(a_free + 1) % 3];
    const Vec3d edge = a[(a_free + 2) % 3] - free_end, to_a = a[a_free] - free_end, to_b = b[b_free] - free_end;
    const double size = edge.squaredNorm() * to_a.norm() * to_b.norm();
    if (edge.cross(to_a).dot(edge.cross(to_b)) < -1e-12 * size) return Meeting::kDisjoint;
    if (orient3d(a[0], a[1], a[2], b[b_free]) != 0) return Meeting::kDisjoint;
    return meet_triangles(a, b) == Meeting::kCrossing ? Meeting::kCrossing : Meeting::kDisjoint;
}

}  // namespace

Meeting meet_faces(const Triangle& t, const Corners& a, const Triangle& u, const Corners& b) {
    int shared = 0, t_shared = 0, u_shared = 0, t_sum = 0, u_sum = 0;
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) {
            if (t[i] != u[k]) continue;
            ++shared;
            t_shared = i;
            u_shared = k;
            t_sum += i;
            u_sum += k;
        }
    }
    if (shared == 0) return meet_triangles(a, b);
    if (shared == 1) return meet_at_shared_corner(a, t_shared, b, u_shared);
    if (shared == 2) return meet_at_shared_edge(a, 3 - t_sum, b, 3 - u_sum);
    return Meeting::kCrossing;
}

}  // namespace trocar
