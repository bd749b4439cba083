#pragma once
#include "components/haptics.hpp"
namespace trocar {

// `v` no longer than `most`, its direction kept; zero where it is no number.
Vec3d limited_to(const Vec3d& v, double most);

// Energy that contact took from the hand so far (J), tick by tick: E += (F_before + F) / 2 dx_proxy - F_before dx_device.
// The device feels each force held for a tick; the proxy is ours, and its work is of the force on its way. A coupling
// between the two can only hold energy, so E below zero is made by holding. Then the force gains damping along the motion that takes it back
// within the tick, at most `dissipation` (N s/m): the passivity observer and controller of Hannaford & Ryu (IEEE Trans.
// Robotics and Automation 18(1), 2002) for the coupling's two ports, so that moving tissue may push the hand. What is left of E at the end of a contact is forgotten unless it is a debt.
Vec3d dissipate(double dissipation, double dt, const Vec3d& device, const Vec3d& velocity, const Vec3d& proxy,
                const Vec3d& contact_force, SafetyState& state);

// The same of the coupling between the turns of device and tool: torques (N m), `spin` of the device (rad/s), damping in
// N m s/rad.
Vec3d dissipate_turning(double dissipation, double dt, const Quat& device, const Vec3d& spin, const Quat& proxy,
                        const Vec3d& contact_torque, SafetyState& state);

// What the device is told in the end: `wanted` within its largest force and torque (scaled, direction kept), changing
// no faster than its slew limits from `output`; nothing at once where wanted is no number or `safe` is set. Stiffness
// shrinks with the force. Counts in `state`.
void limit_command(const DeviceLimits& limits, double max_force, double dt, bool safe, const DeviceCommand& wanted,
                   SafetyState& state, DeviceCommand& output);

}  // namespace trocar
