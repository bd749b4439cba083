#pragma once
#include <algorithm>
#include <cmath>
#include <utility>

#include "systems/haptics/tick.hpp"
namespace trocar::reference {

inline constexpr double kRigTick = 1e-3;    // s
inline constexpr double kRigRadius = 3e-3;  // m, of the tip

// A tool and a surface, ticked by the test. No friction, damping or limits except those a test sets.
struct HapticRig {
    HapticParams params;
    LocalContactModel model;
    HandTool tool;
    HapticScratch scratch;
    ToolState state;
    uint64_t tick = 0;

    explicit HapticRig(LocalContactModel surface) : model(std::move(surface)) {
        tool.tip_radius = kRigRadius;
        tool.coupling_damping = 0;
        tool.friction = 0;
        tool.max_force = 1e9;
    }
    double time() const { return static_cast<double>(tick) * kRigTick; }
    // one tick with the device at a position and velocity
    Vec3d at(const Vec3d& position, const Vec3d& velocity = Vec3d::Zero()) {
        DeviceState sample;
        sample.time = time();
        sample.position = position;
        sample.velocity = velocity;
        return with(sample);
    }
    Vec3d with(const DeviceState& sample) {
        haptic_tick(params, model, time(), tool, sample, scratch, state);
        // the surface stays as published: the caller sets its age
        ++tick;
        return state.command.force;
    }
    // moves straight to a position at a speed (m/s)
    Vec3d go(const Vec3d& target, double speed) {
        const Vec3d begin = state.device_valid ? state.device.position : target;
        const int ticks = std::max(1, static_cast<int>(std::ceil((target - begin).norm() / (speed * kRigTick))));
        Vec3d force = state.command.force;
        for (int k = 1; k <= ticks; ++k) force = at(begin + (target - begin) * (double(k) / ticks));
        return force;
    }
    Vec3d rest(int ticks) {
        Vec3d force;
        for (int k = 0; k < ticks; ++k) force = at(state.device.position);
        return force;
    }
};

// A surface that never ages.
inline HapticRig still_rig(LocalContactModel model) {
    HapticRig rig(std::move(model));
    rig.params.model_timeout = 1e9;
    rig.params.device_timeout = 1e9;
    return rig;
}

// A free device with one axis: m a = F - b v.
struct FreeDevice {
    double mass = 0.1, damping = 0.5;  // kg, N s/m
    double x = 0, v = 0;               // m, m/s
    double lost = 0;                   // J, dissipated by damping so far

    // Exact solution for one tick with constant force (N); returns the displacement (m).
    double step(double force) {
        const double rate = damping / mass, decay = std::exp(-rate * kRigTick);
        const double terminal = force / damping, u = v - terminal;
        const double displacement = terminal * kRigTick + u / rate * (1 - decay);
        // integral of b v^2 over the tick with v = terminal + u e^(-rate t)
        lost +=
            damping * (terminal * terminal * kRigTick + 2 * terminal * u * (1 - decay) / rate + u * u * (1 - decay * decay) / (2 * rate));
        v = terminal + u * decay;
        x += displacement;
        return displacement;
    }
};

}  // namespace trocar::reference
