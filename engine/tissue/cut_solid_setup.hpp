#pragma once
#include <memory>
#include <span>

#include "components/actions.hpp"
#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/tissue/lattice_cut.hpp"
namespace trocar {

// Solids that instruments may cut (lattice_cut.hpp): elements reserved at load, and everything that follows from their pieces.

// Elements that a prototype gets in all, so that cuts may add `more` triangles to a surface of that many vertices and triangles.
struct CutSolidRoom {
    uint32_t nodes = 0, parts = 0, vertices = 0, triangles = 0, edges = 0;
};
CutSolidRoom room_for_solid_cuts(uint32_t nodes, uint32_t tetrahedra, uint32_t vertices, uint32_t triangles, uint32_t more);
// Reserves tetrahedra and columns for the prototype that was added last, a solid with that many nodes.
void widen_solid(const CutSolidRoom& room, uint32_t prototype, Springs& springs, Solids& solids);

// What add_cut_solid and the functions below change.
struct CutSolidArrays {
    Meshes& meshes;
    Springs& springs;
    Solids& solids;
    Anchors& anchors;
};
// Fills an element of cut_solid and its part of the state, once the body has particles; sets its stable step to one that holds for every
// cut: a part has its share of mass and stiffness, so the limit of single tetrahedra (update_tearing_solid_dt) is that of their parts.
// nodes, tetrahedra: of the lattice. wall: material of the new surface.
void add_cut_solid(const CutSolidRoom& room, uint32_t nodes, uint32_t tetrahedra, uint32_t wall, uint32_t body,
                   const CutSolidArrays& arrays, const Particles& particles, Bodies& bodies, Actions& actions, CutLattices& state);

Lattice lattice_of(const CutSolid& limits, const Actions& actions);
LatticePieces take_pieces(const CutSolid& limits, uint32_t index, const CutLattices& state);
// False if they need more elements than are reserved; then nothing changes.
bool put_pieces(const CutSolid& limits, uint32_t index, const LatticePieces& pieces, CutLattices& state);

// What follows from the present pieces of a solid, in the reserved elements: surface and its embedding, tetrahedra, springs, anchors and
// the volumes of nodes. False if there are too few columns or edges; then nothing changes.
bool lay_cut_solid(const CutSolid& limits, uint32_t index, const Actions& actions, const CutLattices& state, const Bodies& bodies,
                   const CutSolidArrays& arrays);

// Lays the pieces of all solids that may be cut, and makes their trees, where they are not those of the state: when it was set
// back to the start of a pass.
void restore_cut_solids(const Actions& actions, const CutLattices& state, const Bodies& bodies, const Particles& particles,
                        const CutSolidArrays& arrays, std::span<std::unique_ptr<ClosestPointTree>> trees);

}  // namespace trocar
