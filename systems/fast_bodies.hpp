#pragma once
#include <span>
#include <vector>

#include "engine/contact_inputs.hpp"
#include "engine/first_touch.hpp"
namespace trocar {

// A rigid body that goes farther in a pass than contact rows look ahead, and its way in world axes.
struct FastBody {
    uint32_t body = kNone;
    RigidSweep sweep;
};

// Enlarges the boxes of fast bodies to cover their ways of `seconds`, so that they are paired with what lies there.
void cover_fast_ways(std::span<const FastBody> fast, double seconds, const Surfaces& surfaces, BodyBoxes& boxes);

// stop[body] = the time (s after the start of the pass) at which a fast body first comes nearer than the tolerance to
// another one of its pairs that it does not touch yet, or infinity. Other bodies go on with the velocity they have at the
// start, without turning; deformable ones stay, and stop no hand. One row per body, none if no body is fast.
// `fast` ascends by body; `touch` is reused memory, one row per pair.
void find_stops(const ContactInputs& in, std::span<const FastBody> fast, std::vector<double>& touch, std::vector<double>& stop);

}  // namespace trocar
