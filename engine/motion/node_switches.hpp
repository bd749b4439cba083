#pragma once
#include <span>

#include "components/nodes.hpp"
#include "components/tool.hpp"
namespace trocar {

// Fills state.off: bodies of disabled nodes and of all nodes below these, and of tools not in a hand.
inline void find_bodies_off(uint32_t bodies, const Nodes& nodes, std::span<const HandTool> tools, NodeState& state) {
    state.off.assign(bodies, 0);
    for (uint32_t body = 0; body < nodes.of_body.size(); ++body)
        for (uint32_t node = nodes.of_body[body]; node != kNone; node = nodes.parent[node]) state.off[body] |= !state.enabled[node];
    for (uint32_t t = 0; t < state.laid_down.size(); ++t) state.off[tools[t].body] |= state.laid_down[t];
}

}  // namespace trocar
