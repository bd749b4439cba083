#pragma once
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// One key of a scripted motion.
struct Keyframe {
    double time = 0;                 // s
    Vec3d position = Vec3d::Zero();  // m
    Quat orientation;
    uint64_t jump = 0;  // 1 = a jump at this time instead of motion from the preceding key
    double grip = 0;    // rad, of a device
    TROCAR_FIELDS(time, "s", position, "m", orientation, jump, grip, "rad");
};

// Scripted motions of kinematic bodies. Constant after load.
struct Paths {
    std::vector<uint32_t> body;  // one per path
    std::vector<Range> keys;     // one per path: range of key
    std::vector<Keyframe> key;   // ascending in time within a path
    TROCAR_FIELDS(body, "index of bodies or none", keys, "range of keys", key);
};

}  // namespace trocar
