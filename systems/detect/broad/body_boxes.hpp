#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/device.hpp"
#include "components/nodes.hpp"
#include "components/spawning.hpp"
#include "components/tool.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

struct BodyBoxesInputs {
    double period = 0;  // s
    Surfaces surfaces;
    Vec3d gravity = Vec3d::Zero();           // m/s^2
    std::span<const HandTool> tools = {};    // whose bodies may get as fast as their devices
    const DeviceSamples* devices = nullptr;  // with tools
    const SpawnState* spawning = nullptr;    // empty slots get an empty box; or null
    const NodeState* node_state = nullptr;   // as do bodies of disabled nodes; or null
};

// World box of every body from its present vertices, enlarged by its speculative margin = displacement of the
// fastest vertex in the period, at most the root mean square displacement + half a mean edge and at most
// three mean edges, + 0.05 mean edge, plus half the thickness of a sheet. A rigid body's fastest vertex has
// boxes.speed + |omega| * radius, with boxes.speed = |v|, for a hand also the speed of its device, for a free
// body also what gravity adds in the period. One element per body; a body without a finite vertex gets an
// empty box. Non-finite vertices are skipped. Boxes and margins of bodies still asleep do not change. Returns how many soft (by root mean
// square speed) and scripted bodies move farther in the period than their margins: nothing sweeps them, so they may pass through others.
uint32_t compute_body_boxes(const BodyBoxesInputs& in, BodyBoxes& boxes, const SleepingBodies& sleeping_bodies = {});

}  // namespace trocar
