#pragma once
#include <algorithm>

#include "components/thread.hpp"
#include "engine/thread/rod.hpp"
namespace trocar {

// J, of what presses a thread's point (m) and the body's point of its touch (m) apart.
inline double energy_of_touch(const ThreadTouch& touch, const Vec3d& at, const Vec3d& place) {
    const double depth = touch.gap - touch.normal.dot(at - place);
    return depth > 0 ? 0.5 * kContactStiffness * depth * depth : 0;
}

// m/s, at which a point that is nearer than it should be is let out: 1 mm in 0.2 s.
inline constexpr double kLetOutSpeed = 5e-3;

// Widens the gap of a touch of the point `at` (m) by what a step of dt seconds lets out, up to `full` (m). Returns the work of that, J.
inline double let_out(double full, double dt, const Vec3d& at, ThreadTouch& touch) {
    const double before = energy_of_touch(touch, at, touch.before);
    touch.gap += std::clamp(full - touch.gap, 0.0, kLetOutSpeed * dt);
    const double work = energy_of_touch(touch, at, touch.before) - before;
    touch.stored += work;
    return work;
}

}  // namespace trocar
