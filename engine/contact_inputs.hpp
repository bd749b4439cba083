#pragma once
#include <memory>
#include <span>

#include "components/contacts.hpp"
#include "engine/closest_point.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// What the stages between candidate pairs and contact rows have in common: who may meet whom, and what everybody looks like.
struct ContactInputs {
    const ContactParams& params;
    double period = 0;  // s, until the next pass
    double fall = 0;    // m, what gravity adds to the way of a body in the period
    Surfaces surfaces;  // at the start of the period
    const BodyBoxes& boxes;
    const CandidatePairs& pairs;
    std::span<const std::unique_ptr<ClosestPointTree>> trees;  // trees[bodies.tree[i]] is that of body i, refitted
};

}  // namespace trocar
