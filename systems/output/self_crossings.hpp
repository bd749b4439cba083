#pragma once
#include "components/report.hpp"
#include "components/self_crossing.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// In a displayed frame so many leaves of eight faces are looked at, an eighth of them all if that is more, in turn: a scene of
// up to 4,096 deforming faces is counted whole in each frame, any face of a larger one about four times a second.
inline constexpr uint32_t kLeavesOfAFrame = 512, kFramesOfARound = 8;

// Counts the pairs of faces of every deformable body that cross each other (count_crossing_faces) among the faces whose turn
// it is, and the most that one frame found: Report::self_crossings. Contact of a body that has crossed itself is wrong, and
// no other number tells. Sleeping bodies are left out: they were looked at while they moved. picture: number of the displayed frame.
void count_self_crossings(uint64_t picture, const Surfaces& surfaces, const Sleep& sleep, CrossingFacesScratch& scratch,
                          SelfCrossingCounts& counts, Report& report);

}  // namespace trocar
