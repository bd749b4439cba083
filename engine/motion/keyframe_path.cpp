#include "engine/motion/keyframe_path.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

// The key at the start of the interval that contains `time`; keys.front().time <= time < keys.back().time.
size_t interval_of(std::span<const Keyframe> keys, double time) {
    const auto after = std::upper_bound(keys.begin(), keys.end(), time, [](double t, const Keyframe& key) { return t < key.time; });
    return static_cast<size_t>(after - keys.begin()) - 1;
}

// Velocity at a key: the harmonic mean of the chord slopes, zero where they differ in sign, so that the cubic stays
// monotone.
Vec3d key_velocity(std::span<const Keyframe> keys, size_t k) {
    if (k == 0 || k + 1 == keys.size() || keys[k].jump || keys[k + 1].jump) return Vec3d::Zero();
    const double before = keys[k].time - keys[k - 1].time, after = keys[k + 1].time - keys[k].time;
    if (before <= 0 || after <= 0) return Vec3d::Zero();
    const Vec3d slope0 = (keys[k].position - keys[k - 1].position) / before;
    const Vec3d slope1 = (keys[k + 1].position - keys[k].position) / after;
    const double w0 = 2 * after + before, w1 = after + 2 * before;
    Vec3d velocity = Vec3d::Zero();
    for (int i = 0; i < 3; ++i) {
        if (slope0[i] * slope1[i] > 0) velocity[i] = (w0 + w1) / (w0 / slope0[i] + w1 / slope1[i]);
    }
    return velocity;
}

PathPoint position_of(const Keyframe& key) { return {key.position, key.orientation, Vec3d::Zero(), Vec3d::Zero(), key.grip}; }

}  // namespace

PathPoint sample_path(std::span<const Keyframe> keys, double time) {
    PathPoint at;
    if (keys.empty()) return at;
    if (!(time > keys.front().time)) return position_of(keys.front());
    if (time >= keys.back().time) return position_of(keys.back());
    const size_t k = interval_of(keys, time);
    const Keyframe &a = keys[k], &b = keys[k + 1];
    if (b.jump) return position_of(a);

    const double length = b.time - a.time, u = (time - a.time) / length;
    const Vec3d va = key_velocity(keys, k) * length, vb = key_velocity(keys, k + 1) * length, chord = b.position - a.position;
    const double u2 = u * u, rise = u2 * (3 - 2 * u), rise_rate = 6 * u * (1 - u);
    at.position = a.position + rise * chord + (u * (1 - u) * (1 - u)) * va + (u2 * (u - 1)) * vb;
    at.velocity = (rise_rate * chord + ((1 - u) * (1 - 3 * u)) * va + (u * (3 * u - 2)) * vb) / length;
    const Vec3d turn = rotation_vector(a.orientation, b.orientation);
    at.orientation = normalized(multiply(from_rotation_vector(rise * turn), a.orientation));
    at.angular_velocity = turn * (rise_rate / length);
    at.grip = a.grip + rise * (b.grip - a.grip);
    return at;
}

bool path_jumps(std::span<const Keyframe> keys, double from, double to) {
    return std::any_of(keys.begin(), keys.end(), [&](const Keyframe& key) { return key.jump != 0 && key.time > from && key.time <= to; });
}

}  // namespace trocar
