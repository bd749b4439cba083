#pragma once
#include <array>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// A hand and arm that follow a path and yield to forces: a mass on a spring and damper to the intended
// position. mass = 0: forces do not move the hand.
struct HandModel {
    double mass = 0;         // kg, of hand and device
    double damping = 0;      // N s/m, of the device
    double stiffness = 0;    // N/m, of the arm
    double arm_damping = 0;  // N s/m, of the arm
    double friction = 0;     // N, Coulomb, of the device
    double encoder = 0;      // m, step of the reported position; 0 = exact
    uint32_t delay = 0;      // ticks until a command acts, 0..7
    double tremor = 0;       // m, amplitude
    double tremor_rate = 9;  // Hz
    TROCAR_FIELDS(mass, "kg", damping, "N s/m", stiffness, "N/m", arm_damping, "N s/m", friction, "N", encoder, "m", delay, tremor, "m",
                  tremor_rate, "Hz");
};
inline constexpr uint32_t kMostHandDelay = 7;
struct HandModelState {
    bool placed = false;
    Vec3d position = Vec3d::Zero();  // m
    Vec3d velocity = Vec3d::Zero();  // m/s
    std::array<Vec3d, kMostHandDelay + 1> force{Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero(),
                                                Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero()};  // N, newest first
    Vec3d reported = Vec3d::Zero();                                                                           // m, through the encoder
    Vec3d reported_velocity = Vec3d::Zero();                                                                  // m/s
    TROCAR_FIELDS(placed, position, "m", velocity, "m/s", force, "N", reported, "m", reported_velocity, "m/s");
};

}  // namespace trocar
