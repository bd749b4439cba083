#pragma once
#include <array>
#include <span>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
namespace trocar {

// Boxes in the order of the sweep, rounded outward; three arrays of ends, the first along the sweep axis.
struct SweptBoxes {
    std::array<std::vector<float>, 3> low, high;  // m, relative to the middle body; padded by eight boxes that overlap nothing
};

struct SweepEntry {
    float low = 0;
    uint32_t body = 0;
};

// State of the search kept between passes. A cache: any content gives the same pairs.
struct BroadPhaseScratch {
    uint32_t axis = 0;              // sweep axis: the one of largest spread
    std::vector<uint32_t> order;    // bodies by the lower ends of their loose boxes
    std::vector<SweepEntry> entry;  // the same order without empty boxes
    SweptBoxes swept;               // loose boxes at the last sweep of all bodies
    Vec3d base = Vec3d::Zero();     // m: origin of swept
    double window = 0;              // m: no box is longer along the axis, but those of `lengthy`
    std::vector<uint32_t> lengthy;  // indices of entry
    uint32_t passes = 0;            // since the last sweep of all bodies
    uint32_t exact_passes = 0;      // passes yet for which loose boxes do not pay

    std::vector<Box> loose;                       // per body: contains its box until the body strays
    std::vector<uint8_t> strays, leaves;          // per body: whether it left its loose box since the last sweep of all; in this pass
    std::vector<uint32_t> stray, leaving;         // those bodies
    std::vector<std::array<uint32_t, 2>> near;    // pairs of bodies whose loose boxes overlap, ascending
    std::vector<std::array<uint32_t, 2>> merged;  // near and found
    std::vector<std::array<uint32_t, 2>> found;   // unsorted
    std::vector<uint32_t> first;
    std::vector<std::array<uint32_t, 2>> excluded;  // of near
    std::vector<Box> box;                           // of update_candidate_pairs' last use
};

// Pairs of bodies whose boxes overlap, ascending (a, b). Omits pairs of static or kinematic bodies and those in `excluded`
// (a < b, ascending). Near pairs, of boxes enlarged by a twentieth, are kept from pass to pass; bodies that leave their enlarged
// boxes are paired anew, and all by sort-and-sweep along the axis of largest spread once an eighth has left.
void find_broad_phase_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs);

// The same for pairs that stay from pass to pass: they are as they were if neither boxes nor `excluded` have changed since the
// scratch's last use, as while all bodies sleep.
void update_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs);

}  // namespace trocar
