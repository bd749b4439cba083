#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
namespace trocar {

struct IslandsScratch {
    std::vector<uint32_t> parent;  // union-find, the smallest body is the root
    std::vector<uint32_t> island;  // per body: index of its island
    std::vector<uint32_t> next;
};

// Groups bodies moved by forces (deformable, hand, free) into islands joined by contact constraints and by
// `joined` pairs; each is in exactly one island. Static and scripted bodies join nothing and belong to none.
// Islands ascend by smallest body; bodies and constraints within ascend.
void find_islands(const Bodies& bodies, const ContactConstraints& constraints, IslandsScratch& scratch, Islands& islands,
                  std::span<const std::array<uint32_t, 2>> joined = {});

}  // namespace trocar
