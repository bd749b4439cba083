#pragma once
#include <vector>

#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// The front lens of a laparoscope, which fogs while it is colder than the dew point of the air around it.
struct Lens {
    // constant after load
    uint32_t body = kNone;         // that holds it
    Vec3d point = Vec3d::Zero();   // m, body frame
    double cavity = 37;            // degrees Celsius, of the air
    double humidity = 0.95;        // of the air, relative
    double time_constant = 60;     // s, with which the lens takes the temperature of the air
    double transfer = 8e-3;        // m/s, of vapour between air and lens
    double half_clear = 1.4e-6;    // m, film that scatters half of the light
    double wipe = 1e-3;            // m, tissue nearer than this wipes it
    // state
    double temperature = 21;  // degrees Celsius
    double film = 0;          // m, of water
    bool touching = false;    // was wiped in the last pass
    uint64_t wipes = 0;
    TROCAR_FIELDS(body, "index of bodies", point, "m", cavity, "C", humidity, time_constant, "s", transfer, "m/s", half_clear, "m", wipe,
                  "m", temperature, "C", film, "m", touching, wipes);
};

// Of the laparoscope that the camera is; none where it does not fog.
struct Lenses {
    std::vector<Lens> lens;
    TROCAR_FIELDS(lens);
};

}  // namespace trocar
