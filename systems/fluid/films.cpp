#include "systems/fluid/films.hpp"

#include <algorithm>

#include "engine/fluid/film_setup.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {

namespace {

// After a cut or a tear.
void reconnect(const FluidPass& pass, uint32_t index, FluidState& state) {
    const FilmBody& film = pass.fluids.body[index];
    const uint32_t prototype = pass.surfaces.bodies.mesh[film.body];
    const uint64_t hash = hash_triangles(mesh_view(pass.surfaces.meshes, prototype).triangle);
    if (hash == state.triangles[index]) return;
    state.triangles[index] = hash;
    connect_film(pass.surfaces.meshes, prototype, film, state);
}

}  // namespace

void flow_films(const FluidPass& pass, FilmsScratch& scratch, FluidState& state) {
    const auto count = static_cast<uint32_t>(pass.fluids.body.size());
    scratch.body.resize(count);
    const double gravity = pass.fluids.params.gravity.norm();
    parallel_for(count, 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const FilmBody& body = pass.fluids.body[i];
            if (body.changes) reconnect(pass, i, state);
            const Film film = film_of(pass.fluids, state, i);
            const bool dry = std::all_of(film.volume.begin(), film.volume.end(), [](double v) { return v == 0; });
            if (dry || is_off(pass.node_state, body.body)) continue;
            FluidShapeScratch& s = scratch.body[i];
            find_film_shape(pass.surfaces, body.body, body.cells.count, down_of(pass.fluids.params.gravity), s.scratch, s.shape);
            flow_film(pass.fluids.params, gravity, pass.seconds, s.shape, film, s.film);
        }
    });
}

}  // namespace trocar
