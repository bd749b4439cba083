#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/fields.hpp"
namespace trocar {

// Bodies that are stepped coarsely while nobody works on them or looks at them closely; one row per body that asks for it.
// Constant. Which of the two steppings a pass takes stands in Bodies::stepping, chosen anew each pass from nothing but the
// state, so that it belongs to no state itself.
struct DetailRules {
    std::vector<uint32_t> body;  // ascending
    std::vector<double> beyond;  // m, from the box of the body to the nearest tip of a tool, and to the eye
    std::vector<uint8_t> seen;   // whether the eye counts
    std::vector<Stepping> near;  // leapfrog
    std::vector<Stepping> far;   // midpoint
    std::vector<Vec3d> eye;      // m, of the scene's camera; one, or none where no body asks for it
    TROCAR_FIELDS(body, "row of bodies", beyond, "m", seen, near, far, eye, "m");
};

}  // namespace trocar
