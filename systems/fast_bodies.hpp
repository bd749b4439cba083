#pragma once
#include <span>
#include <vector>

#include "components/fast_bodies.hpp"
#include "components/haptics.hpp"
#include "components/nodes.hpp"
#include "engine/contact_inputs.hpp"
#include "engine/first_touch.hpp"
namespace trocar {

struct FastBodiesInputs {
    double period;  // s
    Vec3d gravity;  // m/s^2
    const Surfaces& surfaces;
    std::span<const HandTool> tools;
    const DeviceSamples& devices;
    const NodeState& node_state;
};

// Finds hands on the way to where their devices will be, and free bodies, that come faster than contact rows look ahead: by
// boxes.speed farther than their margin. (A hand that tissue holds back from its device is not fast: rows hold it.) Their boxes
// are enlarged to cover their ways, so that they are paired with what lies there.
void find_fast_bodies(const FastBodiesInputs& in, std::vector<FastBody>& fast, BodyBoxes& boxes);

// stop[body] = the time (s after the start of the pass) at which a fast body first comes nearer than the tolerance to
// another one of its pairs that it does not touch yet, or infinity. Other bodies go on with the velocity they have at the
// start, without turning; deformable ones stay, and stop no hand. One row per body, none if no body is fast.
// `fast` ascends by body; `touch` is reused memory, one row per pair.
void find_stops(const ContactInputs& in, std::span<const FastBody> fast, std::vector<double>& touch, std::vector<double>& stop);

}  // namespace trocar
