#pragma once
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Point masses of every deformable body, one array per field; a body owns a range padded to a multiple of 16.
struct Particles {
    std::vector<Float4> offset;     // m, from the body's origin; w = inverse mass 1/kg, 0 = fixed or padding
    std::vector<float> velocity_x;  // m/s, half a step behind the offset (leapfrog)
    std::vector<float> velocity_y;
    std::vector<float> velocity_z;
    std::vector<double> last_dt;  // s, one per body: substep by half of which the velocities lag behind; 0 = not started
    TROCAR_FIELDS(offset, "m", velocity_x, "m/s", velocity_y, "m/s", velocity_z, "m/s", last_dt, "s");
};

// Sleeping bodies: one element per body, or empty where a scene disables sleep.
struct Sleep {
    std::vector<uint32_t> still;  // ms for which the body has been slower than sleep_speed; 0 for rigid bodies
    std::vector<uint32_t> group;  // kNone = awake; else the root of the group of sleeping bodies with overlapping boxes
    TROCAR_FIELDS(still, "ms", group, "index of bodies or none");
};

// Anchors of deformable bodies: a spring of rest length zero from a particle to its goal. Constant after load.
struct Anchors {
    std::vector<float> stiffness;  // N/m, one per particle; 0 = none
    std::vector<float> rest_x;     // m, goal of the particle: kWorld from the body's origin, world axes;
    std::vector<float> rest_y;     //    kShape in the prototype's frame
    std::vector<float> rest_z;
    TROCAR_FIELDS(stiffness, "N/m", rest_x, "m", rest_y, "m", rest_z, "m");
};

}  // namespace trocar
