#include "systems/fluid/sources.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/fluid/film_setup.hpp"
#include "engine/fluid/film_shape.hpp"
namespace trocar {
namespace {

// s, part of the pass in which a wound is open.
double open_time(const FluidPass& pass, const Wound& wound) {
    return std::max(0.0, std::min(pass.now + pass.seconds, wound.end) - std::max(pass.now, wound.begin));
}

void bleed(const FluidPass& pass, FluidState& state) {
    for (const Wound& wound : pass.fluids.wound) {
        const FilmBody& film = pass.fluids.body[wound.film];
        const double volume = wound.rate * open_time(pass, wound);
        if (!(volume > 0) || is_off(pass.node_state, film.body)) continue;
        for (uint32_t i = wound.spots.first; i < wound.spots.end(); ++i) {
            const double part = volume * pass.fluids.share[i];
            const uint32_t cell = film.cells.first + pass.fluids.spot[i];
            state.volume[cell] += part, state.blood[cell] += part;
            state.ledger.bled += part;
        }
    }
}

// Where a nozzle is and where it moves, world.
struct Nozzle {
    Vec3d at, direction, velocity;
};
Nozzle nozzle_of(const FluidPass& pass, const ToolAction& action) {
    const Surfaces& s = pass.surfaces;
    const uint32_t body = pass.tools[action.tool].body;
    const Vec3d at = frame_to_world(s, body, action.point);
    const Vec3d arm = at - s.poses.origin[body];
    return {at, direction_to_world(s, body, action.direction), s.poses.velocity[body] + s.poses.angular_velocity[body].cross(arm)};
}

// Drops of a jet are as large as hanging ones, so that a jet of two litres a minute needs a dozen in a pass.
void irrigate(const FluidPass& pass, const ToolAction& action, FluidState& state) {
    const Nozzle nozzle = nozzle_of(pass, action);
    const double volume = action.rate * pass.seconds, bore = 0.25 * std::numbers::pi * action.bore * action.bore;
    const Vec3d velocity = nozzle.velocity + action.rate / bore * nozzle.direction;
    const double usual = std::min(hanging_drop(pass.fluids.params, pass.fluids.params.gravity.norm()), 50e-9);
    const auto count = static_cast<uint32_t>(std::ceil(volume / usual));
    for (uint32_t k = 0; k < count && state.drops.volume.size() < pass.fluids.most_drops; ++k) {
        const double part = volume / count, age = pass.seconds * (k + 0.5) / count;
        state.drops.position.push_back(nozzle.at + age * (velocity - nozzle.velocity));
        state.drops.velocity.push_back(velocity);
        state.drops.volume.push_back(part), state.drops.blood.push_back(0);
        state.ledger.irrigated += part;
    }
}

void take(FluidLedger& ledger, double volume, double blood) { ledger.sucked += volume, ledger.sucked_blood += blood; }

void remove_drop(size_t i, Drops& drops) {
    drops.position[i] = drops.position.back(), drops.position.pop_back();
    drops.velocity[i] = drops.velocity.back(), drops.velocity.pop_back();
    drops.volume[i] = drops.volume.back(), drops.volume.pop_back();
    drops.blood[i] = drops.blood.back(), drops.blood.pop_back();
}

// Drops within reach, up to a volume; returns what of it is left.
double suck_drops(const Vec3d& at, double reach, double volume, FluidState& state) {
    Drops& drops = state.drops;
    for (size_t i = drops.volume.size(); i-- > 0 && volume > 0;) {
        if ((drops.position[i] - at).norm() > reach) continue;
        if (drops.volume[i] <= volume) {
            take(state.ledger, drops.volume[i], drops.blood[i]);
            volume -= drops.volume[i];
            remove_drop(i, drops);
            continue;
        }
        const double blood = drops.blood[i] * (volume / drops.volume[i]);
        take(state.ledger, volume, blood);
        drops.volume[i] -= volume, drops.blood[i] -= blood;
        volume = 0;
    }
    return volume;
}

// Wet cells with liquid within reach: between the vertex and the surface of what stands on it.
void find_reached(const FluidPass& pass, const FilmBody& film, const Vec3d& at, double reach, const FluidState& state,
                  FluidSourcesScratch& scratch) {
    const Range vertices = pass.surfaces.meshes.info[pass.surfaces.bodies.mesh[film.body]].vertices;
    const Vec3d up = -down_of(pass.fluids.params.gravity), local = world_to_frame(pass.surfaces, film.body, at);
    const Vec3d up_local = is_deformable(pass.surfaces.bodies, film.body) ? up : rotate_back(pass.surfaces.poses.orientation[film.body], up);
    for (uint32_t v = 0; v < vertices.count; ++v) {
        const uint32_t cell = film.cells.first + v;
        if (!(state.volume[cell] > 0)) continue;
        const Vec3d from = local - vertex_in_frame(pass.surfaces, film.body, v);
        const double along = std::clamp(from.dot(up_local), 0.0, static_cast<double>(state.rise[cell]));
        if ((from - along * up_local).squaredNorm() <= reach * reach) scratch.cell.push_back(cell);
    }
}

// A cell that is sucked dry moves nothing more.
void suck_films(const FluidPass& pass, const Vec3d& at, double reach, double volume, FluidSourcesScratch& scratch, FluidState& state) {
    scratch.cell.clear();
    for (const FilmBody& film : pass.fluids.body)
        if (!is_off(pass.node_state, film.body)) find_reached(pass, film, at, reach, state, scratch);
    double there = 0;
    for (const uint32_t cell : scratch.cell) there += state.volume[cell];
    if (!(there > 0)) return;
    const bool all = there <= volume;
    const double part = all ? 1 : volume / there;
    for (const uint32_t cell : scratch.cell) {
        const double liquid = all ? state.volume[cell] : part * state.volume[cell];
        const double blood = all ? state.blood[cell] : part * state.blood[cell];
        take(state.ledger, liquid, blood);
        state.volume[cell] -= liquid, state.blood[cell] -= blood;
    }
}

void suck(const FluidPass& pass, const ToolAction& action, FluidSourcesScratch& scratch, FluidState& state) {
    const Vec3d at = nozzle_of(pass, action).at;
    const double left = suck_drops(at, action.reach, action.rate * pass.seconds, state);
    if (left > 0) suck_films(pass, at, action.reach, left, scratch, state);
}

}  // namespace

void run_sources(const FluidPass& pass, FluidSourcesScratch& scratch, FluidState& state) {
    bleed(pass, state);
    for (const ActionKind kind : {ActionKind::kIrrigate, ActionKind::kSuck}) {
        for (size_t i = 0; i < pass.actions.action.size(); ++i) {
            const ToolAction& action = pass.actions.action[i];
            if (action.kind != kind || !pass.progress[i].on) continue;
            if (kind == ActionKind::kIrrigate)
                irrigate(pass, action, state);
            else
                suck(pass, action, scratch, state);
        }
    }
}

}  // namespace trocar
