#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/closest_point.hpp"
namespace trocar {

// Takes triangles away, by their numbers at load: the next pass goes on without them. Those that are gone already, or that
// there never were, change nothing.
void remove_triangles(const Tears& tears, uint32_t tear, std::span<const uint32_t> triangle, Torn& torn);

// Makes the cuts whose time has come, then brings the surfaces of bodies that tear to what torn.triangle says, whatever they
// were before: triangles, edges, neighbours, pieces, admission and tree of their prototypes, in the rows they have; no row of
// another body moves. A closed surface that is opened counts as kWinding (inside is what it winds around) and in
// report.opened_bodies. Springs along edges without a triangle left are broken, what they held leaves the energy; nodes keep
// their mass and anchors. A body keeps one triangle at least. Stable steps stay: fewer springs make no mode stiffer.
// now: s, at the start of the pass.
void cut_bodies(double now, const Springs& springs, const Bodies& bodies, const Particles& particles, Meshes& meshes,
                std::span<std::unique_ptr<ClosestPointTree>> trees, Tears& tears, Torn& torn, Sleep& sleep, Energy& energy,
                Report& report);

// Springs of all prototypes as what has torn left them: worked out anew from the state in every pass.
void copy_torn_springs(const Springs& springs, const Torn& torn, TornSprings& torn_springs);

}  // namespace trocar
