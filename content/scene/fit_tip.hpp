#pragma once
#include <string>

#include "components/tool.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// The sphere that the hand feels with dof = 3 stands for the body's mesh around the tip, which presses in the
// simulation: where they differ, so do the forces.

// Sets tip and radius of a tool from its mesh: a tip outside (unless given) becomes the centre of a ball
// inside the mesh, found from the surface nearest to there by going up the distance inside; a radius of zero the distance from
// the tip to the surface, or to the vertices of a ball. Returns a warning: the tip was moved, is outside, or a given
// radius misses the mesh by more than 2 %; else empty. Leaves a mesh without an inside alone, with a radius of 6 mm if
// it has none.
std::string fit_tip(const World& world, bool tip_given, HandTool& tool);

}  // namespace trocar
