#include "systems/haptics/effects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/base/check.hpp"
#include "engine/geometry/point_triangle.hpp"
namespace trocar {
namespace {

constexpr double kPi = std::numbers::pi;

double fade(double age, double rise_time) { return rise_time > 0 ? std::clamp(age / rise_time, 0.0, 1.0) : 1; }

// The component of `v` that a spring acts on.
Vec3d along_spring(const HapticEffect& e, const Vec3d& v) {
    const Vec3d along = e.direction.dot(v) * e.direction;
    if (e.kind == EffectKind::kSpringPlane) return along;
    return e.kind == EffectKind::kSpringLine ? Vec3d(v - along) : v;
}

// Mean of the half sine of `impulse` over [age, age + dt].
double impulse_force(const HapticEffect& e, const EffectInput& in) {
    if (e.duration <= 0) return in.age < 0.5 * in.dt ? e.impulse / in.dt : 0;
    const auto phase = [&](double t) { return std::cos(kPi * std::clamp(t / e.duration, 0.0, 1.0)); };
    return e.impulse * 0.5 * (phase(in.age) - phase(in.age + in.dt)) / in.dt;
}

bool is_over(const HapticEffect& e, double age) {
    // an impulse without duration lasts one tick
    if (e.kind == EffectKind::kImpulse && e.duration <= 0) return age > 1e-9;
    return e.duration > 0 && age >= e.duration - 1e-9;
}

}  // namespace

Vec3d effect_force(const HapticEffect& e, double rise_time, const EffectInput& in) {
    switch (e.kind) {
        case EffectKind::kSpringPoint:
        case EffectKind::kSpringLine:
        case EffectKind::kSpringPlane:
            return fade(in.age, rise_time) *
                   (e.stiffness * along_spring(e, e.point - in.position) - e.damping * along_spring(e, in.velocity));
        case EffectKind::kConstant:
            return e.force * e.direction;
        case EffectKind::kImpulse:
            return impulse_force(e, in) * e.direction;
        case EffectKind::kVibration:
            return e.force * std::sin(2 * kPi * e.frequency * in.age) * e.direction;
        case EffectKind::kViscosity:
            return -e.damping * in.velocity;
        case EffectKind::kInertia:
            return -e.mass * in.acceleration;
        case EffectKind::kMagnet:
            if (!in.near_surface || e.reach <= 0) break;
            return e.force * std::clamp(1 - in.gap / e.reach, 0.0, 1.0) * in.to_surface;
    }
    return Vec3d::Zero();
}

std::array<double, 9> effect_stiffness(const HapticEffect& e) {
    std::array<double, 9> k{};
    if (e.kind != EffectKind::kSpringPoint && e.kind != EffectKind::kSpringLine && e.kind != EffectKind::kSpringPlane) return k;
    for (int column = 0; column < 3; ++column) {
        const Vec3d c = e.stiffness * along_spring(e, Vec3d::Unit(column));
        for (int row = 0; row < 3; ++row) k[static_cast<size_t>(3 * row + column)] = c[row];
    }
    return k;
}

void run_triggers(std::span<const HapticEffect> effects, const EffectTriggers& t, std::span<EffectState> state) {
    TROCAR_ASSERT(effects.size() <= state.size());
    const uint32_t pressed = t.buttons & ~t.buttons_before;
    for (size_t k = 0; k < effects.size(); ++k) {
        const HapticEffect& e = effects[k];
        EffectState& s = state[k];
        bool start = false, stop = false;
        switch (e.trigger) {
            case EffectTrigger::kTime:
                start = !s.running && t.time >= e.start - 1e-9 && !is_over(e, t.time - e.start);
                break;
            case EffectTrigger::kButton:
                start = (pressed & e.buttons) != 0;
                stop = e.duration <= 0 && e.kind != EffectKind::kImpulse && (t.buttons & e.buttons) == 0;
                break;
            case EffectTrigger::kTouch:
                start = t.touch, stop = e.duration <= 0 && e.kind != EffectKind::kImpulse && t.release;
                break;
            case EffectTrigger::kRelease:
                start = t.release, stop = e.duration <= 0 && e.kind != EffectKind::kImpulse && t.touch;
                break;
        }
        if (s.running && (stop || is_over(e, t.time - s.since))) s.running = false;
        if (!start) continue;
        s.running = true;
        s.since = e.trigger == EffectTrigger::kTime ? e.start : t.time;
    }
}

void find_near_surface(const LocalContactModel& model, double age, const Vec3d& point, double tip_radius, double most, EffectInput& in) {
    double best = most;
    for (const TriangleGroup& group : model.group) {
        const double offset = tip_radius + model.half_thickness[group.triangles.first];
        const double away = (group.centre + age * group.velocity - point).norm() - group.radius - group.spread * std::abs(age);
        if (away - offset > best) continue;
        for (uint32_t t = group.triangles.first; t < group.triangles.end(); ++t) {
            const Triangle& v = model.triangle[t];
            const auto corner = [&](int k) { return Vec3d(model.position[v[k]] + age * model.velocity[v[k]]); };
            const TrianglePoint q = closest_point_on_triangle(point, corner(0), corner(1), corner(2));
            const double distance = std::sqrt(q.squared_distance), gap = std::max(0.0, distance - offset);
            if (gap >= best || distance < 1e-12) continue;
            best = gap;
            in.near_surface = true;
            in.gap = gap;
            in.to_surface = q.offset / distance;
        }
    }
}

}  // namespace trocar
