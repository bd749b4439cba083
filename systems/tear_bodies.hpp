#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/closest_point.hpp"
namespace trocar {

// Takes triangles of a shell away, by their numbers at load: the next pass goes on without them. Those that are gone already,
// or that there never were, change nothing.
void remove_triangles(const Tears& tears, uint32_t tear, std::span<const uint32_t> triangle, Torn& torn);

// What a pass does to bodies that tear.
struct TearPass {
    double now = 0;  // s, at the start of the pass
    Vec3d gravity = Vec3d::Zero();
    const Springs& springs;
    const Solids& solids;
    const Bodies& bodies;
    const Poses& poses;
    const Anchors& anchors;
};

// What is torn, and the books of it.
struct TearState {
    Torn& torn;
    TornSprings& torn_springs;
    Energy& energy;
    Report& report;
};

// Takes tetrahedra of a solid away, by their numbers in its prototype: they pull no more, and the next pass takes their mass
// and lays the faces behind them open. What they held leaves the energy. The last one stays.
void remove_tetrahedra(const TearPass& pass, const Particles& particles, const Tears& tears, uint32_t tear,
                       std::span<const uint32_t> tetrahedron, TearState state);

// Makes the cuts whose time has come, then brings the surfaces of bodies that tear to what torn says, whatever they
// were before: triangles, edges, neighbours, pieces, admission and tree of their prototypes, in the rows they have; no row of
// another body moves. A closed surface that is opened, or left without a manifold, counts as kWinding (inside is what it
// winds around) and in report.opened_bodies. Shells: springs along edges without a triangle left are broken, what they held
// leaves the energy; nodes keep their mass and anchors; a body keeps one triangle at least. Stable steps stay: fewer springs
// make no mode stiffer. Solids: see lose_mass and copy_torn_solid; their stable steps hold for whatever is left.
void cut_bodies(const TearPass& pass, Particles& particles, Meshes& meshes, std::span<std::unique_ptr<ClosestPointTree>> trees,
                Tears& tears, Sleep& sleep, TearState state);

// Brings the surfaces of bodies that tear to what the passes so far made of them, when the state was put back to the start of a
// pass: what tore in the last of them is left to cut_bodies, which books it. Nothing is booked here, and nobody wakes. What
// remove_triangles took since counts as taken in a pass.
void restore_torn_surfaces(const Solids& solids, const Bodies& bodies, const Particles& particles, const Torn& torn, Meshes& meshes,
                           std::span<std::unique_ptr<ClosestPointTree>> trees, Tears& tears);

// Springs and tetrahedra of all prototypes as what has torn left them: follows from the state in every pass.
void copy_torn_springs(const Springs& springs, const Solids& solids, const Bodies& bodies, const Tears& tears, const Torn& torn,
                       TornSprings& torn_springs);

}  // namespace trocar
