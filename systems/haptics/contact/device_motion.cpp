#include "systems/haptics/contact/device_motion.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

bool is_finite(const Quat& q) { return std::isfinite(q.w) && std::isfinite(q.x) && std::isfinite(q.y) && std::isfinite(q.z); }

// Whether a hand can have moved to this sample since the last accepted one.
bool is_plausible(const HapticParams& params, const DeviceState& sample, const ToolState& state) {
    const Quat& q = sample.orientation;
    if (!std::isfinite(sample.time) || !sample.position.allFinite() || !sample.velocity.allFinite() || !is_finite(q)) return false;
    if (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z < 1e-6) return false;
    if (sample.velocity.norm() > params.device_speed + params.device_slack / params.dt) return false;
    if (!state.device_valid) return true;
    const double elapsed = sample.time - state.device.time;
    const double distance = (sample.position - state.device.position).norm();
    return elapsed >= 0 && distance <= params.device_speed * elapsed + params.device_slack;
}

// Double exponential smoothing (LaViola, "Double exponential smoothing: an alternative to Kalman filter-based
// predictive tracking", 2003, section 3) of the velocity between two positions.
void follow_motion(const HapticParams& params, const DeviceState& sample, ToolState& state) {
    if (!state.device_valid) {
        state.motion = {sample.velocity, sample.velocity};
        return;
    }
    const double elapsed = sample.time - state.device.time;
    if (elapsed <= 0) return;
    const double share = -std::expm1(-elapsed / params.motion_filter);
    DeviceMotion& motion = state.motion;
    motion.once += share * ((sample.position - state.device.position) / elapsed - motion.once);
    motion.twice += share * (motion.once - motion.twice);
}

}  // namespace

Vec3d limited_to(const Vec3d& v, double most) {
    const double length = v.norm();
    if (!std::isfinite(length) || most <= 0) return Vec3d::Zero();
    // slightly below the limit, so that rounding never exceeds it
    return length > most ? Vec3d(v * (most * (1 - 1e-12) / length)) : v;
}

bool take_sample(const HapticParams& params, const DeviceState& sample, ToolState& state) {
    if (!is_plausible(params, sample, state)) {
        ++state.rejected_samples;
        return false;
    }
    follow_motion(params, sample, state);
    state.device = sample;
    state.device.orientation = normalized(sample.orientation);
    state.device_valid = true;
    return true;
}

DeviceState foretold(const ToolState& state) {
    DeviceState device = state.device;
    device.velocity = state.motion.velocity();
    return device;
}

double next_gain(const HapticParams& params, const DeviceLimits& limits, bool accepted, double sample_age, double model_age, double elapsed,
                 double gain) {
    if (!accepted) return 0;
    const double oldest = limits.surface_age > 0 ? limits.surface_age : params.model_timeout;
    const bool stale = model_age > oldest || sample_age > params.device_timeout;
    gain += stale ? -elapsed / params.fall_time : elapsed / params.rise_time;
    return std::clamp(gain, 0.0, 1.0);
}

Vec3d surface_follow(const HapticParams& params, const SurfaceCompliance& compliance, const Vec3d& device, double time) {
    if (compliance.body == kNone) return Vec3d::Zero();
    const double age = std::clamp(time - compliance.time, -params.greatest_age, params.greatest_age);
    const double distance = compliance.share * compliance.normal.dot(device - compliance.device - age * compliance.device_velocity);
    return std::clamp(distance, -params.reach_margin, params.reach_margin) * compliance.normal;
}

}  // namespace trocar
