#pragma once
#include <string>

#include "components/contacts.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// What a scene sets for the whole run.
struct SceneSettings {
    std::string name;
    std::string description;
    double seconds = 3;                  // s, default length of a run
    Vec3d gravity = Vec3d(0, 0, -9.81);  // m/s^2
    double substep = 1e-3;               // s, largest explicit step; the computed limit may be smaller
    double sleep_speed = 1e-4;           // m/s, root mean square: an island of slower bodies falls asleep; 0 = never
    double sleep_after = 0.5;            // s, time below that speed
    ContactParams contact;
    bool render = true;
    TROCAR_FIELDS(gravity, "m/s^2", substep, "s", sleep_speed, "m/s", sleep_after, "s", contact);
    TROCAR_OTHER_FIELDS(name, description, seconds, render);
};

}  // namespace trocar
