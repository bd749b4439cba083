#pragma once
#include <string>
#include <vector>

#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::bench {

// Two bodies whose thesis depth is known in closed form for the smooth shapes. Lengths of about 50 mm.
struct ClosedFormPair {
    std::string name;
    std::vector<test::BodyInput> bodies;
    double depth = 0;       // m, thesis depth of the smooth surfaces
    double separation = 0;  // m, translational penetration depth of the smooth shapes; NaN without a closed form
};

// Tessellation levels 0 to 3; each halves the edge length.
std::vector<ClosedFormPair> closed_form_pairs(uint32_t level);

}  // namespace trocar::bench
