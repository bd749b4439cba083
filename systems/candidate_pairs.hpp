#pragma once
#include <array>
#include <span>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
namespace trocar {

// Boxes in the order of the sweep, rounded outward; three rows of ends, the first along the sweep.
struct SweptBoxes {
    std::array<std::vector<float>, 3> low, high;  // m, relative to the middle body; padded by eight that meet nothing
};

struct SweepPlace {
    float low = 0;
    uint32_t body = 0;
};

// Memory of the sweep. A cache: any content gives the same pairs.
struct CandidatePairsScratch {
    uint32_t axis = 0;              // of the sweep, that of the largest spread, kept between passes
    std::vector<uint32_t> order;    // bodies by the lower ends of their boxes, kept between passes
    std::vector<SweepPlace> place;  // the same, those with an empty box left out
    SweptBoxes swept;
    std::vector<std::array<uint32_t, 2>> found;
    std::vector<uint32_t> first;
    std::vector<Box> swept_box;  // what the last sweep was made over: where nothing of it has changed, its pairs are
    std::vector<std::array<uint32_t, 2>> swept_excluded;
};

// Pairs of bodies whose enlarged boxes meet, ascending (a, b), by sort-and-sweep along the axis of the largest spread. A
// pair is left out when neither side can be pushed (static, kinematic) or when `excluded` names it (a < b, ascending).
void find_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                          CandidatePairsScratch& scratch, CandidatePairs& pairs);

// The same for pairs that are kept from pass to pass: they are left as they are where neither boxes nor `excluded` have changed
// since the scratch was last used for them, as while all bodies sleep.
void update_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            CandidatePairsScratch& scratch, CandidatePairs& pairs);

}  // namespace trocar
