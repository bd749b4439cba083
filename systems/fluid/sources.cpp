#include "systems/fluid/sources.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/fluid/film_setup.hpp"
#include "engine/fluid/film_shape.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/links.hpp"
#include "systems/fluid/smoke.hpp"
namespace trocar {
namespace {

// s, part of the pass in which a wound is open.
double open_time(const FluidPass& pass, const Wound& wound) {
    return std::max(0.0, std::min(pass.now + pass.seconds, wound.end) - std::max(pass.now, wound.begin));
}

// Coagulated tissue of which less than this is left bleeds no more.
constexpr double kLeastOpen = 0.01;

// Part of the tissue at a vertex that has not coagulated.
double unburnt(const FluidPass& pass, uint32_t body, uint32_t vertex) {
    const auto heat = std::ranges::find(pass.actions.heat_body, body, &HeatBody::body);
    if (heat == pass.actions.heat_body.end()) return 1;
    const auto left = [&](uint32_t node) { return std::exp(-pass.action_state.heat.damage[heat->nodes.first + node]); };
    const uint32_t prototype = pass.surfaces.bodies.mesh[body];
    const Range skin = prototype < pass.solids.info.size() ? pass.solids.info[prototype].skin : Range{};
    double open = 0;
    for (size_t c = 0; c < 4 && skin.count > 0; ++c)
        open += pass.solids.embedding_weight[skin.first + vertex][c] * left(pass.solids.embedding_node[skin.first + vertex][c]);
    if (skin.count == 0) open = left(vertex);
    return open < kLeastOpen ? 0 : std::min(open, 1.0);
}

void find_stapled(const FluidPass& pass, std::vector<StapledPlace>& out) {
    out.clear();
    const Surfaces& s = pass.surfaces;
    const auto add = [&](uint32_t body, uint32_t node) {
        const uint32_t particle = s.bodies.particles[body].first + embedded_count(pass.solids, s.bodies.mesh[body]) + node;
        const Float4& o = s.particles.offset[particle];
        out.push_back({body, s.poses.origin[body] + Vec3d(o.x, o.y, o.z)});
    };
    for (const ToolStaple& staple : pass.action_state.staple) {
        const uint32_t group = find_link_group(pass.links, staple.group);
        if (group == kNone) continue;
        const LinkGroup& g = pass.links.group[group];
        for (uint32_t link = g.links.first; link < g.links.end(); ++link) {
            if (!pass.links.whole[link]) continue;
            add(g.body, pass.links.node[link]);
            if (is_deformable(s.bodies, g.holder)) add(g.holder, pass.links.far_node[link]);
        }
    }
}

bool is_stapled(const FluidPass& pass, uint32_t body, uint32_t vertex, double reach, std::span<const StapledPlace> places) {
    return std::ranges::any_of(places, [&](const StapledPlace& p) {
        return p.body == body && (vertex_position(pass.surfaces, body, vertex) - p.at).norm() <= reach;
    });
}

// Of a point of a contact or the point of a triangle that it is on: the part of its force that some vertices bear.
template <size_t N>
double part_at(std::span<const uint32_t> spots, const std::array<uint32_t, N>& vertex, const std::array<double, N>& weight) {
    double sum = 0;
    for (size_t k = 0; k < N; ++k)
        if (weight[k] != 0 && std::ranges::find(spots, vertex[k]) != spots.end()) sum += weight[k];
    return sum;
}

// Mean pressure of what touches a wound in this pass, Pa.
double pressure_on(const FluidPass& pass, const Wound& wound, uint32_t body) {
    const ContactConstraints& rows = pass.constraints;
    const auto spots = std::span(pass.fluids.spot).subspan(wound.spots.first, wound.spots.count);
    double impulse = 0;
    for (size_t i = 0; i < rows.body.size(); ++i) {
        if (rows.body[i] == rows.other[i] || (rows.body[i] != body && rows.other[i] != body)) continue;
        const double along = static_cast<double>(rows.along[i]), across = static_cast<double>(rows.across[i]);
        const std::array<double, 3> on_triangle{rows.weight[i][0], rows.weight[i][1], rows.weight[i][2]};
        const double part = rows.body[i] == body ? part_at<3>(spots, {rows.vertex[i][0], rows.vertex[i][1], rows.third[i]},
                                                              {1 - along - across, along, across})
                                                 : part_at<3>(spots, rows.triangle[i], on_triangle);
        if (part > 0) impulse += part * std::abs(rows.impulse[i].dot(direction_to_world(pass.surfaces, rows.other[i], rows.normal[i])));
    }
    return impulse / (pass.seconds * wound.area);
}

// Lets blood out at a vertex of a film.
void bleed_at(const FilmBody& film, uint32_t vertex, double volume, FluidState& state) {
    state.volume[film.cells.first + vertex] += volume, state.blood[film.cells.first + vertex] += volume;
    state.ledger.bled += volume;
}

void bleed_wound(const FluidPass& pass, uint32_t index, std::span<const StapledPlace> stapled, FluidState& state) {
    const Wound& wound = pass.fluids.wound[index];
    const FilmBody& film = pass.fluids.body[wound.film];
    state.bleeding[index] = 0;
    double volume = wound.rate * open_time(pass, wound);
    if (!(volume > 0) || is_off(pass.node_state, film.body)) return;
    if (wound.pressure > 0) volume *= std::max(0.0, 1 - pressure_on(pass, wound, film.body) / wound.pressure);
    for (uint32_t i = wound.spots.first; i < wound.spots.end() && volume > 0; ++i) {
        const uint32_t vertex = pass.fluids.spot[i];
        const double part = volume * pass.fluids.share[i] * unburnt(pass, film.body, vertex);
        if (!(part > 0) || is_stapled(pass, film.body, vertex, wound.reach, stapled)) continue;
        bleed_at(film, vertex, part, state);
        state.bleeding[index] += part / pass.seconds;
    }
}

// Edges that instruments opened in this pass bleed from now on.
void open_vessels(const FluidPass& pass, FluidState& state) {
    for (const OpenedEdge& edge : pass.action_state.opened) {
        const double rate = pass.actions.action[edge.action].bleeding;
        const uint32_t film = find_film(pass.fluids, edge.body);
        if (!(rate > 0) || film == kNone || state.edge.size() >= pass.fluids.most_edges) continue;
        const Vec3d* position =
            pass.surfaces.meshes.position.data() + pass.surfaces.meshes.info[pass.surfaces.bodies.mesh[edge.body]].vertices.first;
        state.edge.push_back({film, edge.a, edge.b, rate * (position[edge.a] - position[edge.b]).norm()});
    }
}

void bleed_edges(const FluidPass& pass, std::span<const StapledPlace> stapled, FluidState& state) {
    constexpr double kReach = 2.5e-3;  // m, of a staple: half the crown of one of 5 mm
    for (const BleedingEdge& edge : state.edge) {
        const FilmBody& film = pass.fluids.body[edge.film];
        if (is_off(pass.node_state, film.body)) continue;
        for (const uint32_t v : {edge.a, edge.b}) {
            const double volume = 0.5 * edge.rate * pass.seconds * unburnt(pass, film.body, v);
            if (volume > 0 && !is_stapled(pass, film.body, v, kReach, stapled)) bleed_at(film, v, volume, state);
        }
    }
}

void bleed(const FluidPass& pass, std::vector<StapledPlace>& stapled, FluidState& state) {
    find_stapled(pass, stapled);
    for (uint32_t i = 0; i < pass.fluids.wound.size(); ++i) bleed_wound(pass, i, stapled, state);
    open_vessels(pass, state);
    bleed_edges(pass, stapled, state);
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
    const Vec3d up_local =
        is_deformable(pass.surfaces.bodies, film.body) ? up : rotate_back(pass.surfaces.poses.orientation[film.body], up);
    for (uint32_t v = 0; v < vertices.count; ++v) {
        const uint32_t cell = film.cells.first + v;
        if (!(state.volume[cell] > 0)) continue;
        const Vec3d from = local - vertex_in_frame(pass.surfaces, film.body, v);
        const double along = std::clamp(from.dot(up_local), 0.0, static_cast<double>(state.rise[cell]));
        if ((from - along * up_local).squaredNorm() <= reach * reach) scratch.cell.push_back(cell);
    }
}

// A cell that is sucked dry moves nothing more. Returns what is left of the volume, m^3.
double suck_films(const FluidPass& pass, const Vec3d& at, double reach, double volume, FluidSourcesScratch& scratch, FluidState& state) {
    scratch.cell.clear();
    for (const FilmBody& film : pass.fluids.body)
        if (!is_off(pass.node_state, film.body)) find_reached(pass, film, at, reach, state, scratch);
    double there = 0;
    for (const uint32_t cell : scratch.cell) there += state.volume[cell];
    if (!(there > 0)) return volume;
    const bool all = there <= volume;
    const double part = all ? 1 : volume / there;
    for (const uint32_t cell : scratch.cell) {
        const double liquid = all ? state.volume[cell] : part * state.volume[cell];
        const double blood = all ? state.blood[cell] : part * state.blood[cell];
        take(state.ledger, liquid, blood);
        state.volume[cell] -= liquid, state.blood[cell] -= blood;
    }
    return all ? volume - there : 0;
}

// Returns the volume of gas that goes with the liquid, m^3.
double suck(const FluidPass& pass, const ToolAction& action, FluidSourcesScratch& scratch, FluidState& state) {
    const Vec3d at = nozzle_of(pass, action).at;
    const double left = suck_drops(at, action.reach, action.rate * pass.seconds, state);
    return left > 0 ? suck_films(pass, at, action.reach, left, scratch, state) : 0;
}

}  // namespace

void run_sources(const FluidPass& pass, FluidSourcesScratch& scratch, FluidState& state) {
    bleed(pass, scratch.stapled, state);
    scratch.gas.assign(pass.actions.action.size(), 0.0);
    for (const ActionKind kind : {ActionKind::kIrrigate, ActionKind::kSuck}) {
        for (size_t i = 0; i < pass.actions.action.size(); ++i) {
            const ToolAction& action = pass.actions.action[i];
            if (action.kind != kind || !pass.action_state.progress[i].on) continue;
            if (kind == ActionKind::kIrrigate)
                irrigate(pass, action, state);
            else
                scratch.gas[i] = suck(pass, action, scratch, state);
        }
    }
    if (pass.fluids.most_puffs > 0) move_smoke(pass, scratch.gas, state);
}

}  // namespace trocar
