#pragma once
#include "components/haptics.hpp"
namespace trocar {

// `v` no longer than `most`, its direction kept; zero where it is no number.
Vec3d limited_to(const Vec3d& v, double most);

// Most damping by which energy is taken back (N s/m), and the device's limit (N); of turning N m s/rad and N m.
struct Dissipation {
    double damping = 0;
    double most = 0;
};

// The two ends of a coupling: where the device is and how fast (m, m/s), and the proxy that it pulls.
struct CouplingEnds {
    Vec3d device, velocity, proxy;
};
// The same of turning, spin in rad/s.
struct TurningEnds {
    Quat device;
    Vec3d spin;
    Quat proxy;
};

// Energy that contact took from the hand so far (J), tick by tick of dt (s): E += (pull_before + pull) / 2 dx_proxy -
// F_before dx_device. A coupling has two ends, each with its force: the hand feels F (`contact_force`), held for a tick;
// what the proxy touches feels the coupling itself, `pull`, on its way. Where F is still on its way to the pull the two
// differ, and the difference counts. A coupling can only hold energy, so E below zero was made, by holding or by ramps. Then
// the force gains damping along the motion that takes it back within the tick, within `limits`: the passivity observer and
// controller of Hannaford & Ryu (IEEE Trans. Robotics and Automation 18(1), 2002) for the coupling's two ports, so that
// moving tissue may push the hand. Only what the limits leave of the damping counts as taken back. What is left of E at the
// end of a contact is forgotten unless it is a debt.
Vec3d dissipate(const Dissipation& limits, double dt, const CouplingEnds& ends, const Vec3d& pull, const Vec3d& contact_force,
                SafetyState& state);

// The same of the coupling between the turns of device and tool: torques (N m).
Vec3d dissipate_turning(const Dissipation& limits, double dt, const TurningEnds& ends, const Vec3d& pull, const Vec3d& contact_torque,
                        SafetyState& state);

// What the device is told in the end: `wanted` within its largest force and torque (scaled, direction kept), changing
// no faster than its slew limits from `output`; nothing at once where wanted is no number or `safe` is set. Stiffness
// shrinks with the force. Counts in `state`.
void limit_command(const DeviceLimits& limits, double max_force, double dt, bool safe, const DeviceCommand& wanted, SafetyState& state,
                   DeviceCommand& output);

}  // namespace trocar
