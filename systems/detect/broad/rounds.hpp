#pragma once
#include <span>

#include "components/contacts.hpp"
#include "components/device.hpp"
#include "components/haptics.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// A contact constraint is a plane at a point: a rigid body of size L that turns by s at its rim relative to another before contacts are
// found anew goes about s^2 / 2 L into what has no constraint yet. Passes with fast rigid bodies are therefore divided into rounds.

// How many pairs of bodies, counted over its rounds, a pass may look at to be divided: some seconds of a processor.
inline constexpr uint64_t kMostPairRounds = 1 << 17;

// Triangles that the pairs of free bodies may bring into a round, per triangle of a free body: 24 neighbours each, more than what
// does not overlap has.
inline constexpr uint64_t kMostNeighbours = 48;

// Whether a free body moves so far in `seconds` that a pass may need rounds. `fall`: m, displacement by gravity.
bool may_need_rounds(const Surfaces& surfaces, double fall, double tolerance, double seconds);

// Rounds of `seconds` that keep free bodies within about the tolerance (m) of other rigid ones. Hits turn bodies, so all of a relative
// velocity counts; of a pair that presses already (`pressed`: the contacts of the preceding round) only what closes it or turns.
uint32_t count_rounds(const Surfaces& surfaces, const BroadPhasePairs& pairs, const ContactMemory& pressed, double fall, double tolerance,
                      double seconds);

// Whether a hand goes faster than passes are made for, HapticParams::tool_speed, as its device moves or by itself.
bool any_fast_hand(std::span<const HandTool> tools, const DeviceSamples& devices, const Poses& poses);

// Rounds of at least 1 ms after which a hand that is fast and may meet tissue has gone no farther than the mean half thicknesses of
// both together: so far into it contacts are found on the side from which it came. (Bodies' volume over area; half of a sheet's
// thickness.) Rounds of 1 ms allow what a scene of a contact rate of 1 kHz would.
uint32_t count_hand_rounds(const Surfaces& surfaces, const BroadPhasePairs& pairs, const Haptics& haptics, const DeviceSamples& devices);

// Leaves out pairs of moving rigid bodies beyond kMostNeighbours, others at another tick. Returns how many.
uint64_t defer_pairs(const Surfaces& surfaces, uint64_t tick, BroadPhasePairs& pairs);

}  // namespace trocar
