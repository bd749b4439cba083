#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Bodies are sorted into slabs along the axis of their largest spread; constraints within a slab are a group,
// constraints between a slab and the next are another, and the few others are the last one. Graph colours:
// slabs; even borders; odd borders; the rest. Sorts `order` by group. Short lists, embedded surfaces, and
// islands with hands or driven bodies have one group.
void colour_constraints(const AdvanceCall& call, const AdvanceIsland& island, const ContactConstraints& constraints,
                        ContactSorting& sorting, ContactSolver& solver);

}  // namespace trocar
#pragma GCC diagnostic pop
