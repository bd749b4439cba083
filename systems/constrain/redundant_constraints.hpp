#pragma once
#include <vector>

#include "components/contacts.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// A constraint's point seen along the normal that it shares with others of its pair.
struct CoplanarConstraint {
    uint32_t constraint;
    double x, y;   // m, in the plane normal to it
    double above;  // m, distance above the supporting plane
};

struct RedundantConstraintsScratch {
    struct Chunk {
        std::vector<CoplanarConstraint> coplanar;  // with the same normal
        std::vector<uint32_t> left;                // the current pair's constraints without a normal yet
        std::vector<uint32_t> patch, hull;         // indices into coplanar
    };
    std::vector<Chunk> chunk;
    std::vector<uint32_t> of_rigid_pairs;  // constraints of rigid pairs, by pair
    std::vector<Range> pair;               // ranges of of_rigid_pairs
    std::vector<uint8_t> dropped;          // per constraint
};

// Drops redundant constraints between two rigid bodies. For one normal a point's separation is affine in its
// position across it, also while the bodies move: a constraint at a weighted mean of other points, with at
// least their mean separation, holds if theirs hold, and they can carry its force and friction. For a face on
// a face the common part's corners remain, for a rod on a face its ends (convex hull of the support: Mirtich
// 1998, "Rigid body contact: collision detection to force computation", section 3.2). Normals within 1e-3 rad
// count as one; tolerances are 1e-5 (distance) and 1e-4 (position) of a normal's largest extent. Of
// coinciding points the first stays. Only a pair's first eight normals are examined. Keeps the order.
void drop_redundant_constraints(const Surfaces& surfaces, RedundantConstraintsScratch& scratch, ContactConstraints& constraints);

}  // namespace trocar
