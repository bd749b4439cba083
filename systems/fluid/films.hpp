#pragma once
#include "systems/fluid/amounts.hpp"
#include "systems/fluid/fluid_pass.hpp"
namespace trocar {

struct FilmsScratch {
    std::vector<FluidShapeScratch> body;
    std::vector<uint8_t> shaped;  // one per film: its shape is known in this pass
};

// Lets the films of all bodies flow, bodies in parallel. Films of bodies that were cut or have torn hang together anew; their liquid
// stays at its vertices. Wet bodies that touch, or whose films meet in the gap between them, share liquid first: at every contact the
// thicker film gives to the thinner one, over the area of the point's cell, so that their difference falls to 1/e in 0.1 s.
void flow_films(const FluidPass& pass, FilmsScratch& scratch, FluidState& state);

}  // namespace trocar
