#pragma once
#include <span>

#include "components/actions.hpp"
#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
namespace trocar {

// Heat in tissue by Pennes' equation (J. Appl. Physiol. 1, 1948): rho c dT/dt = div(k grad T) + w (T_blood - T) + q. Linear
// finite elements on the shape at rest, with lumped capacities: tetrahedra of a solid; triangles of a shell or sheet, which is
// as warm inside as outside. Nothing flows out through the surface.

// Of a tissue. Defaults: renal tissue in models of radiofrequency ablation (Dobre, Morega, Computational Modeling in Biomedical
// Engineering and Medical Physics, table 8.3: 3.4e-3/s of blood, 1000 kg/m^3 and 4180 J/(kg K); metabolism neglected) and the
// coagulation of pig liver, which whitens it: activation entropy 553.5 J/(mol K) and enthalpy 2.768e5 J/mol (Jacques, "Liver
// coagulation", omlc.org, 2006), a rate by Eyring at 60 degrees of 5.7e41/s exp(-2.768e5 J/mol / RT).
struct HeatTissue {
    double conductivity = 0.4812;    // W/(m K)
    double specific_heat = 3771;     // J/(kg K)
    double perfusion = 14212;        // W/(m^3 K), blood flow per volume times its density and specific heat
    double metabolism = 0;           // W/m^3
    double damage_rate = 5.7e41;     // 1/s
    double damage_energy = 2.768e5;  // J/mol
    // Young's modulus of pig liver during radiofrequency ablation, by ultrasonic elastometry at 1 cm from the applicator: from 6.64 to
    // 46.4 kPa within 11 minutes
    double stiffening = 7;  // stiffness of denatured tissue / that before
    // Water of liver: 0.7 of its mass (Duck, Physical Properties of Tissue, 1990); its heat of vaporisation at 100 degrees is 2.257e6 J/kg
    double water = 0.7;   // of the mass
    bool parts = false;   // what has boiled away is removed
};

// Adds a deformable body and its nodes, at blood's temperature, or where metabolism and perfusion balance. wall: m, of a shell
// or sheet.
// cut: index of the body among those that instruments may cut, or kNone; it has as many nodes and edges as are reserved there.
void add_heat_body(const HeatTissue& tissue, double density, double wall, uint32_t body, uint32_t cut, const Bodies& bodies,
                   const Meshes& meshes, const Solids& solids, Actions& actions, HeatState& state);

// Capacities, areas and conductances of a body whose surface was cut, from its present one. New nodes have no state yet.
void lay_heat(const HeatBody& body, const Bodies& bodies, const Meshes& meshes, const Solids& solids, Actions& actions);
// Of all bodies that may be cut: when the state was set back to the start of a pass.
void restore_heat(const Bodies& bodies, const Meshes& meshes, const Solids& solids, Actions& actions);

// Lets the springs and tetrahedra of a body stiffen as it coagulates: gives them factors of their own, takes note of those in `body`,
// and shortens the stable step of the body by the root of its stiffening, which bounds every frequency. Its prototype is not shared.
void let_stiffen(HeatBody& body, Springs& springs, Solids& solids, Bodies& bodies, Actions& actions);
// The factors without stiffening are those of the springs now: after a cut.
void note_factors(const HeatBody& body, const Bodies& bodies, const Springs& springs, Actions& actions);

// Stiffness of a node that coagulates / that before, by mixture: 1 + (stiffening - 1) times the part of its proteins that denatured.
double stiffening_of(const HeatBody& body, double damage);
// Gives the springs the mean stiffening of their ends, the tetrahedra that of their corners. With `only_ask` returns whether any would
// change; changes nothing.
bool stiffen(const HeatBody& body, const Bodies& bodies, const Actions& actions, const HeatState& state, bool only_ask, Springs& springs,
             Solids& solids);

// Whether a node coagulated: it is sealed, its vessels are closed.
inline bool is_sealed(const HeatBody& body, const HeatState& state, uint32_t node) { return state.damage[body.nodes.first + node] >= 1; }
// Whether the water of a node has boiled away.
bool has_boiled_away(const HeatBody& body, const Actions& actions, const HeatState& state, uint32_t node);

// Temperatures and damage after `seconds`, with `power` (W, one per node of the body) into the nodes. Explicit, in steps of at
// most stable_dt. At 100 degrees water boils: a node gets no hotter, and what it would take is in `steam`.
void step_heat(const Actions& actions, const HeatBody& body, double seconds, std::span<const double> power, HeatState& state,
               std::vector<double>& flow);

// 1/s, of damage at a temperature in degrees Celsius.
double damage_rate_at(const HeatBody& body, double celsius);

}  // namespace trocar
