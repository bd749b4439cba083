#pragma once
#include <span>
#include <vector>

#include "components/device.hpp"
#include "components/fast_bodies.hpp"
#include "components/nodes.hpp"
#include "components/tool.hpp"
#include "engine/contact/contact_inputs.hpp"
#include "engine/distance/first_touch.hpp"
namespace trocar {

struct FastBodiesInputs {
    double period;  // s
    Vec3d gravity;  // m/s^2
    const Surfaces& surfaces;
    std::span<const HandTool> tools;
    const DeviceSamples& devices;
    const NodeState& node_state;
};

// Finds hands that follow their devices, and free bodies, whose displacement by boxes.speed exceeds their
// speculative margin. (A hand that tissue holds back from its device is not fast: constraints hold it.) Their
// boxes are enlarged to cover their paths, so that they are paired with bodies there.
void find_ccd_bodies(const FastBodiesInputs& in, std::vector<CcdBody>& ccd_bodies, BodyBoxes& boxes);

// Continuous collision detection. time_of_impact[body] (s from the start of the pass): when a fast body first
// comes nearer than the tolerance to a body of its pairs that it does not touch yet, or infinity. Other
// bodies keep their velocity without rotation; deformable ones rest, and stop no hand. One per body, none if
// no body is fast. `ccd_bodies` ascends by body; `pair_time_of_impact` is scratch.
void find_times_of_impact(const ContactInputs& in, std::span<const CcdBody> ccd_bodies, std::vector<double>& pair_time_of_impact,
                          std::vector<double>& time_of_impact);

}  // namespace trocar
