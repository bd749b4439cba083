#pragma once
#include "components/bodies.hpp"
#include "engine/sleepers.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// World box of every body from its present vertices, enlarged by its reach: margin = way of the fastest vertex in the
// period, at most the root mean square way + half a mean edge and at most three mean edges, + 0.05 mean edge (rigid: |v| +
// |omega| * radius, so the caller puts the coming speed of scripted bodies and hands into the poses), plus half the
// thickness of a sheet. One row per body; a body without a finite vertex gets an empty box. Non-finite vertices are skipped.
// period in s. Rows of seen sleepers stay as they are.
void compute_body_boxes(double period, const Surfaces& surfaces, BodyBoxes& boxes, const Sleepers& sleepers = {});

}  // namespace trocar
