#pragma once
#include <cstdint>
#include <vector>

#include "systems/advance/island/constraints.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// A free body while its constraints are swept, or what stands still, with inverse mass and inertia 0.
struct SweptBody {
    Vec4d velocity = {}, spin = {};  // m/s, rad/s, of the centre of mass
    Vec4d inv_inertia[3] = {};       // 1/(kg m^2), columns
    double inv_mass = 0;             // 1/kg
};

// A constraint between free bodies, or of one with what stands still: what sweeps need of PreparedConstraint, a third of its size,
// and the response to a unit impulse along the normal.
struct alignas(64) SweptConstraint {
    Vec4d normal;
    Vec4d arm[2];            // m
    Vec4d response;          // 1/kg, change of the relative velocity
    Vec4d friction_impulse;  // N s
    Vec4d friction_before, friction_direction;
    double normal_impulse, normal_before, normal_direction;  // N s
    double target_velocity, effective_mass, friction, friction_mass;
    uint32_t body[2];
    PreparedConstraint* from;
};

// Reused memory of sweeps over constraints of free bodies.
struct RigidSweeps {
    std::vector<SweptBody> body;                     // per free body of the island, and one that stands still
    std::vector<std::vector<SweptConstraint>> list;  // per group or per chunk of components
    bool all = false;                                // every active constraint of the island is_swept
};

}  // namespace trocar
#pragma GCC diagnostic pop
