#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/particles.hpp"
#include "engine/distance/closest_point.hpp"
namespace trocar {

struct RefitTreesScratch {
    std::vector<uint8_t> paired;  // per body
    std::vector<uint32_t> body;   // deformable bodies in a pair, ascending
};

// Refits the tree of every deformable body in a broad-phase pair to its present vertices, trees in parallel.
// trees[bodies.tree[i]] is the tree of body i.
void refit_trees(const Bodies& bodies, const Particles& particles, const BroadPhasePairs& pairs, RefitTreesScratch& scratch,
                 std::span<const std::unique_ptr<ClosestPointTree>> trees);

}  // namespace trocar
