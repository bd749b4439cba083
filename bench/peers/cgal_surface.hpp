#pragma once
#include <memory>
#include <span>

#include "components/mesh.hpp"
namespace trocar::bench {

// CGAL's queries on one closed mesh: AABB_tree::closest_point_and_primitive with the distance accelerator,
// and Side_of_triangle_mesh on the same tree (kernel with exact predicates and inexact constructions).
class CgalSurface {
 public:
    CgalSurface(std::span<const Vec3d> position, std::span<const Triangle> triangle);
    ~CgalSurface();
    void query(std::span<const Vec3d> points, std::span<double> signed_distance) const;

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

// Side of every point by CGAL's exact kernel: -1 inside, 0 on the surface, 1 outside.
void cgal_exact_sides(std::span<const Vec3d> position, std::span<const Triangle> triangle, std::span<const Vec3d> points,
                      std::span<int> side);

}  // namespace trocar::bench
