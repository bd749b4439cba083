#include <cmath>
#include <limits>

#include "content/scene/scene_sections.hpp"

namespace trocar {
namespace {

HandModel read_hand(TomlSection section) {
    HandModel hand;
    section.read("mass", hand.mass, 1e-3, 1e3);
    section.read("damping", hand.damping, 0, 1e4);
    section.read("stiffness", hand.stiffness, 0, 1e6);
    section.read("arm_damping", hand.arm_damping, 0, 1e4);
    section.read("friction", hand.friction, 0, 1e3);
    section.read("encoder", hand.encoder, 0, 1e-2);
    section.read_count("delay", hand.delay, 0, kMostHandDelay);
    section.read("tremor", hand.tremor, 0, 0.1);
    section.read("tremor_rate", hand.tremor_rate, 0.01, 100);
    section.refuse_unknown();
    if (hand.mass == 0 &&
        (hand.damping > 0 || hand.stiffness > 0 || hand.arm_damping > 0 || hand.friction > 0 || hand.encoder > 0 || hand.delay > 0))
        section.fail("[tool.hand] gives way to forces only with a mass");
    return hand;
}

Workspace read_workspace(TomlSection section) {
    Workspace workspace;
    section.read("origin", workspace.origin);
    section.read("rotation", workspace.turn);
    section.read("scale", workspace.scale, 1e-3, 1e3);
    section.read_count("clutch", workspace.clutch, 0, 4294967295.0);
    section.refuse_unknown();
    return workspace;
}

Pivot read_pivot(TomlSection section) {
    Pivot pivot;
    pivot.kind = PivotKind::kHandle;
    section.read("point", pivot.point);
    section.read_enum<PivotKind>("device", pivot.kind, {{"handle", PivotKind::kHandle}, {"tip", PivotKind::kTip}});
    section.read("length", pivot.length, 1e-3, 10);
    section.read_direction("axis", pivot.axis);
    section.refuse_unknown();
    return pivot;
}

DeviceLimits read_limits(TomlSection section) {
    DeviceLimits limits;
    section.read("torque", limits.torque, 0, 1e4);
    section.read("force_slew", limits.force_slew, 0, 1e9);
    section.read("torque_slew", limits.torque_slew, 0, 1e9);
    section.read("dissipation", limits.dissipation, 0, 1e3);
    section.read("turn_dissipation", limits.turn_dissipation, 0, 1e2);
    section.read("surface_age", limits.surface_age, 0, 1);
    section.refuse_unknown();
    return limits;
}

// Checks that the values required by each kind of effect are given.
void check_effect(const TomlSection& section, const HapticEffect& e, const std::string& kind) {
    const auto need = [&](double value, const char* key) {
        if (value == 0) section.fail("a " + kind + " needs " + key);
    };
    switch (e.kind) {
        case EffectKind::kSpringPoint:
        case EffectKind::kSpringLine:
        case EffectKind::kSpringPlane:
            need(e.stiffness, "stiffness");
            break;
        case EffectKind::kConstant:
            need(e.force, "force");
            break;
        case EffectKind::kImpulse:
            need(e.impulse, "impulse");
            break;
        case EffectKind::kVibration:
            need(e.force, "force"), need(e.frequency, "frequency");
            break;
        case EffectKind::kViscosity:
            need(e.damping, "damping");
            break;
        case EffectKind::kInertia:
            need(e.mass, "mass");
            break;
        case EffectKind::kMagnet:
            need(e.force, "force"), need(e.reach, "reach");
            break;
    }
    if (e.trigger == EffectTrigger::kButton) need(e.buttons, "buttons (bits) with when = \"button\"");
}

HapticEffect read_effect(TomlSection section) {
    HapticEffect e;
    std::string kind;
    section.read("kind", kind);
    if (kind.empty()) section.fail("a [[tool.effect]] needs a kind");
    section.read_enum<EffectKind>("kind", e.kind,
                                  {{"spring_to_point", EffectKind::kSpringPoint},
                                   {"spring_to_line", EffectKind::kSpringLine},
                                   {"spring_to_plane", EffectKind::kSpringPlane},
                                   {"constant", EffectKind::kConstant},
                                   {"impulse", EffectKind::kImpulse},
                                   {"vibration", EffectKind::kVibration},
                                   {"viscosity", EffectKind::kViscosity},
                                   {"inertia", EffectKind::kInertia},
                                   {"magnet", EffectKind::kMagnet}});
    section.read_enum<EffectTrigger>("when", e.trigger,
                                     {{"time", EffectTrigger::kTime},
                                      {"button", EffectTrigger::kButton},
                                      {"touch", EffectTrigger::kTouch},
                                      {"release", EffectTrigger::kRelease}});
    section.read("start", e.start, 0, 1e9);
    section.read("duration", e.duration, 0, 1e9);
    section.read_count("buttons", e.buttons, 0, 4294967295.0);
    section.read("point", e.point);
    section.read_direction("direction", e.direction);
    section.read("stiffness", e.stiffness, 0, 1e5);
    section.read("damping", e.damping, 0, 1e3);
    section.read("force", e.force, -1e3, 1e3);
    section.read("impulse", e.impulse, -10, 10);
    section.read("frequency", e.frequency, 0, 500);  // limit: half the tick rate
    section.read("mass", e.mass, 0, 10);
    section.read("reach", e.reach, 0, 1);
    section.refuse_unknown();
    check_effect(section, e, kind);
    return e;
}

ToolExchangeSpec read_exchange(TomlSection section) {
    ToolExchangeSpec exchange;
    exchange.line = section.line();
    section.read("body", exchange.body);
    section.read("tip", exchange.tip);
    section.read("tip_radius", exchange.tip_radius, 1e-9, 10);
    section.read("time", exchange.time, 0, 1e9);
    section.read_count("buttons", exchange.buttons, 0, 4294967295.0);
    section.refuse_unknown();
    if (exchange.body.empty()) section.fail("a [[tool.exchange]] needs the body that comes into the hand");
    if (std::isfinite(exchange.time) == (exchange.buttons != 0)) section.fail("a [[tool.exchange]] needs a time or buttons (bits)");
    return exchange;
}

JawSpec read_jaw(TomlSection section) {
    JawSpec s;
    s.line = section.line();
    section.read("body", s.body);
    section.read("pivot", s.jaw.pivot);
    section.read("rotation", s.jaw.closed);
    section.read_direction("axis", s.jaw.axis);
    section.read("share", s.jaw.share, -1, 1);
    section.refuse_unknown();
    if (s.body.empty()) section.fail("a [[tool.jaw]] needs the name of its body");
    return s;
}

// The sub-tables of a [[tool]].
void read_tool_tables(TomlSection& section, ToolSpec& tool) {
    section.read_table("hand", tool.tool.hand, read_hand);
    section.read_table("workspace", tool.tool.workspace, read_workspace);
    section.read_table("pivot", tool.tool.pivot, read_pivot);
    section.read_table("limits", tool.tool.limits, read_limits);
    section.read_list("exchange", tool.exchanges, read_exchange);
    section.read_list("jaw", tool.jaws, read_jaw);
    section.read_list("effect", tool.effects, read_effect);
    section.read_list("action", tool.actions, read_action);
    if (tool.effects.size() > kMaxEffects)
        section.fail("tool \"" + tool.body + "\" has " + std::to_string(tool.effects.size()) + " effects; the most is " +
                     std::to_string(kMaxEffects));
}

// Keys of 6-DOF tools.
void read_shell(TomlSection& section, ToolSpec& tool) {
    tool.tool.coupling_damping = tool.tool.turn_damping = -1;
    tool.tool.turn_stiffness = 0.5;
    section.read_count("points", tool.points, 10, 20'000);
    section.read("turn_stiffness", tool.tool.turn_stiffness, 1e-6, 1e4);
    section.read("turn_damping", tool.tool.turn_damping, 0, 1e4);
    section.read("surface_stiffness", tool.tool.surface_stiffness, 1, 1e9);
}

}  // namespace

ToolSpec read_tool(TomlSection section) {
    ToolSpec tool;
    tool.line = section.line();
    section.read("body", tool.body);
    if (tool.body.empty()) section.fail("a [[tool]] needs the name of its body");
    Vec3d tip = Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());
    section.read("tip", tip);
    tool.tip_given = tip.allFinite();
    if (tool.tip_given) tool.tool.tip = tip;
    section.read("tip_radius", tool.tool.tip_radius, 0, 10);
    section.read_count("dof", tool.dof, 3, 6);
    if (tool.dof != 3 && tool.dof != 6)
        section.fail("tool \"" + tool.body + "\": dof is 3 (a sphere at the tip feels) or 6 (the whole body does)");
    if (tool.dof == 6) read_shell(section, tool);
    section.read("stiffness", tool.tool.coupling_stiffness, 0, 1e7);
    section.read("damping", tool.tool.coupling_damping, 0, 1e6);
    section.read("max_force", tool.tool.max_force, 0, 1e6);
    section.read("friction", tool.tool.friction, 0, 1e6);
    section.read("pass_through", tool.tool.pass_through, 0, 1e6);
    section.read("trace", tool.trace);
    tool.path = read_path(section, "path", true);
    read_degrees(section, "grip_closed", tool.tool.grip_closed);
    read_tool_tables(section, tool);
    section.refuse_unknown();
    if (tool.path.empty() && tool.trace.empty()) section.fail("tool \"" + tool.body + "\" needs a trace or a [[tool.path]]");
    return tool;
}

}  // namespace trocar
