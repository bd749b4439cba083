#pragma once
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::bench {

// Deepest point of one body's surface inside another, by best-first subdivision of triangles: depth is
// 1-Lipschitz, so no point of a triangle is deeper than its centre's depth + its radius.
struct DeepestPoint {
    double depth = 0;  // m, found
    double slack = 0;  // m, no point is deeper than depth + slack
};

// Thesis depth of the surfaces of bodies 0 and 1 (in both directions), to `tolerance` m or with `most` pieces.
DeepestPoint surface_depth(const test::ContactScene& scene, double tolerance, size_t most);

// The same by equally spaced samples of every triangle whose box overlaps the other body's box, at most
// sqrt(3) * tolerance apart, so that the error is at most the tolerance.
double sampled_depth(const test::ContactScene& scene, double tolerance);

}  // namespace trocar::bench
