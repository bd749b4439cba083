#pragma once
#include "components/haptics.hpp"
namespace trocar {

// One tick of a hand that means to be at `intended` (position and velocity) and is pushed by `force` (N, held for the
// tick, as a motor does): mass a = force + stiffness (intended - x) + arm_damping (v_intended - v) - damping v -
// friction v/|v|, friction up to what stops it. The force acts `delay` ticks later. Solved in eight Strang steps a tick
// (half drift, kick with the damping's exact exponential, half drift): exact without springs but for friction, of
// second order with them. The first call places the hand where it means to be.
void step_hand(const HandModel& hand, const DeviceState& intended, const Vec3d& force, double dt, HandModelState& state);

// What the device under that hand reports: buttons, grip and orientation as intended, the position through the encoder
// (rounded to its step), the velocity from it with a first-order filter of 5 ms; exact without an encoder.
DeviceState hand_device_state(const HandModel& hand, const DeviceState& intended, const HandModelState& state);

}  // namespace trocar
