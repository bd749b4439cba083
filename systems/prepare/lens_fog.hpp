#pragma once
#include <span>

#include "components/lens.hpp"
#include "components/nodes.hpp"
#include "components/spawning.hpp"
#include "engine/tissue/links.hpp"
namespace trocar {

// kg/m^3, of water vapour in saturated air: pressure by Magnus' formula with the constants of Alduchov, Eskridge (J. Appl.
// Meteorol. 35, 1996), valid from -40 to 50 degrees Celsius, as an ideal gas.
double saturated_vapour(double celsius);

// Fraction of the light that the film on a lens scatters.
double fog_of(const Lens& lens);

// Lets lenses warm up and fog for a pass. The temperature approaches that of the cavity exponentially. The film of water grows by
// transfer (humidity saturated_vapour(cavity) - saturated_vapour(lens)), and shrinks by the same law once the lens is above the
// dew point. A lens nearer than `wipe` to a deformable body that is there is wiped.
void fog_lenses(double period, const LinkWorld& world, const SpawnState& spawning, const NodeState& node_state, std::span<Lens> lenses);

}  // namespace trocar
