#pragma once
#include <span>

#include "systems/fluid/fluid_pass.hpp"
namespace trocar {

// Lets cautery emit smoke, and moves it: puffs of Gaussian density rise while they are warm, their variance grows by twice the diffusion
// times the time, and they thin out with the exchange of the gas. `gas`: m^3 that each action sucks in this pass. Around a nozzle gas
// flows radially, so that a sphere of the sucked volume vanishes; the nozzle takes the density of a puff where it is times that volume.
void move_smoke(const FluidPass& pass, std::span<const double> gas, FluidState& state);

// Density of a puff of unit mass at a distance from its centre, 1/m^3.
double puff_density(double variance, double squared_distance);

}  // namespace trocar
