#pragma once
#include <limits>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// Read-only view of the present surfaces of the bodies; input of most contact systems.
struct Surfaces {
    const Meshes& meshes;
    const Bodies& bodies;
    const Poses& poses;
    const Particles& particles;
};

// Whether forces move the body, so that its contacts join islands.
inline bool joins_islands(Motion m) { return m == Motion::kDeformable || m == Motion::kHand || m == Motion::kFree; }
inline bool is_deformable(const Bodies& bodies, uint32_t body) { return bodies.motion[body] == Motion::kDeformable; }
inline bool has_inside(const Surfaces& s, uint32_t body) { return has_inside(s.meshes.info[s.bodies.mesh[body]].admission); }

// Depth beyond which the side of a point inside a body is checked twice (ClosestPointTree::decide_side),
// because a deformable solid may have folded over itself. Of edge points of crushed livers deeper than a
// tenth of an edge by pseudonormal, the winding number put half outside; of shallower ones one in fifty. m
inline double doubtful_depth(const Surfaces& s, uint32_t body) {
    const MeshInfo& info = s.meshes.info[s.bodies.mesh[body]];
    if (!is_deformable(s.bodies, body) || info.admission != Admission::kSolid) return std::numeric_limits<double>::infinity();
    return 0.1 * info.mean_edge;
}

// Position of a vertex relative to the body's frame: offset from the origin if deformable, rest position if rigid. m
inline Vec3d vertex_in_frame(const Surfaces& s, uint32_t body, uint32_t vertex) {
    if (is_deformable(s.bodies, body)) {
        const Float4& o = s.particles.offset[s.bodies.particles[body].first + vertex];
        return {o.x, o.y, o.z};
    }
    return s.meshes.position[s.meshes.info[s.bodies.mesh[body]].vertices.first + vertex];
}
// World position of a point of the body's frame, and the inverse. m
inline Vec3d frame_to_world(const Surfaces& s, uint32_t body, const Vec3d& p) {
    return s.poses.origin[body] + (is_deformable(s.bodies, body) ? p : rotate(s.poses.orientation[body], p));
}
inline Vec3d world_to_frame(const Surfaces& s, uint32_t body, const Vec3d& p) {
    const Vec3d d = p - s.poses.origin[body];
    return is_deformable(s.bodies, body) ? d : rotate_back(s.poses.orientation[body], d);
}
inline Vec3d direction_to_world(const Surfaces& s, uint32_t body, const Vec3d& v) {
    return is_deformable(s.bodies, body) ? v : rotate(s.poses.orientation[body], v);
}
inline Vec3d vertex_position(const Surfaces& s, uint32_t body, uint32_t vertex) {
    return frame_to_world(s, body, vertex_in_frame(s, body, vertex));
}
inline Vec3d vertex_velocity(const Surfaces& s, uint32_t body, uint32_t vertex) {
    if (is_deformable(s.bodies, body)) {
        const uint32_t p = s.bodies.particles[body].first + vertex;
        return {s.particles.velocity_x[p], s.particles.velocity_y[p], s.particles.velocity_z[p]};
    }
    const Vec3d arm = vertex_position(s, body, vertex) - s.poses.origin[body];
    return s.poses.velocity[body] + s.poses.angular_velocity[body].cross(arm);
}

}  // namespace trocar
