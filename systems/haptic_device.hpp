#pragma once
#include "components/haptics.hpp"
namespace trocar {

// Takes the sample into state.device, or refuses and counts it: not finite, out of order, farther or faster than a hand can
// move. The device stays where it was then.
bool take_sample(const HapticParams& params, const DeviceState& sample, ToolState& state);

// The device with the velocity that its places of the last milliseconds say: a sample's own is as good as its sender.
DeviceState foretold(const ToolState& state);

// Share of the force let through after `elapsed` more seconds: none after a refused sample, falling while sample or model
// are stale, else rising to one.
double next_gain(const HapticParams& params, const DeviceLimits& limits, bool accepted, double sample_age, double model_age, double elapsed,
                 double gain);

// How far (m) the surface that gives way is beyond where its velocity alone takes it, with the device there at `time` (s):
// the share of what the device went otherwise than it did at the pass.
Vec3d surface_follow(const HapticParams& params, const SurfaceGive& give, const Vec3d& device, double time);

}  // namespace trocar
