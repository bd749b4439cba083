#include "systems/fluid/drops.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/fluid/film_setup.hpp"
namespace trocar {
namespace {

// A place drips if the surface is steeper there than this: its cosine against level ground.
constexpr float kDrips = 0.1f;
// Steps of a drop along its path in a pass; one that still touches nothing goes on in the next.
constexpr int kMostSteps = 32;
// Area of the smallest cell at a rim that is looked at, in squares of a mean edge.
constexpr double kSmallestCell = 0.05;

double radius_of(double volume) { return std::cbrt(0.75 / std::numbers::pi * volume); }

bool is_on_open_rim(const MeshView& mesh, uint32_t vertex) {
    for (uint32_t i = mesh.incident_first[vertex]; i < mesh.incident_first[vertex + 1]; ++i) {
        const uint32_t t = mesh.incident[i];
        for (size_t k = 0; k < 3; ++k)
            if (mesh.neighbour[t][k] == kNone && (mesh.triangle[t][k] == vertex || mesh.triangle[t][(k + 1) % 3] == vertex)) return true;
    }
    return false;
}

// Whether liquid finds no lower place around a vertex.
bool is_lowest(const MeshView& mesh, const FilmShape& shape, std::span<const float> rise, uint32_t vertex) {
    const float own = shape.height[vertex] + rise[vertex];
    for (uint32_t i = mesh.incident_first[vertex]; i < mesh.incident_first[vertex + 1]; ++i)
        for (const uint32_t v : mesh.triangle[mesh.incident[i]])
            if (shape.height[v] + rise[v] < own) return false;
    return true;
}

// Liquid that is heavier than what can hang, or at a rim deeper than what stands there at a contact angle of a right angle,
// sqrt(2) capillary lengths, parts from the body and falls.
void detach(const FluidPass& pass, uint32_t index, double hanging, double standing, DropsScratch& scratch, FluidState& state) {
    const FilmBody& body = pass.fluids.body[index];
    const Film film = film_of(pass.fluids, state, index);
    const MeshView mesh = mesh_view(pass.surfaces.meshes, pass.surfaces.bodies.mesh[body.body]);
    const Vec3d down = down_of(pass.fluids.params.gravity);
    // of a closed surface no cell is at a rim
    const double smallest =
        mesh.info->admission == Admission::kSheet ? standing * kSmallestCell * mesh.info->mean_edge * mesh.info->mean_edge : hanging;
    const double least = std::min(hanging, smallest);
    bool known = false;
    for (uint32_t v = 0; v < mesh.position.size(); ++v) {
        if (!(film.volume[v] > least) || state.drops.volume.size() >= pass.fluids.most_drops) continue;
        FilmShape& shape = scratch.shapes.shape;
        if (!known) find_film_shape(pass.surfaces, body.body, body.cells.count, down, scratch.shapes.scratch, shape);
        known = true;
        const bool rim = is_on_open_rim(mesh, v),
                   heavy = film.volume[v] > hanging || (rim && film.volume[v] * shape.inverse_area[v] > standing);
        if (!heavy || (shape.upright[v] > kDrips && !rim) || !is_lowest(mesh, shape, film.rise, v)) continue;
        const double radius = radius_of(film.volume[v]);
        state.drops.position.push_back(vertex_position(pass.surfaces, body.body, v) + radius * down);
        state.drops.velocity.push_back(vertex_velocity(pass.surfaces, body.body, v));
        state.drops.volume.push_back(film.volume[v]), state.drops.blood.push_back(film.blood[v]);
        film.volume[v] = film.blood[v] = 0;
    }
}

// Boxes of the bodies that drops may land on; empty for those that are off.
void find_boxes(const FluidPass& pass, DropsScratch& scratch) {
    const Surfaces& s = pass.surfaces;
    scratch.box.assign(pass.fluids.body.size(), Box{});
    scratch.refitted.assign(pass.fluids.body.size(), 0);
    for (size_t i = 0; i < scratch.box.size(); ++i) {
        const uint32_t body = pass.fluids.body[i].body;
        if (is_off(pass.node_state, body)) continue;
        const MeshInfo& info = s.meshes.info[s.bodies.mesh[body]];
        if (is_deformable(s.bodies, body)) {
            for (uint32_t v = 0; v < info.vertices.count; ++v) grow(scratch.box[i], vertex_position(s, body, v));
            continue;
        }
        for (uint32_t k = 0; k < 8; ++k)
            grow(scratch.box[i], frame_to_world(s, body,
                                                {(k & 1 ? info.box.max : info.box.min).x(), (k & 2 ? info.box.max : info.box.min).y(),
                                                 (k & 4 ? info.box.max : info.box.min).z()}));
    }
}

// What a drop meets next: distance from its centre, index of the film.
struct Ahead {
    double distance = std::numeric_limits<double>::infinity();  // m
    uint32_t film = kNone;
    SurfacePoint point;
};

Ahead look_ahead(const FluidPass& pass, std::span<const std::unique_ptr<ClosestPointTree>> trees, const Vec3d& at, double reach,
                 DropsScratch& scratch) {
    const Surfaces& s = pass.surfaces;
    Ahead ahead;
    for (uint32_t i = 0; i < pass.fluids.body.size(); ++i) {
        const Box& box = scratch.box[i];
        if (((at.array() + reach) < box.min.array()).any() || ((at.array() - reach) > box.max.array()).any()) continue;
        const uint32_t body = pass.fluids.body[i].body;
        ClosestPointTree& tree = *trees[s.bodies.tree[body]];
        if (!std::exchange(scratch.refitted[i], uint8_t{1}) && is_deformable(s.bodies, body)) {
            const Range range = s.bodies.particles[body];
            tree.refit(std::span(s.particles.offset).subspan(range.first, range.count));
        }
        const SurfacePoint point = tree.query(world_to_frame(s, body, at), reach);
        if (point.triangle != kNone && point.distance < ahead.distance) ahead = {point.distance, i, point};
    }
    return ahead;
}

void land(const FluidPass& pass, const Ahead& ahead, size_t drop, FluidState& state) {
    const FilmBody& film = pass.fluids.body[ahead.film];
    const Triangle& t = mesh_view(pass.surfaces.meshes, pass.surfaces.bodies.mesh[film.body]).triangle[ahead.point.triangle];
    const auto corner = [&](size_t k) { return vertex_in_frame(pass.surfaces, film.body, t[k]); };
    const auto share = corner_shares(ahead.point.point, corner(0), corner(1), corner(2));
    double volume = state.drops.volume[drop], blood = state.drops.blood[drop];
    for (size_t k = 0; k < 3; ++k) {
        const bool last = k == 2;  // takes what rounding leaves
        const double part = last ? volume : share[k] * state.drops.volume[drop], dye = last ? blood : share[k] * state.drops.blood[drop];
        state.volume[film.cells.first + t[k]] += std::max(part, 0.0), state.blood[film.cells.first + t[k]] += std::max(dye, 0.0);
        volume -= part, blood -= dye;
    }
}

// Moves one drop along the chord of its path, by spheres that touch the nearest surface. True if it has landed or left the scene.
bool fly(const FluidPass& pass, std::span<const std::unique_ptr<ClosestPointTree>> trees, size_t drop, DropsScratch& scratch,
         FluidState& state) {
    const Vec3d path = pass.seconds * (state.drops.velocity[drop] + 0.5 * pass.seconds * pass.fluids.params.gravity);
    const double radius = radius_of(state.drops.volume[drop]), length = path.norm();
    Vec3d& at = state.drops.position[drop];
    double left = length;
    for (int step = 0; step < kMostSteps; ++step) {
        const Ahead ahead = look_ahead(pass, trees, at, left + radius, scratch);
        if (ahead.film != kNone && ahead.distance <= 0.5 * radius) {
            land(pass, ahead, drop, state);
            return true;
        }
        const double free = ahead.film == kNone ? left : std::min(left, std::max(ahead.distance - 0.5 * radius, 0.05 * radius));
        if (length > 0) at += free / length * path;
        left -= free;
        if (!(left > 0)) break;
    }
    state.drops.velocity[drop] += pass.seconds * pass.fluids.params.gravity;
    const Box& inside = pass.fluids.params.inside;
    if ((at.array() >= inside.min.array()).all() && (at.array() <= inside.max.array()).all()) return false;
    state.ledger.lost += state.drops.volume[drop], state.ledger.lost_blood += state.drops.blood[drop];
    return true;
}

}  // namespace

void move_drops(const FluidPass& pass, std::span<const std::unique_ptr<ClosestPointTree>> trees, DropsScratch& scratch, FluidState& state) {
    const double hanging = hanging_drop(pass.fluids.params, pass.fluids.params.gravity.norm());
    const double standing = std::numbers::sqrt2 * capillary_length(pass.fluids.params, pass.fluids.params.gravity.norm());
    for (uint32_t i = 0; i < pass.fluids.body.size(); ++i)
        if (!is_off(pass.node_state, pass.fluids.body[i].body)) detach(pass, i, hanging, standing, scratch, state);
    Drops& drops = state.drops;
    if (drops.volume.empty()) return;
    find_boxes(pass, scratch);
    size_t kept = 0;
    for (size_t i = 0; i < drops.volume.size(); ++i) {
        if (fly(pass, trees, i, scratch, state)) continue;
        drops.position[kept] = drops.position[i], drops.velocity[kept] = drops.velocity[i];
        drops.volume[kept] = drops.volume[i], drops.blood[kept] = drops.blood[i];
        ++kept;
    }
    drops.position.resize(kept), drops.velocity.resize(kept), drops.volume.resize(kept), drops.blood.resize(kept);
}

}  // namespace trocar
