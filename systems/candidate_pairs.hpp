#pragma once
#include <array>
#include <span>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
namespace trocar {

// Memory of the sweep. A cache: any content gives the same pairs.
struct CandidatePairsScratch {
    std::vector<uint32_t> order;  // bodies by lower x of their boxes, kept between passes
    std::vector<Box> sorted;      // boxes in that order
    std::vector<std::array<uint32_t, 2>> found;
    std::vector<uint32_t> first;
};

// Pairs of bodies whose enlarged boxes meet, ascending (a, b), by sort-and-sweep along x. A pair is left out when
// neither side can be pushed (static, kinematic) or when `excluded` names it (a < b, ascending).
void find_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes,
                          std::span<const std::array<uint32_t, 2>> excluded, CandidatePairsScratch& scratch,
                          CandidatePairs& pairs);

}  // namespace trocar
