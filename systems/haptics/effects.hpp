#pragma once
#include <span>

#include "components/haptic_effect.hpp"
#include "engine/haptics/local_contact_model.hpp"
namespace trocar {

// State of the tool that an effect depends on at one tick.
struct EffectInput {
    double age = 0;                      // s, since the effect started
    double dt = 1e-3;                    // s, until the next tick
    Vec3d position = Vec3d::Zero();      // m
    Vec3d velocity = Vec3d::Zero();      // m/s
    Vec3d acceleration = Vec3d::Zero();  // m/s^2
    bool near_surface = false;           // kMagnet: a surface is within reach
    Vec3d to_surface = Vec3d::Zero();    // unit, from the tip to its nearest point
    double gap = 0;                      // m, between tip and surface; 0 in contact
};

// Force of one effect (N, on the hand); the closed forms are documented with each kind in
// components/haptic_effect.hpp. Springs fade in over `rise_time`, so that one that starts far away has a small
// force at first. An impulse gives at each tick the mean of its half sine over the tick, so that the sum of
// force times dt is exactly `impulse`.
Vec3d effect_force(const HapticEffect& effect, double rise_time, const EffectInput& input);
// Negative gradient of that force (N/m, row-major): symmetric, positive semidefinite.
std::array<double, 9> effect_stiffness(const HapticEffect& effect);

// Starts and stops the effects of one tool by its clock, buttons and contacts; `state`: one per effect.
struct EffectTriggers {
    double time = 0;  // s, now
    uint32_t buttons = 0, buttons_before = 0;
    bool touch = false, release = false;  // at this tick
};
void run_triggers(std::span<const HapticEffect> effects, const EffectTriggers& triggers, std::span<EffectState> state);

// Nearest surface of a local contact model to a point within `most` (m) of contact with a tip of that radius:
// fills the last three fields of `input`; near_surface stays false if there is none.
void find_near_surface(const LocalContactModel& model, double age, const Vec3d& point, double tip_radius, double most, EffectInput& input);

}  // namespace trocar
