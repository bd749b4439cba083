#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
namespace trocar {

// A tool whose tick reported that it pierced a body does not collide with it, shaft included, until their
// boxes separate. Records them in `states`; `pairs` becomes `apart` and those pairs (a < b, ascending).
void find_pierced_bodies(std::span<const HandTool> tools, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> apart,
                         std::span<ToolState> states, std::vector<std::array<uint32_t, 2>>& pairs);

}  // namespace trocar
