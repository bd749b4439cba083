#pragma once
#include "components/haptics.hpp"
#include "components/particles.hpp"
#include "engine/links.hpp"
namespace trocar {

// Makes the links whose time has come or whose tool grips, releases those whose time is over, takes broken ones away, in the
// order of the groups, and works out the stable steps when anything changed. A group that finds no node to hold tries again
// in the next pass. Whoever is linked or let go wakes up. now: s, at the start of the pass.
void link_bodies(double now, std::span<const ToolState> tools, const LinkWorld& world, LinkScratch& scratch, Links& links, Sleep& sleep,
                 Energy& energy, Report& report);

// Keeps the largest force of every group, mean over a pass of `seconds`, and the force on the tools whose bodies or jaws hold
// links: ToolState::link_force; after advance.
void note_link_forces(double seconds, std::span<const HandTool> tools, std::span<const ToolJaw> jaws, Links& links,
                      std::span<ToolState> states);

// Pairs of bodies that links and jaws join: they are of one island, sleep together, and hold each other.
void find_joined_bodies(const Bodies& bodies, const Links& links, std::span<const HandTool> tools, std::span<const ToolJaw> jaws,
                        std::vector<std::array<uint32_t, 2>>& joined);

}  // namespace trocar
