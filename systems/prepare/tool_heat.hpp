#pragma once
#include "systems/prepare/tool_actions.hpp"
namespace trocar {

// Heats the bodies that tools cauterise, while their triggers are pulled (act has followed them) and the surface is within reach
// of their point: the power goes into the nodes around it, by their volumes and a Gaussian of their distance beyond that of the
// nearest. Then lets the heat of all heated bodies spread for a pass. Nodes that coagulate are counted, and listed in `burnt`.
void heat_with_tools(const ActionPass& pass, ActionState& state);

}  // namespace trocar
