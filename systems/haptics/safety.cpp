#include "systems/haptics/safety.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

constexpr double kFullTime = 3e-3;  // s, from zero to the largest force if no slew limit is given

// From `last` towards `wanted`, by at most `most`.
Vec3d moved_towards(const Vec3d& last, const Vec3d& wanted, double most) { return last + limited_to(wanted - last, most); }

bool is_finite(const DeviceCommand& c) {
    return c.force.allFinite() && c.torque.allFinite() && c.at.allFinite() &&
           std::all_of(c.stiffness.begin(), c.stiffness.end(), [](double k) { return std::isfinite(k); });
}

// `force` plus the damping that takes an energy debt back, within the limits.
Vec3d damped(const Dissipation& limits, double dt, const Vec3d& velocity, double least_speed2, const Vec3d& force, double energy,
             double& dissipated) {
    const double speed2 = velocity.squaredNorm();
    if (!(energy < 0 && force.squaredNorm() > 0 && speed2 > least_speed2 && limits.damping > 0)) return force;
    const Vec3d felt = limited_to(force - std::min(-energy / (dt * speed2), limits.damping) * velocity, limits.most);
    dissipated += std::max(0.0, (limited_to(force, limits.most) - felt).dot(velocity) * dt);
    return felt;
}

}  // namespace

Vec3d dissipate(const Dissipation& limits, double dt, const CouplingEnds& ends, const Vec3d& pull, const Vec3d& contact_force,
                SafetyState& state) {
    const auto& [device, velocity, proxy] = ends;
    if (!state.started) {
        state.started = true;
        state.from_device = device;
        state.from_proxy = proxy;
    }
    const Vec3d mean = 0.5 * (state.pull + pull);
    state.energy += mean.dot(proxy - state.from_proxy) - state.contact_force.dot(device - state.from_device);
    state.lowest_energy = std::min(state.lowest_energy, state.energy);
    state.from_device = device;
    state.from_proxy = proxy;
    state.pull = pull;
    const Vec3d force = state.contact_force = damped(limits, dt, velocity, 1e-12, contact_force, state.energy, state.dissipated);
    // out of contact a coupling stores nothing: energy lost to friction is no credit for the next touch
    if (contact_force.squaredNorm() == 0) state.energy = std::min(state.energy, 0.0);
    return force;
}

Vec3d dissipate_turning(const Dissipation& limits, double dt, const TurningEnds& ends, const Vec3d& pull, const Vec3d& contact_torque,
                        SafetyState& state) {
    const auto& [device, spin, proxy] = ends;
    const Vec3d mean = 0.5 * (state.pull_torque + pull);
    state.turn_energy +=
        mean.dot(rotation_vector(state.from_proxy_turn, proxy)) - state.contact_torque.dot(rotation_vector(state.from_device_turn, device));
    state.lowest_turn_energy = std::min(state.lowest_turn_energy, state.turn_energy);
    state.from_device_turn = device;
    state.from_proxy_turn = proxy;
    state.pull_torque = pull;
    const Vec3d torque = state.contact_torque = damped(limits, dt, spin, 1e-9, contact_torque, state.turn_energy, state.dissipated);
    if (contact_torque.squaredNorm() == 0) state.turn_energy = std::min(state.turn_energy, 0.0);
    return torque;
}

void limit_command(const DeviceLimits& limits, double max_force, double dt, bool safe, const DeviceCommand& wanted, SafetyState& state,
                   DeviceCommand& output) {
    if (safe || !is_finite(wanted)) {
        const Vec3d at = wanted.at.allFinite() ? wanted.at : output.at;
        output = {};
        output.at = at;
        ++state.safe_ticks;
        state.limiting = false;
        return;
    }
    const double force_slew = limits.force_slew > 0 ? limits.force_slew : max_force / kFullTime;
    const double torque_slew = limits.torque_slew > 0 ? limits.torque_slew : limits.torque / kFullTime;
    const Vec3d force = limited_to(wanted.force, max_force), torque = limited_to(wanted.torque, limits.torque);
    output.force = moved_towards(output.force, force, force_slew * dt);
    output.torque = moved_towards(output.torque, torque, torque_slew * dt);
    output.at = wanted.at;
    const double wanted_length = wanted.force.norm();
    const double share = wanted_length > 0 ? std::min(1.0, output.force.norm() / wanted_length) : 1;
    for (size_t k = 0; k < 9; ++k) output.stiffness[k] = share * wanted.stiffness[k];
    state.limiting = wanted_length > max_force || wanted.torque.norm() > limits.torque;
    state.limited_ticks += (output.force - wanted.force).squaredNorm() > 0 || (output.torque - wanted.torque).squaredNorm() > 0;
}

}  // namespace trocar
