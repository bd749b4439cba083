#pragma once
#include <memory>
#include <span>

#include "components/contacts.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/mesh/convex_hull.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Common inputs of the stages between broad-phase pairs and contact constraints: which bodies may collide,
// and their surfaces.
struct ContactInputs {
    const ContactParams& params;
    double period = 0;  // s, until the next pass
    double fall = 0;    // m, displacement that gravity adds in the period
    Surfaces surfaces;  // at the start of the period
    const BodyBoxes& boxes;
    const BroadPhasePairs& pairs;
    std::span<const std::unique_ptr<ClosestPointTree>> trees;  // trees[bodies.tree[i]] is that of body i, refitted
    const ConvexHulls* hulls = nullptr;                        // none: all contact is that of triangles
};

}  // namespace trocar
