#pragma once
#include <array>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

enum class EffectKind : uint8_t {
    kSpringPoint,  // stiffness (point - x)
    kSpringLine,   // the same without its part along `direction`
    kSpringPlane,  // its part along `direction` alone
    kConstant,     // force along direction
    kImpulse,      // a half sine of `duration` along direction whose integral is `impulse`
    kVibration,    // force sin(2 pi frequency t) along direction
    kViscosity,    // -damping v
    kInertia,      // -mass a
    kMagnet,       // towards the surface nearer than `reach`, growing linearly to `force` at contact
};
enum class EffectTrigger : uint8_t {
    kTime,     // at `start`
    kButton,   // when one of `buttons` is pressed; stops when it is released, or after duration
    kTouch,    // when a surface is touched
    kRelease,  // when it is left
};
// An additional force on the hand of one tool, independent of contact. Constant after load.
struct HapticEffect {
    EffectKind kind = EffectKind::kConstant;
    EffectTrigger trigger = EffectTrigger::kTime;
    double start = 0;             // s, kTime
    double duration = 0;          // s; 0 = unlimited, or while the button is held
    uint32_t buttons = 0;         // kButton
    Vec3d point = Vec3d::Zero();  // m, world
    Vec3d direction{0, 0, 1};     // unit, world
    double stiffness = 0;         // N/m
    double damping = 0;           // N s/m, springs and viscosity
    double force = 0;             // N
    double impulse = 0;           // N s
    double frequency = 0;         // Hz
    double mass = 0;              // kg
    double reach = 0;             // m
    TROCAR_FIELDS(kind, trigger, start, "s", duration, "s", buttons, point, "m", direction, stiffness, "N/m", damping, "N s/m", force, "N",
                  impulse, "N s", frequency, "Hz", mass, "kg", reach, "m");
};
inline constexpr uint32_t kMaxEffects = 16;  // of a tool
struct EffectState {
    bool running = false;
    double since = 0;  // s
    TROCAR_FIELDS(running, since, "s");
};

enum class HapticEventKind : uint8_t { kTouch, kRelease, kButtonDown, kButtonUp, kPassThrough, kLimit, kCount };
struct HapticEvent {
    HapticEventKind kind = HapticEventKind::kTouch;
    double time = 0;     // s
    uint32_t value = 0;  // buttons that changed, body that was passed through; else 0
    TROCAR_FIELDS(kind, time, "s", value);
};
inline constexpr uint32_t kKeptEvents = 16;
// The last events of a tool and the number of events of each kind.
struct HapticEvents {
    std::array<HapticEvent, kKeptEvents> last{};  // event n at n % kKeptEvents
    uint64_t total = 0;
    std::array<uint32_t, static_cast<size_t>(HapticEventKind::kCount)> count{};
    TROCAR_FIELDS(last, total, count);
};

}  // namespace trocar
