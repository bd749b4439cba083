#pragma once
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "components/mesh.hpp"
namespace trocar::bench {

// A mesh library that tests whether two placed meshes meet. Neither FCL nor CGAL computes a depth for meshes,
// so both are compared by that test only: FCL's collide (bounding volume trees of oriented boxes and swept
// spheres, first contact) does not detect a body wholly inside another; CGAL's
// Rigid_triangle_mesh_collision_detection does, by exact predicates.
struct OverlapPeer {
    std::string name;
    std::function<bool()> meet;  // trees are built in advance
};

// Overlap tests of the libraries that are built in, over world positions of the two bodies.
std::vector<OverlapPeer> make_overlap_peers(const std::vector<Vec3d>& position_a, std::span<const Triangle> triangle_a,
                                            const std::vector<Vec3d>& position_b, std::span<const Triangle> triangle_b);

}  // namespace trocar::bench
