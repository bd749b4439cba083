#pragma once
#include <algorithm>
#include <span>

#include "components/haptics.hpp"
namespace trocar {

// Whether a body is a tool's own or one of its jaws.
inline bool is_part_of_tool(const Haptics& haptics, const HandTool& tool, uint32_t body) {
    const auto jaws = std::span(haptics.jaw).subspan(tool.jaws.first, tool.jaws.count);
    return body == tool.body || std::ranges::any_of(jaws, [&](const ToolJaw& jaw) { return jaw.body == body; });
}

}  // namespace trocar
