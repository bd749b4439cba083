#pragma once
#include "engine/fluid/film.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// Elements that a prototype may have after cuts; less than it has are as many.
struct FilmRoom {
    uint32_t vertices = 0, edges = 0;
    bool changes = false;  // its triangles may change
};

// Lets a body be wet; call in the order of the bodies. All that its film needs while it runs is reserved here.
void add_film(const Meshes& meshes, uint32_t prototype, uint32_t body, const FilmRoom& room, Fluids& fluids, FluidState& state);

// Edges and conductances of a film by the triangles that its prototype has; the liquid stays where it is and stands still.
void connect_film(const Meshes& meshes, uint32_t prototype, const FilmBody& film, FluidState& state);
uint64_t hash_triangles(std::span<const Triangle> triangles);

// Room for so many drops, puffs of smoke and bleeding edges.
void reserve_drops(uint32_t count, uint32_t puffs, uint32_t edges, Fluids& fluids, FluidState& state);

// A wound over the vertices within `radius` of a point (frame of the body at load), in proportion to the area of their cells; if there
// are none, over the corners of the triangle nearest to it. Its rate and times are left to the caller.
Wound place_wound(const Meshes& meshes, uint32_t prototype, uint32_t film, const Vec3d& point, double radius, Fluids& fluids);

// Shares of a triangle's corners in a point of it: not negative, of sum 1.
std::array<double, 3> corner_shares(const Vec3d& point, const Vec3d& a, const Vec3d& b, const Vec3d& c);

// The part of the state and the constant data of one wet body; and the index of a body's film, kNone if it has none.
Film film_of(const Fluids& fluids, FluidState& state, uint32_t film);
uint32_t find_film(const Fluids& fluids, uint32_t body);

}  // namespace trocar
