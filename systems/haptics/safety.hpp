#pragma once
#include "components/device.hpp"
#include "components/tool_state.hpp"
#include "systems/haptics/contact/device_motion.hpp"
namespace trocar {

// Largest damping that takes energy back (N s/m), and the device's limit (N); for rotation N m s/rad and N m.
struct Dissipation {
    double damping = 0;
    double most = 0;
};

// The two ends of a coupling: position and velocity of the device (m, m/s), and the proxy that it pulls.
struct CouplingEnds {
    Vec3d device, velocity, proxy;
};
// The same for rotation, spin in rad/s.
struct TurningEnds {
    Quat device;
    Vec3d spin;
    Quat proxy;
};

// Energy (J) that contact has taken from the hand, updated each tick of dt (s): E += (pull_before + pull) / 2
// dx_proxy - F_before dx_device. The two ends of a coupling have different forces: the hand feels F
// (`contact_force`), held for a tick; the proxy feels the virtual coupling force itself, `pull`. While F
// still approaches the pull they differ, and the difference counts. A coupling can only store energy, so E
// below zero was generated, by sample-and-hold or by ramps. Damping along the motion is then added to take it
// back, within `limits`: the passivity observer and controller of Hannaford & Ryu (IEEE Trans. Robotics and
// Automation 18(1), 2002) for the two ports of the coupling, so that moving tissue may push the hand. F includes
// that damping: what it took back shows in the positions that the device reports next, not in a velocity, which
// encoder steps and filters distort. A positive E at the end of a contact is discarded; a debt is kept.
Vec3d dissipate(const Dissipation& limits, double dt, const CouplingEnds& ends, const Vec3d& pull, const Vec3d& contact_force,
                SafetyState& state);

// The same for the coupling between the rotations of device and tool: torques (N m).
Vec3d dissipate_turning(const Dissipation& limits, double dt, const TurningEnds& ends, const Vec3d& pull, const Vec3d& contact_torque,
                        SafetyState& state);

// Final device command: `wanted` within its largest force and torque (scaled, direction kept), changing from
// `output` no faster than its slew limits; zero at once if wanted is not finite or `safe` is set. Stiffness
// shrinks with the force. Counts in `state`.
void limit_command(const DeviceLimits& limits, double max_force, double dt, bool safe, const DeviceCommand& wanted, SafetyState& state,
                   DeviceCommand& output);

}  // namespace trocar
