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

// State of the sweep kept between passes. A cache: any content gives the same pairs.
struct BroadPhaseScratch {
    uint32_t axis = 0;              // sweep axis: the one of largest spread
    std::vector<uint32_t> order;    // bodies by the lower ends of their boxes
    std::vector<SweepEntry> entry;  // the same order without empty boxes
    SweptBoxes swept;
    std::vector<std::array<uint32_t, 2>> found;
    std::vector<uint32_t> first;
    std::vector<Box> swept_box;  // input of the last sweep: if it has not changed, neither have the pairs
    std::vector<std::array<uint32_t, 2>> swept_excluded;
};

// Pairs of bodies whose enlarged boxes overlap, ascending (a, b), by sort-and-sweep along the axis of largest
// spread. Omits pairs of static or kinematic bodies and those in `excluded` (a < b, ascending).
void find_broad_phase_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs);

// The same for pairs kept from pass to pass: they are not recomputed if neither boxes nor `excluded` have
// changed since the scratch's last use, as while all bodies sleep.
void update_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs);

}  // namespace trocar
