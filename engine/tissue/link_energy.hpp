#pragma once
#include "engine/tissue/body_energy.hpp"
namespace trocar {

// Where a link is stretched at the time of the velocities, m, from the present state; 0 of a broken one.
double stretch_of_link(const EnergyInputs& inputs, const LinkGroup& group, uint32_t link);

// Of a link, m^2/s^2: of one without rest length, of its vector.
double squared_stretch_rate(const EnergyInputs& inputs, const LinkGroup& group, uint32_t link);

// Energy of the links at a body or at another, J, as measure_energy counts them, from the present state.
double energy_of_links(const EnergyInputs& inputs, uint32_t body, uint32_t other);

// Sets Links::stretch of the links at a body, whose nodes were moved since its time step.
void stretch_links(const EnergyInputs& inputs, uint32_t body);

}  // namespace trocar
