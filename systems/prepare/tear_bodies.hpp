#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/actions.hpp"
#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/distance/closest_point.hpp"
namespace trocar {

// Removes triangles of a shell, given by their numbers at load, from the next pass on. Absent or nonexistent
// triangles are ignored.
void remove_triangles(const Tears& tears, uint32_t tear, std::span<const uint32_t> triangle, Torn& torn);

// Inputs of tearing in a contact pass.
struct TearPass {
    double now = 0;  // s, at the start of the pass
    Vec3d gravity = Vec3d::Zero();
    const Springs& springs;
    const Solids& solids;
    const Bodies& bodies;
    const Poses& poses;
    const Anchors& anchors;
};

// What is torn, with its energy accounting.
struct TearState {
    Torn& torn;
    TornSprings& torn_springs;
    Energy& energy;
    Report& report;
};

// Removes tetrahedra of a solid, given by their numbers in its prototype: their elastic forces end at once;
// the next pass removes their mass and exposes the faces behind them. Their elastic energy leaves the
// accounting. The last tetrahedron always stays.
void remove_tetrahedra(const TearPass& pass, const Particles& particles, const Tears& tears, uint32_t tear,
                       std::span<const uint32_t> tetrahedron, TearState state);

// Removes what cautery has boiled away, of bodies that part: triangles of a shell and tetrahedra of a solid all of whose nodes have
// lost their water. Where triangles that stay would hang together by a vertex alone, so that its rim were not manifold, only the
// largest fan of them stays. Before cut_bodies.
void part_what_boiled(const TearPass& pass, const Actions& actions, const HeatState& heat, const Particles& particles,
                      const Meshes& meshes, const Tears& tears, TearState state);

// Makes the cuts that are due, then updates the surfaces of bodies that tear from `torn`, whatever they were
// before: triangles, edges, neighbours, pieces, admission and tree of their prototypes, in their reserved
// elements, so that no other body's element moves. A closed surface that is opened, or becomes non-manifold,
// counts as kWinding (inside by winding number) and in report.opened_bodies.
// Shells: springs along edges without a triangle break, and their energy leaves the accounting; nodes keep
// their mass and anchors; at least one triangle stays. Stable steps are unchanged: fewer springs make no mode
// stiffer. Solids: see lose_mass and copy_torn_solid; their stable steps are valid for every remainder.
void cut_bodies(const TearPass& pass, Particles& particles, Meshes& meshes, std::span<std::unique_ptr<ClosestPointTree>> trees,
                Tears& tears, Sleep& sleep, TearState state);

// Rebuilds the surfaces of bodies that tear when the state was set back to the start of a pass. What tore in
// the last pass is left to cut_bodies, which accounts for its energy. This function accounts for none and
// wakes no body. Triangles given to remove_triangles since then count as removed in a pass.
void restore_torn_surfaces(const Solids& solids, const Bodies& bodies, const Particles& particles, const Torn& torn, Meshes& meshes,
                           std::span<std::unique_ptr<ClosestPointTree>> trees, Tears& tears);

// Springs and tetrahedra of all prototypes after tearing: derived from the state in every pass.
void copy_torn_springs(const Springs& springs, const Solids& solids, const Bodies& bodies, const Tears& tears, const Torn& torn,
                       TornSprings& torn_springs);

}  // namespace trocar
