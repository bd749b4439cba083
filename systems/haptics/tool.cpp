#include "systems/haptics/tool.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/devices/simulated_hand.hpp"
#include "systems/haptics/contact/device_motion.hpp"
#include "systems/haptics/contact/push_out.hpp"
#include "systems/haptics/contact/surface_feel.hpp"
#include "systems/haptics/effects.hpp"
#include "systems/haptics/manipulator.hpp"
#include "systems/haptics/safety.hpp"
namespace trocar {
namespace {

void add_event(HapticEventKind kind, double time, uint32_t value, HapticEvents& events) {
    events.last[events.total++ % kKeptEvents] = {kind, time, value};
    ++events.count[static_cast<size_t>(kind)];
}

// Stiffness of the contact on the hand: that of the coupling, along its force.
void add_contact_stiffness(double coupling, const Vec3d& force, std::array<double, 9>& stiffness) {
    const double length = force.norm();
    if (length <= 0) return;
    const Vec3d n = force / length;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) stiffness[static_cast<size_t>(3 * i + j)] += coupling * n[i] * n[j];
}

// Force of links on the hand, N, interpolated from one contact pass to the next.
Vec3d link_pull(const LocalContactModel& model, double age) {
    const double share = model.period > 0 ? std::clamp(age / model.period, 0.0, 1.0) : 1.0;
    return model.pull_before + share * (model.pull - model.pull_before);
}

// The part of the link force that contact does not transmit already: contact with the jaws holds a shell,
// linked or not; a tip from which tissue hangs has no such contact.
Vec3d unfelt_pull(const HandTool& tool, const Vec3d& pull, const Vec3d& contact) {
    const double size2 = pull.squaredNorm();
    if (tool.point_shell.empty() || size2 == 0) return pull;
    return (1 - std::clamp(contact.dot(pull) / size2, 0.0, 1.0)) * pull;
}

EffectInput effect_input(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                         std::span<const HapticEffect> effects, double elapsed, const ToolState& state) {
    EffectInput in;
    in.dt = params.dt;
    in.position = state.device.position;
    in.velocity = state.device.velocity;
    if (elapsed > 0) in.acceleration = (state.device.velocity - state.effect_velocity) / elapsed;
    double reach = 0;
    for (const HapticEffect& e : effects)
        if (e.kind == EffectKind::kMagnet) reach = std::max(reach, e.reach);
    if (reach > 0) {
        const double age = std::clamp(time - model.time, -params.greatest_age, params.greatest_age);
        find_near_surface(model, age, state.proxy_valid ? state.proxy : state.device.position, tool.tip_radius, reach, in);
    }
    return in;
}

// Adds the forces of the running effects.
void add_effects(const HapticParams& params, std::span<const HapticEffect> effects, double time, double gain, EffectInput in,
                 const ToolState& state, DeviceCommand& command) {
    for (size_t k = 0; k < effects.size(); ++k) {
        if (!state.effect[k].running) continue;
        in.age = time - state.effect[k].since;
        command.force += gain * effect_force(effects[k], params.rise_time, in);
        const std::array<double, 9> stiffness = effect_stiffness(effects[k]);
        for (size_t i = 0; i < 9; ++i) command.stiffness[i] += gain * stiffness[i];
    }
}

// Another instrument is in the hand: this one follows without contact, ready to be taken up.
void rest_tool(const HapticParams& params, const LocalContactModel& model, double time, DeviceState sample, ToolState& state) {
    sample.buttons = 0;
    take_sample(params, sample, state);
    state.time = time;
    state.model_age = time - model.time;
    ++state.ticks;
    state.proxy_valid = state.sliding = false;
    state.contacts = 0;
    state.contact.clear();
    state.touched = kNone;
    state.command = state.output = {};
    state.carried = state.pull = state.pull_torque = state.pushed = Vec3d::Zero();
    state.effect = {};
    SafetyState& safety = state.safety;
    safety.gain = 0;
    safety.started = false;
    safety.contact_force = safety.pull = safety.contact_torque = safety.pull_torque = Vec3d::Zero();
}

}  // namespace

