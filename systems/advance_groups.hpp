#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Bodies are put into strips across the way they spread most; rows inside a strip are a group, rows between a strip and the
// next are another, and the few others a last one. Phases: strips; even borders; odd borders; the rest. Orders dealt by group.
// Short lists, skins, and islands with hands or driven bodies have one group.
void group_rows(const AdvanceCall& call, const AdvanceIsland& island, const ContactRows& rows, ContactSorting& sorting,
                ContactSolver& solver);

}  // namespace trocar
#pragma GCC diagnostic pop
