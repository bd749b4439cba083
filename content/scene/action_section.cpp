#include <cmath>

#include "content/scene/scene_sections.hpp"
namespace trocar {
namespace {

ActionKind read_kind(TomlSection& section) {
    std::string kind;
    section.read("kind", kind);
    if (kind == "staple") return ActionKind::kStaple;
    if (kind == "cut") return ActionKind::kCut;
    if (kind == "grasp") return ActionKind::kGrasp;
    if (kind == "cauterise") return ActionKind::kCauterise;
    if (kind == "irrigate") return ActionKind::kIrrigate;
    if (kind == "suck") return ActionKind::kSuck;
    if (kind == "suture") return ActionKind::kSuture;
    const std::string kinds = "staple, cut, grasp, cauterise, irrigate, suck, suture";
    section.fail(kind.empty() ? "a [[tool.action]] needs a kind: " + kinds : "kind \"" + kind + "\" is none of " + kinds);
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

constexpr double kMillilitresPerMinute = 1e-6 / 60;  // m^3/s

void read_cut_action(TomlSection& section, ActionSpec& spec) {
    Vec3d edge = Vec3d::Constant(std::nan(""));
    section.read("edge", edge);
    section.read("bodies", spec.bodies);
    section.read("toughness", spec.action.toughness, 0, 1e9);
    section.read("bleeding", spec.action.bleeding, 0, 1e9);
    spec.action.bleeding *= kMillilitresPerMinute;
    if (!edge.allFinite()) section.fail("a cut needs edge: the other end of the edge that begins at point (m, frame of the tool's body)");
    if (spec.bodies.empty()) section.fail("a cut needs bodies: names of the shells and sheets that it parts");
    spec.action.edge = edge;
}

void read_grasp_action(TomlSection& section, ToolAction& action) {
    section.read("reach", action.reach, 1e-9, 1e3);
    section.read("press", action.press_force, 1e-9, 1e6);
    section.read("friction", action.friction, 1e-9, 1e6);
    section.read("pad", action.pad, 1e-9, 1e3);
    section.read("stiffness", action.stiffness, 1e-9, 1e12);
    if (action.press_force == 0) section.fail("a grasp needs press: with what each of two jaws presses what it holds (N)");
    if (action.friction == 0) section.fail("a grasp needs friction: of the jaws, which bear 2 friction press");
}

void read_cautery_action(TomlSection& section, ActionSpec& spec) {
    ToolAction& action = spec.action;
    section.read("reach", action.reach, 1e-9, 1e3);
    section.read("power", action.power, 1e-9, 1e6);
    section.read("spot", action.spot, 1e-9, 1e3);
    section.read("bodies", spec.bodies);
    if (action.power == 0) section.fail("a cautery needs power: what goes into the tissue (W)");
    if (spec.bodies.empty()) section.fail("a cautery needs bodies: names of the deformable bodies that it heats");
}

void read_suture_action(TomlSection& section, ActionSpec& spec) {
    section.read("thread", spec.thread);
    section.read("bodies", spec.bodies);
    section.read("stiffness", spec.action.stiffness, 1e-9, 1e12);
    // Coulomb friction of liver on a needle of 1.65 mm, 10.6 to 12 N per metre of its length in the tissue: Okamura, Simone & O'Leary, IEEE
    // Transactions on Biomedical Engineering 51(10), 2004
    spec.action.friction = 11;
    section.read("friction", spec.action.friction, 0, 1e6);
    if (spec.thread.empty()) section.fail("a suture needs thread: the name of a [[thread]], which hangs on its tool");
    if (spec.bodies.empty()) section.fail("a suture needs bodies: names of the deformable bodies that it sews");
}

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
    switch (spec.action.kind) {
        case ActionKind::kStaple:
            read_staple_action(section, spec.action);
            break;
        case ActionKind::kCut:
            read_cut_action(section, spec);
            break;
        case ActionKind::kGrasp:
            spec.action.reach = 2e-3, spec.action.pad = 1.5e-3;
            read_grasp_action(section, spec.action);
            break;
        case ActionKind::kCauterise:
            spec.action.reach = 2e-3, spec.action.spot = 1e-3;
            read_cautery_action(section, spec);
            break;
        case ActionKind::kIrrigate:
        case ActionKind::kSuck:
            read_nozzle(section, spec.action);
            break;
        case ActionKind::kSuture:
            read_suture_action(section, spec);
            break;
    }
    section.refuse_unknown();
    return spec;
}

}  // namespace trocar