void tick_tool(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
               std::span<const HapticEffect> effects, const DeviceState& device, HapticScratch& scratch, ToolState& state) {
    const DeviceState sample = place_tool(tool, device, state.clutch);
    if (!model.in_hand) {
        rest_tool(params, model, time, sample, state);
        return;
    }
    const bool first = !state.device_valid;
    const double elapsed = first ? 0 : time - state.time;
    if (!first) state.pushed = pushed_after(state.pushed, model.exit.goal, std::max(0.0, elapsed));
    const uint64_t rejected = state.rejected_samples;
    const uint32_t buttons = first ? sample.buttons : state.device.buttons;
    const bool touched = state.contacts > 0, was_limiting = state.safety.limiting;
    if (tool.point_shell.empty()) {
        haptic_tick(params, model, time, tool, sample, scratch, state);
    } else {
        point_shell_tick(params, model, time, tool, sample, scratch.point_shell, state);
    }
    if (!state.device_valid) return;

    uint32_t passed = kNone;  // body
    if (tool.pass_through > 0 && state.contacts > 0 && state.command.force.norm() > tool.pass_through) {
        // passed through: no contact until the tip is clear of every surface
        state.proxy_valid = false;
        state.contacts = 0;
        state.contact.clear();
        state.command = {};
        state.pull = state.pull_torque = Vec3d::Zero();
        passed = state.touched;
    }
    const bool touches = state.contacts > 0;
    const EffectTriggers triggers{time, state.device.buttons, buttons, touches && !touched, !touches && touched};
    run_triggers(effects, triggers, state.effect);

    // after a silence the device had dropped its force: forces return gradually
    SafetyState& safety = state.safety;
    if (elapsed > params.silence) state.output = {};
    safety.gain = elapsed > params.silence ? 0 : std::min(1.0, safety.gain + std::max(0.0, elapsed) / params.rise_time);
    DeviceCommand wanted;
    wanted.at = state.device.position;
    const SurfaceFeel feel = feel_of(tool, model, state.touched, state.sliding);
    const HapticSurface* surface = model.surface.empty() ? nullptr : surface_of(model, state.touched);
    const Vec3d felt =
        surface ? textured_force(*surface, state.model_age, feel.stiffness, state, state.command.force) : state.command.force;
    const bool held = state.proxy_valid || state.contacts > 0;
    // tissue that yields before its motion is known lets the end of the coupling in
    const double stretch = surface && surface->deformable ? feel.stiffness / tool.coupling_stiffness : 1;
    const Vec3d proxy = state.device.position + (held ? stretch : 0) * (state.proxy - state.device.position);
    wanted.force = dissipate({tool.limits.dissipation, tool.max_force}, params.dt, {state.device.position, state.device.velocity, proxy},
                             safety.gain * state.pull, safety.gain * felt, safety);
    if (!tool.point_shell.empty()) {
        const Quat& turn = held ? state.proxy_turn : state.device.orientation;
        const Vec3d twist = (touched_position(state) - state.proxy).cross(felt - state.command.force);
        wanted.torque = dissipate_turning({tool.limits.turn_dissipation, tool.limits.torque}, params.dt,
                                          {state.device.orientation, state.device_spin, turn}, safety.gain * state.pull_torque,
                                          safety.gain * (state.command.torque + twist), safety);
    }
    add_contact_stiffness(feel.stiffness, state.command.force, wanted.stiffness);
    const double gain = safety.gain * state.gain;
    wanted.force += gain * unfelt_pull(tool, link_pull(model, state.model_age), state.command.force);
    if (!effects.empty())
        add_effects(params, effects, time, gain, effect_input(params, model, time, tool, effects, elapsed, state), state, wanted);
    state.effect_velocity = state.device.velocity;
    const bool refused = state.rejected_samples > rejected;
    limit_command(tool.limits, tool.max_force, params.dt, refused || state.gain == 0,
                  command_for_device(tool, state.device, state.clutch, wanted), safety, state.output);
    state.largest_force = std::max(state.largest_force, state.output.force.norm());
    state.largest_wanted = std::max(state.largest_wanted, wanted.force.norm());

    const uint32_t pressed = state.device.buttons & ~buttons, released = buttons & ~state.device.buttons;
    if (triggers.touch) add_event(HapticEventKind::kTouch, time, 0, state.events);
    if (passed != kNone) add_event(HapticEventKind::kPassThrough, time, passed, state.events);
    if (triggers.release) add_event(HapticEventKind::kRelease, time, 0, state.events);
    if (pressed) add_event(HapticEventKind::kButtonDown, time, pressed, state.events);
    if (released) add_event(HapticEventKind::kButtonUp, time, released, state.events);
    if (safety.limiting && !was_limiting) add_event(HapticEventKind::kLimit, time, 0, state.events);
}

void rehearse_tick(const HapticParams& params, const LocalContactModel& model, const HandTool& tool, const ToolState& state,
                   HapticScratch& scratch) {
    if (!tool.point_shell.empty() || !state.device_valid || !model.in_hand) return;
    ToolState forgotten = state;
    DeviceState sample = state.device;
    sample.time += params.dt;
    haptic_tick(params, model, state.time + params.dt, tool, sample, scratch, forgotten);
}

DeviceState hand_sample(const HandTool& tool, const DeviceState& intended, double dt, const DeviceCommand& output, HandModelState& hand) {
    if (tool.hand.mass <= 0) return intended;
    step_hand(tool.hand, intended, output.force, dt, hand);
    return hand_device_state(tool.hand, intended, hand);
}

void predict_tool(const HandTool& tool, double dt, const ToolState& state, std::span<const DeviceState> intended,
                  std::span<DeviceState> placed) {
    TROCAR_ASSERT(intended.size() == placed.size());
    HandModelState hand = state.hand;
    ClutchState clutch = state.clutch;
    for (size_t k = 0; k < intended.size(); ++k) {
        placed[k] = place_tool(tool, hand_sample(tool, intended[k], dt, state.output, hand), clutch);
        placed[k].position += pushed_after(state.pushed, state.exit.goal, static_cast<double>(k) * dt);
    }
}

}  // namespace trocar
