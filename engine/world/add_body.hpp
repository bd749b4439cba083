#pragma once
#include <string>

#include "engine/world/world.hpp"
namespace trocar {

// Appends a body of an existing prototype at the world origin. Returns its index.
uint32_t add_body(World& world, const std::string& name, uint32_t prototype, Motion motion, const Tissue& tissue = {},
                  AnchorFrame anchor_frame = AnchorFrame::kWorld);

}  // namespace trocar
