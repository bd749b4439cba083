#pragma once
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// A triangle of a surface and its plane.
struct SurfacePlane {
    uint32_t triangle = kNone;
    Vec3d normal = Vec3d::Zero();  // unit
};

// The triangle above or below a point, found by walking over the surface from triangle `start`, in the plane of `normal`: feature
// tracking (Lin & Canny 1991). None beyond a rim or an edge that bends by more than 12 degrees. Across edges without a bend the
// normal stays the same to the bit.
SurfacePlane walk_surface(const MeshView& mesh, const Triangle& start, const Vec3d& normal, const Vec3d& point);

}  // namespace trocar
