#pragma once
#include "components/report.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/tissue/body_energy.hpp"
#include "systems/prepare/tool_actions.hpp"
namespace trocar {

// What heat changes besides its state: the stiffness of what coagulates.
struct HeatWorld {
    const Anchors& anchors;
    Vec3d gravity;  // m/s^2
    Springs& springs;
    Solids& solids;
    const Tears& tears;
    Torn& torn;
    TornSprings& torn_springs;
    Sleep& sleep;
    Energy& energy;
};

// Heats the bodies that tools cauterise, while their triggers are pulled (act has followed them) and the surface is within reach
// of their point: the power goes into the nodes around it, by their volumes and a Gaussian of their distance beyond that of the
// nearest. Nodes whose water has boiled away get none where others do. Then lets the heat of all heated bodies spread for a pass.
// Nodes that coagulate are counted, and listed in `burnt`. Springs and tetrahedra stiffen with the damage (stiffen); the elastic
// energy that this gives is in the accounting (work_links).
void heat_with_tools(const ActionPass& pass, ActionState& state, HeatWorld world);

}  // namespace trocar
