#include <cmath>

#include "content/scene/scene_sections.hpp"
namespace trocar {
namespace {

// Kinds that are named here are known, but nothing does them.
ActionKind read_kind(TomlSection& section) {
    std::string kind;
    section.read("kind", kind);
    if (kind == "staple") return ActionKind::kStaple;
    if (kind == "cut") return ActionKind::kCut;
    if (kind == "irrigate") return ActionKind::kIrrigate;
    if (kind == "suck") return ActionKind::kSuck;
    const bool unfinished = kind == "grasp" || kind == "cauterise" || kind == "suture";
    section.fail(kind.empty() ? "a [[tool.action]] needs a kind: staple, cut, irrigate, suck"
                 : unfinished ? "kind \"" + kind + "\" is not there yet; there are staple, cut, irrigate, suck"
                              : "kind \"" + kind + "\" is none of staple, cut, irrigate, suck");
}

// An ascending list of times, s.
std::vector<double> read_times(TomlSection& section) {
    std::vector<double> times;
    const toml::node* node = section.find("at");
    if (!node) return times;
    const toml::array* list = node->as_array();
    if (!list || list->empty()) section.fail(*node, "at is a list of times (s)");
    for (const toml::node& entry : *list) {
        const auto time = entry.value<double>();
        if (!time || !std::isfinite(*time) || *time < 0) section.fail(entry, "at: a time (s) is a number that is not negative");
        if (!times.empty() && *time <= times.back()) section.fail(entry, "at: the times must ascend");
        times.push_back(*time);
    }
    return times;
}

void read_trigger(TomlSection& section, ActionSpec& spec) {
    ToolAction& action = spec.action;
    spec.at = read_times(section);
    if (!spec.at.empty()) action.when = ActionTrigger::kTimes;
    section.read_enum<ActionTrigger>("when", action.when,
                                     {{"button", ActionTrigger::kButton},
                                      {"grip", ActionTrigger::kGrip},
                                      {"force", ActionTrigger::kForce},
                                      {"times", ActionTrigger::kTimes},
                                      {"always", ActionTrigger::kAlways}});
    section.read_count("buttons", action.buttons, 1, 4294967295.0);
    read_degrees(section, "grip", action.grip);
    section.read("force", action.force, 0, 1e6);
    if ((action.when == ActionTrigger::kTimes) == spec.at.empty()) section.fail("when = \"times\" goes with at = [...]");
    if (action.when == ActionTrigger::kGrip && action.grip == 0) section.fail("when = \"grip\" needs grip (degrees)");
    if (action.when == ActionTrigger::kForce && action.force == 0) section.fail("when = \"force\" needs force (N)");
}

void read_staple_action(TomlSection& section, ToolAction& action) {
    section.read("reach", action.reach, 1e-9, 1e3);
    section.read("press", action.press, 0, 1e6);
    section.read("stiffness", action.stiffness, 1e-9, 1e12);
    section.read("pull_out", action.pull_out, 1e-9, 1e9);
    section.read_count("magazine", action.magazine, 1, 10'000);
    if (action.when == ActionTrigger::kAlways) section.fail("a staple is set when a trigger is pulled, not always");
}

void read_cut_action(TomlSection& section, ActionSpec& spec) {
    Vec3d edge = Vec3d::Constant(std::nan(""));
    section.read("edge", edge);
    section.read("bodies", spec.bodies);
    section.read("toughness", spec.action.toughness, 0, 1e9);
    if (!edge.allFinite()) section.fail("a cut needs edge: the other end of the edge that begins at point (m, frame of the tool's body)");
    if (spec.bodies.empty()) section.fail("a cut needs bodies: names of the shells and sheets that it parts");
    spec.action.edge = edge;
}

constexpr double kMillilitresPerMinute = 1e-6 / 60;  // m^3/s

void read_nozzle(TomlSection& section, ToolAction& action) {
    double rate = 0;
    section.read("rate", rate, 0, 1e6);
    if (!(rate > 0)) section.fail("irrigation and suction need a rate (ml/min)");
    action.rate = rate * kMillilitresPerMinute;
    if (action.kind == ActionKind::kIrrigate) {
        section.read("bore", action.bore, 1e-5, 1);
        section.read_direction("direction", action.direction);
    } else {
        action.reach = 0.005;
        section.read("reach", action.reach, 1e-9, 1e3);
    }
}

}  // namespace

ActionSpec read_action(TomlSection section) {
    ActionSpec spec;
    spec.line = section.line();
    spec.action.kind = read_kind(section);
    read_trigger(section, spec);
    Vec3d point = Vec3d::Constant(std::nan(""));
    section.read("point", point);
    spec.point_given = point.allFinite();
    if (spec.point_given) spec.action.point = point;
    if (spec.action.kind == ActionKind::kStaple)
        read_staple_action(section, spec.action);
    else if (spec.action.kind != ActionKind::kCut)
        read_nozzle(section, spec.action);
    else
        read_cut_action(section, spec);
    section.refuse_unknown();
    return spec;
}

}  // namespace trocar
