#pragma once
#include "engine/fluid/film_shape.hpp"
namespace trocar {

// Amounts of liquid at present, m^3.
struct FluidAmounts {
    double film = 0;   // on surfaces, as far as it runs or stays on slopes
    double pools = 0;  // on surfaces, where it stands level at more than kPoolDepth
    double drops = 0;  // in the air
    double blood = 0;  // in all of these
    double error = 0;  // of the ledger: (what came - what is there and what went) / what came; 0 if nothing came
};
// Liquid on level ground counts as a pool above this thickness: two capillary lengths times the sine of half a contact angle of 30
// degrees, what a drop on tissue reaches without being held by its weight. m
inline constexpr double kPoolDepth = 1.2e-3;

struct FluidShapeScratch {
    FilmShapeScratch scratch;
    FilmShape shape;
    FilmScratch film;
};

// Counts what there is, and closes the ledger.
FluidAmounts measure_fluids(const Surfaces& surfaces, const Fluids& fluids, const FluidState& state, FluidShapeScratch& scratch);

}  // namespace trocar
