#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/particles.hpp"
#include "engine/closest_point.hpp"
namespace trocar {

struct RefitTreesScratch {
    std::vector<uint8_t> paired;  // per body
    std::vector<uint32_t> body;   // deformable bodies in a pair, ascending
};

// Gives the tree of every deformable body that is in a candidate pair its present vertices. Different trees are
// refitted in parallel. trees[bodies.tree[i]] is the tree of body i.
void refit_trees(const Bodies& bodies, const Particles& particles, const CandidatePairs& pairs, RefitTreesScratch& scratch,
                 std::span<const std::unique_ptr<ClosestPointTree>> trees);

}  // namespace trocar
