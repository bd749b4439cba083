#pragma once
#include <memory>
#include <span>

#include "components/actions.hpp"
#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
#include "engine/distance/closest_point.hpp"
namespace trocar {

// Shells and sheets that instruments may cut: elements reserved at load, and everything that follows from a surface.

// Elements that a prototype gets beyond its own so that cuts may add `more` triangles.
struct CutRoom {
    uint32_t vertices = 0, triangles = 0, edges = 0;  // in all
};
CutRoom room_for_cuts(const MeshInfo& info, uint32_t more);
// Reserves them for the prototype that was added last.
void keep_cut_room(const CutRoom& room, Meshes& meshes);
// Reserves particles and columns for the springs of the prototype whose springs were added last. Returns the columns.
uint32_t widen_springs(const CutRoom& room, uint32_t prototype, Springs& springs);
// Fills an element of cut_body and its part of the surfaces, once the body has particles; sets its stable step to
// one that holds for every cut: springs of small triangles are softened as far as that takes.
void add_cut_body(const CutRoom& room, uint32_t columns, uint32_t body, const Meshes& meshes, Springs& springs, const Anchors& anchors,
                  Bodies& bodies, Actions& actions, CutSurfaces& cut);

// What follows from the present surface of a body that may be cut, in the reserved elements: triangles, edges,
// neighbours, pieces, springs and anchors. False if its springs need more columns than there are; then nothing changes.
bool lay_cut_surface(const CutBody& limits, uint32_t index, const CutSurfaces& cut, const Bodies& bodies, Meshes& meshes, Springs& springs,
                     Anchors& anchors);
// Copies a surface, the only prototype of `made`, into the reserved elements of a prototype.
void copy_cut_surface(const Meshes& made, uint32_t prototype, Meshes& meshes);
// Whether that is what the prototype has.
bool is_cut_surface_laid(const CutBody& limits, uint32_t index, const CutSurfaces& cut, const Bodies& bodies, const Meshes& meshes);

// Lays the surfaces of all bodies that may be cut, and makes their trees, where they are not those of the state:
// when it was set back to the start of a pass.
void restore_cut_surfaces(const Actions& actions, const CutSurfaces& cut, const Bodies& bodies, const Particles& particles, Meshes& meshes,
                          Springs& springs, Anchors& anchors, std::span<std::unique_ptr<ClosestPointTree>> trees);
void remake_tree(uint32_t body, const Bodies& bodies, const Particles& particles, const Meshes& meshes,
                 std::span<std::unique_ptr<ClosestPointTree>> trees);

}  // namespace trocar
