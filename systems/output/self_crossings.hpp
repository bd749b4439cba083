#pragma once
#include "components/report.hpp"
#include "components/self_crossing.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Sheets, which fold easily, are looked at in each displayed frame, any other deformable body in one of so many: about once a
// second, for 1 to 3 % of the time of a soft organ.
inline constexpr uint64_t kFramesBetweenLooks = 32;

// Pairs of faces of a body that cross each other (count_crossing_faces); 0 if it is rigid.
uint64_t count_self_crossings(const Surfaces& surfaces, uint32_t body, CrossingFacesScratch& scratch);

// Counts them for the bodies whose turn it is in a displayed frame, and the most that one frame found: Report::self_crossings.
// Contact of a body that has crossed itself is wrong, and no other number tells. Sleeping bodies are left out: nothing of
// them changes. picture: number of the displayed frame.
void count_self_crossings(uint64_t picture, const Surfaces& surfaces, const Sleep& sleep, CrossingFacesScratch& scratch,
                          SelfCrossingCounts& counts, Report& report);

}  // namespace trocar
