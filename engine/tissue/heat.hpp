#pragma once
#include <span>

#include "components/actions.hpp"
#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/solids.hpp"
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
};

// Adds a deformable body and its nodes, at blood's temperature, or where metabolism and perfusion balance. wall: m, of a shell
// or sheet.
void add_heat_body(const HeatTissue& tissue, double density, double wall, uint32_t body, const Bodies& bodies, const Meshes& meshes,
                   const Solids& solids, Actions& actions, HeatState& state);

// Temperatures and damage after `seconds`, with `power` (W, one per node of the body) into the nodes. Explicit, in steps of at
// most stable_dt. At 100 degrees water boils: a node gets no hotter, and what it would take is in `steam`.
void step_heat(const Actions& actions, const HeatBody& body, double seconds, std::span<const double> power, HeatState& state,
               std::vector<double>& flow);

// 1/s, of damage at a temperature in degrees Celsius.
double damage_rate_at(const HeatBody& body, double celsius);

}  // namespace trocar
