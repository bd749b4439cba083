#pragma once
#include "systems/fluid/amounts.hpp"
#include "systems/fluid/fluid_pass.hpp"
namespace trocar {

// Lets the films of all bodies flow, bodies in parallel. Films of bodies that were cut or have torn hang together anew; their liquid
// stays at its vertices.
struct FilmsScratch {
    std::vector<FluidShapeScratch> body;
};
void flow_films(const FluidPass& pass, FilmsScratch& scratch, FluidState& state);

}  // namespace trocar
