#include "systems/fluid/films.hpp"

#include <algorithm>
#include <cmath>

#include "engine/fluid/film_setup.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

// s, in which films that touch become equal to 1/e. Chosen: what is pressed together is wet at once, but not within one pass.
constexpr double kSharing = 0.1;

// After a cut or a tear.
void reconnect(const FluidPass& pass, uint32_t index, FluidState& state) {
    const FilmBody& film = pass.fluids.body[index];
    const uint32_t prototype = pass.surfaces.bodies.mesh[film.body];
    const uint64_t hash = hash_triangles(mesh_view(pass.surfaces.meshes, prototype).triangle);
    if (hash == state.triangles[index]) return;
    state.triangles[index] = hash;
    connect_film(pass.surfaces.meshes, prototype, film, state);
}

void find_shape(const FluidPass& pass, uint32_t index, FilmsScratch& scratch) {
    const FilmBody& film = pass.fluids.body[index];
    FluidShapeScratch& s = scratch.body[index];
    find_film_shape(pass.surfaces, film.body, film.cells.count, down_of(pass.fluids.params.gravity), s.scratch, s.shape);
    scratch.shaped[index] = 1;
}

// A point of a film: cells and their weights, of sum 1.
struct FilmPoint {
    uint32_t film = kNone;
    std::array<uint32_t, 3> cell{};  // of the film
    std::array<double, 3> weight{};
};

// Thickness of a film at a point, and area of its cells there.
std::array<double, 2> thickness_and_area(const FluidPass& pass, const FilmPoint& point, const FilmsScratch& scratch,
                                         const FluidState& state) {
    const uint32_t first = pass.fluids.body[point.film].cells.first;
    double thickness = 0, area = 0;
    for (size_t k = 0; k < 3; ++k) {
        const double inverse = static_cast<double>(scratch.body[point.film].shape.inverse_area[point.cell[k]]);
        if (!(point.weight[k] > 0) || !(inverse > 0)) continue;
        thickness += point.weight[k] * state.volume[first + point.cell[k]] * inverse;
        area += point.weight[k] / inverse;
    }
    return {thickness, area};
}

// Takes up to a volume away, at most half of what each cell has; returns volume and blood.
std::array<double, 2> take_from(const FluidPass& pass, const FilmPoint& point, double volume, FluidState& state) {
    const uint32_t first = pass.fluids.body[point.film].cells.first;
    std::array<double, 2> taken{};
    for (size_t k = 0; k < 3; ++k) {
        double& there = state.volume[first + point.cell[k]];
        if (!(point.weight[k] > 0) || !(there > 0)) continue;
        const double part = std::min(0.5 * there, point.weight[k] * volume);
        double& blood = state.blood[first + point.cell[k]];
        const double dye = blood * (part / there);
        there -= part, blood -= dye;
        taken[0] += part, taken[1] += dye;
    }
    return taken;
}

void give_to(const FluidPass& pass, const FilmPoint& point, const std::array<double, 2>& given, FluidState& state) {
    const uint32_t first = pass.fluids.body[point.film].cells.first;
    for (size_t k = 0; k < 3; ++k) {
        if (!(point.weight[k] > 0)) continue;
        state.volume[first + point.cell[k]] += point.weight[k] * given[0];
        state.blood[first + point.cell[k]] += point.weight[k] * given[1];
    }
}

void share_at(const FluidPass& pass, uint32_t row, const FilmPoint& a, const FilmPoint& b, FilmsScratch& scratch, FluidState& state) {
    for (const uint32_t film : {a.film, b.film})
        if (!scratch.shaped[film]) find_shape(pass, film, scratch);
    const auto [thick_a, area_a] = thickness_and_area(pass, a, scratch, state);
    const auto [thick_b, area_b] = thickness_and_area(pass, b, scratch, state);
    const bool touches = pass.constraints.impulse[row].squaredNorm() > 0;
    if (!touches && !(pass.constraints.distance[row] <= thick_a + thick_b)) return;
    const double volume = 0.5 * std::abs(thick_a - thick_b) * std::min(area_a, area_b) * -std::expm1(-pass.seconds / kSharing);
    const bool from_a = thick_a > thick_b;
    if (volume > 0) give_to(pass, from_a ? b : a, take_from(pass, from_a ? a : b, volume, state), state);
}

bool is_wet(const FluidPass& pass, uint32_t film, const FluidState& state) {
    const Range cells = pass.fluids.body[film].cells;
    return !std::all_of(state.volume.begin() + cells.first, state.volume.begin() + cells.end(), [](double v) { return v == 0; });
}

void share_liquid(const FluidPass& pass, FilmsScratch& scratch, FluidState& state) {
    const ContactConstraints& rows = pass.constraints;
    for (uint32_t i = 0; i < rows.body.size(); ++i) {
        const uint32_t film = find_film(pass.fluids, rows.body[i]), other = find_film(pass.fluids, rows.other[i]);
        if (film == kNone || other == kNone || film == other || !(scratch.shaped[film] || scratch.shaped[other])) continue;
        if (is_off(pass.node_state, rows.body[i]) || is_off(pass.node_state, rows.other[i])) continue;
        const double along = static_cast<double>(rows.along[i]), across = static_cast<double>(rows.across[i]);
        const FilmPoint point{film,
                              {rows.vertex[i][0], rows.vertex[i][1], across != 0 ? rows.third[i] : rows.vertex[i][0]},
                              {1 - along - across, along, across}};
        const auto weight = [&](size_t k) { return static_cast<double>(rows.weight[i][k]); };
        share_at(pass, i, point, {other, rows.triangle[i], {weight(0), weight(1), weight(2)}}, scratch, state);
    }
}

}  // namespace

void flow_films(const FluidPass& pass, FilmsScratch& scratch, FluidState& state) {
    const auto count = static_cast<uint32_t>(pass.fluids.body.size());
    scratch.body.resize(count);
    scratch.shaped.assign(count, 0);
    const double gravity = pass.fluids.params.gravity.norm();
    parallel_for(count, 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            if (pass.fluids.body[i].changes) reconnect(pass, i, state);
            if (!is_off(pass.node_state, pass.fluids.body[i].body) && is_wet(pass, i, state)) find_shape(pass, i, scratch);
        }
    });
    if (count > 1) share_liquid(pass, scratch, state);
    parallel_for(count, 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i)
            if (scratch.shaped[i])
                flow_film(pass.fluids.params, gravity, pass.seconds, scratch.body[i].shape, film_of(pass.fluids, state, i),
                          scratch.body[i].film);
    });
}

}  // namespace trocar
