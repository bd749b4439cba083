#pragma once
#include "tests/systems/contact_scene.hpp"
namespace trocar::bench {

// Deepest point of one body's surface inside another, by dividing triangles best first: the distance to a surface
// changes by no more than the way (it is 1-Lipschitz), so a triangle holds nothing deeper than its middle's depth + its radius.
struct DeepestPoint {
    double depth = 0;  // m, found
    double slack = 0;  // m, nothing is deeper than depth + slack
};

// Thesis depth of the surfaces of bodies 0 and 1 (both ways), to `tolerance` m unless more than `most` pieces are needed.
DeepestPoint surface_depth(const test::ContactScene& scene, double tolerance, size_t most);

// The same with equally spaced samples of every triangle whose box meets the other body's box, no farther apart than
// sqrt(3) * tolerance, so that no more than the tolerance is missed.
double sampled_depth(const test::ContactScene& scene, double tolerance);

}  // namespace trocar::bench
