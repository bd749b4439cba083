#pragma once
#include "components/device.hpp"
#include "components/hand_model.hpp"
namespace trocar {

// One tick of a hand that intends to be at `intended` (position and velocity) and is pushed by `force` (N,
// held for the tick, as by a motor): mass a = force + stiffness (intended - x) + arm_damping (v_intended - v)
// - damping v - friction v/|v|, friction up to the value that stops it. The force acts `delay` ticks later.
// Solved in eight Strang steps per tick (half drift, kick with the damping's exact exponential, half drift):
// exact without springs except for friction, second order with them. The first call starts at `intended`.
void step_hand(const HandModel& hand, const DeviceState& intended, const Vec3d& force, double dt, HandModelState& state);

// Sample of the device in that hand: buttons, grip and orientation as intended, the position through the
// encoder (rounded to its step), the velocity from it by a first-order filter of 5 ms; else exact.
DeviceState hand_device_state(const HandModel& hand, const DeviceState& intended, const HandModelState& state);

}  // namespace trocar
