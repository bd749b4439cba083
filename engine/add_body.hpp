#pragma once
#include <string>

#include "engine/world.hpp"
namespace trocar {

// Appends a body of a prototype, which must be there, at the world origin. Returns its row.
uint32_t add_body(World& world, const std::string& name, uint32_t prototype, Motion motion, const Tissue& tissue = {},
                  AnchorFrame anchor_frame = AnchorFrame::kWorld);

}  // namespace trocar
