#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
namespace trocar {

struct IslandsScratch {
    std::vector<uint32_t> parent;  // union-find, the smallest body is the root
    std::vector<uint32_t> island;  // per root body
    std::vector<uint32_t> next;
};

// Groups the bodies that move by force (deformable, hand, free) into islands joined by contact rows; static and scripted
// bodies join nothing and belong to none. Every such body is in exactly one island. Islands ascend by smallest body,
// bodies and rows inside ascend.
void find_islands(const Bodies& bodies, const ContactRows& rows, IslandsScratch& scratch, Islands& islands);

}  // namespace trocar
