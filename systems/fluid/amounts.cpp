#include "systems/fluid/amounts.hpp"

#include "engine/fluid/film_setup.hpp"
namespace trocar {

FluidAmounts measure_fluids(const Surfaces& surfaces, const Fluids& fluids, const FluidState& state, FluidShapeScratch& scratch) {
    FluidAmounts sum;
    for (const FilmBody& film : fluids.body) {
        find_film_shape(surfaces, film.body, film.cells.count, down_of(fluids.params.gravity), scratch.scratch, scratch.shape);
        for (uint32_t v = 0; v < film.cells.count; ++v) {
            const double volume = state.volume[film.cells.first + v];
            const float h = static_cast<float>(volume) * scratch.shape.inverse_area[v];
            const bool level = scratch.shape.upright[v] > 0 && levelness(h, scratch.shape.relief[v]) > 0.5f;
            (level && h > kPoolDepth ? sum.pools : sum.film) += volume;
            sum.blood += state.blood[film.cells.first + v];
        }
    }
    for (size_t i = 0; i < state.drops.volume.size(); ++i) sum.drops += state.drops.volume[i], sum.blood += state.drops.blood[i];
    const FluidLedger& l = state.ledger;
    const double came = l.bled + l.irrigated;
    if (came > 0) sum.error = (came - sum.film - sum.pools - sum.drops - l.sucked - l.lost) / came;
    return sum;
}

}  // namespace trocar
