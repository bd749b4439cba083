#pragma once
#include "components/device.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
#include "engine/haptics/local_contact_model.hpp"
namespace trocar {

// `v` shortened to at most `most`, direction kept; zero if not finite.
Vec3d limited_to(const Vec3d& v, double most);

// Accepts the sample into state.device, or rejects and counts it: not finite, out of order, farther or faster
// than a hand can move. A rejected sample leaves the device at its last position.
bool take_sample(const HapticParams& params, const DeviceState& sample, ToolState& state);

// The device with the velocity estimated from its positions of the last milliseconds, because the velocity in
// a sample is only as good as the device driver.
DeviceState foretold(const ToolState& state);

// Fraction of the force let through after `elapsed` more seconds: zero after a rejected sample, falling while
// sample or model are stale, else rising to one.
double next_gain(const HapticParams& params, const DeviceLimits& limits, bool accepted, double sample_age, double model_age, double elapsed,
                 double gain);

// Compliance prediction: displacement (m) of a pressed surface beyond its own velocity, with the device there
// at `time` (s): a fraction of the device's deviation from its motion at the contact pass.
Vec3d surface_follow(const HapticParams& params, const SurfaceCompliance& compliance, const Vec3d& device, double time);

}  // namespace trocar
