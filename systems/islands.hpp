#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
namespace trocar {

struct IslandsScratch {
    std::vector<uint32_t> parent;  // union-find, the smallest body is the root
    std::vector<uint32_t> island;  // per body: row of the island of its set
    std::vector<uint32_t> next;
};

// Groups the bodies that move by force (deformable, hand, free) into islands joined by contact rows and by the pairs of
// bodies in `joined`; each is in exactly one island. Static and scripted bodies join nothing and belong to none. Islands
// ascend by smallest body, bodies and rows inside ascend.
void find_islands(const Bodies& bodies, const ContactRows& rows, IslandsScratch& scratch, Islands& islands,
                  std::span<const std::array<uint32_t, 2>> joined = {});

}  // namespace trocar
