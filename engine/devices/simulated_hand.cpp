#include "engine/devices/simulated_hand.hpp"

#include <cmath>

#include "engine/base/check.hpp"
namespace trocar {
namespace {

constexpr int kParts = 8;                 // of a tick
constexpr double kVelocityFilter = 5e-3;  // s

// Velocity after `dt` under a constant force and damping; then Coulomb friction, which stops but never reverses.
Vec3d kicked(const HandModel& hand, const Vec3d& velocity, const Vec3d& force, double dt) {
    const double damping = hand.damping + hand.arm_damping, rate = damping / hand.mass;
    const double kept = std::exp(-rate * dt);
    const double gained = rate > 0 ? -std::expm1(-rate * dt) / damping : dt / hand.mass;
    Vec3d v = kept * velocity + gained * force;
    const double speed = v.norm(), lost = hand.friction / hand.mass * dt;
    return speed <= lost ? Vec3d(Vec3d::Zero()) : Vec3d(v * (1 - lost / speed));
}

void report(const HandModel& hand, double dt, HandModelState& state) {
    if (hand.encoder <= 0) {
        state.reported = state.position;
        state.reported_velocity = state.velocity;
        return;
    }
    Vec3d rounded;
    for (int k = 0; k < 3; ++k) rounded[k] = hand.encoder * std::nearbyint(state.position[k] / hand.encoder);
    const double share = -std::expm1(-dt / kVelocityFilter);
    state.reported_velocity += share * ((rounded - state.reported) / dt - state.reported_velocity);
    state.reported = rounded;
}

}  // namespace

void step_hand(const HandModel& hand, const DeviceState& intended, const Vec3d& force, double dt, HandModelState& state) {
    TROCAR_ASSERT(hand.mass > 0 && dt > 0 && hand.delay <= kMostHandDelay);
    if (!state.placed) {
        state = {};
        state.placed = true;
        state.position = state.reported = intended.position;
        state.velocity = intended.velocity;
        report(hand, dt, state);
        return;
    }
    for (uint32_t k = kMostHandDelay; k > 0; --k) state.force[k] = state.force[k - 1];
    state.force[0] = force.allFinite() ? force : Vec3d(Vec3d::Zero());
    const Vec3d acting = state.force[hand.delay];
    const double part = dt / kParts;
    // the path goes straight to the intended position at the end of the tick
    const Vec3d goal_begin = intended.position - dt * intended.velocity;
    for (int k = 0; k < kParts; ++k) {
        const Vec3d goal = goal_begin + (k + 0.5) * part * intended.velocity;
        state.position += 0.5 * part * state.velocity;
        const Vec3d pull = acting + hand.stiffness * (goal - state.position) + hand.arm_damping * intended.velocity;
        state.velocity = kicked(hand, state.velocity, pull, part);
        state.position += 0.5 * part * state.velocity;
    }
    report(hand, dt, state);
}

DeviceState hand_device_state(const HandModel& hand, const DeviceState& intended, const HandModelState& state) {
    DeviceState device = intended;
    if (hand.mass <= 0 || !state.placed) return device;
    device.position = state.reported;
    device.velocity = state.reported_velocity;
    return device;
}

}  // namespace trocar
