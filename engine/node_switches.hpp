#pragma once
#include <span>

#include "components/haptics.hpp"
#include "components/nodes.hpp"
namespace trocar {

// Fills state.off: bodies of a node that is disabled or lies under one that is, and of tools that are laid down.
inline void find_bodies_off(uint32_t bodies, const Nodes& nodes, std::span<const HandTool> tools, NodeState& state) {
    state.off.assign(bodies, 0);
    for (uint32_t body = 0; body < nodes.of_body.size(); ++body)
        for (uint32_t node = nodes.of_body[body]; node != kNone; node = nodes.parent[node]) state.off[body] |= !state.enabled[node];
    for (uint32_t t = 0; t < state.laid_down.size(); ++t) state.off[tools[t].body] |= state.laid_down[t];
}

}  // namespace trocar
