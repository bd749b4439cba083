#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/haptics.hpp"
#include "components/lives.hpp"
#include "components/nodes.hpp"
#include "engine/sleepers.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

struct BodyBoxesInputs {
    double period = 0;  // s
    Surfaces surfaces;
    Vec3d gravity = Vec3d::Zero();           // m/s^2
    std::span<const HandTool> tools = {};    // their bodies may get as fast as their devices are, besides
    const DeviceSamples* devices = nullptr;  // with tools
    const Lives* lives = nullptr;            // empty slots get an empty box; or null
    const NodeState* node_state = nullptr;   // and so do bodies of disabled nodes; or null
};

// World box of every body from its present vertices, enlarged by its reach: margin = way of the fastest vertex in the
// period, at most the root mean square way + half a mean edge and at most three mean edges, + 0.05 mean edge, plus half the
// thickness of a sheet. Of a rigid body the fastest vertex has boxes.speed + |omega| * radius, with boxes.speed = |v|, of a
// hand also the speed of its device, of a free body also what gravity adds in the period. One row per body; a body without a
// finite vertex gets an empty box. Non-finite vertices are skipped. Boxes and margins of seen sleepers stay as they are.
void compute_body_boxes(const BodyBoxesInputs& in, BodyBoxes& boxes, const Sleepers& sleepers = {});

}  // namespace trocar
