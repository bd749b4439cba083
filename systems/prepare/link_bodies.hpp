#pragma once
#include "components/actions.hpp"
#include "components/particles.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
#include "engine/tissue/links.hpp"
namespace trocar {

// Makes the links whose time has come or whose tool grips, releases those whose time is over and removes
// broken ones, in the order of the groups; recomputes the stable steps after a change. A group that finds no
// node tries again in the next pass. Linked and released bodies wake up. now: s, at the start of the pass.
void link_bodies(double now, std::span<const ToolState> tools, const LinkWorld& world, LinkScratch& scratch, Links& links, Sleep& sleep,
                 Energy& energy, Report& report);

// Updates the largest force of every group (mean over a pass of `seconds`) and the force on tools whose bodies or
// jaws hold links or which grasp rigid bodies, ToolState::link_force. Call after advance.
void note_link_forces(double seconds, std::span<const HandTool> tools, std::span<const ToolJaw> jaws, const Actions& actions, Links& links,
                      ActionState& action_state, std::span<ToolState> states);

// Pairs of bodies that links, jaws and grasps join: they are in one island and sleep together.
void find_joined_bodies(const Bodies& bodies, const Links& links, std::span<const HandTool> tools, std::span<const ToolJaw> jaws,
                        const Actions& actions, std::span<const ToolGrasp> grasps, std::vector<std::array<uint32_t, 2>>& joined);

}  // namespace trocar
