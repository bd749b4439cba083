#include <cmath>

#include "content/scene/scene_sections.hpp"
namespace trocar {
namespace {

NodeSwitchSpec read_switch(TomlSection section) {
    NodeSwitchSpec spec;
    NodeSwitch& s = spec.toggle;
    spec.line = section.line();
    s.to = 2;
    bool enabled = true;
    if (section.find("enabled")) section.read("enabled", enabled), s.to = enabled;
    section.read("time", s.time, 0, 1e9);
    section.read("tool", spec.tool);
    section.read_count("buttons", s.buttons, 0, 4294967295.0);
    section.read("driven", spec.driven);
    section.read_enum<NodeEventKind>("event", s.event,
                                     {{"pressed", NodeEventKind::kPressed},
                                      {"released", NodeEventKind::kReleased},
                                      {"limit", NodeEventKind::kLimit},
                                      {"detent", NodeEventKind::kDetent}});
    section.refuse_unknown();
    const int given = std::isfinite(s.time) + (s.buttons != 0) + !spec.driven.empty();
    if (given != 1) section.fail("a [[node.switch]] needs one of time, buttons (bits) and driven (a body)");
    if (std::isfinite(s.time) && s.to == 2) section.fail("a [[node.switch]] with a time needs enabled");
    return spec;
}

void read_drive(TomlSection& section, NodeSpec& node) {
    NodeDrive& d = node.drive;
    section.read_enum<NodeBehaviour>(
        "behaviour", d.behaviour, {{"button", NodeBehaviour::kButton}, {"slider", NodeBehaviour::kSlider}, {"dial", NodeBehaviour::kDial}});
    if (d.behaviour == NodeBehaviour::kNone) return;
    const bool button = d.behaviour == NodeBehaviour::kButton, dial = d.behaviour == NodeBehaviour::kDial;
    section.read_direction("axis", d.axis);
    std::vector<double> limits;
    if (section.read("limits", 2, limits)) {
        if (!(limits[0] <= 0 && limits[1] >= 0 && limits[0] < limits[1]))
            section.fail("limits must be two places with 0, where the body begins, between them");
        d.lowest = limits[0], d.highest = limits[1];
    } else if (button) {
        section.fail("a button needs limits = [0, its travel in m]");
    }
    section.read("stiffness", d.stiffness, 0, 1e9);
    section.read("rest", d.rest, -1e6, 1e6);
    section.read("damping", d.damping, 0, 1e6);
    section.read("friction", d.friction, 0, 1e6);
    if (button) {
        d.click_at = 0.5 * (d.lowest + d.highest);
        d.click_width = 0.1 * (d.highest - d.lowest);
        section.read("click_at", d.click_at, d.lowest, d.highest);
        section.read("click_width", d.click_width, 1e-9, 1e3);
        section.read("click", d.click, 0, 1e6);
        if (d.stiffness == 0) section.fail("a button needs a stiffness, N/m");
    }
    if (dial) {
        section.read("detents", d.detents, 1, 1e4);
        section.read("detent", d.detent, 0, 1e6);
        if (d.detents != std::floor(d.detents)) section.fail("detents must be a whole number of them in a turn");
        if ((d.detents > 0) != (d.detent > 0)) section.fail("detents (in a turn) and detent (N m) come together");
    }
}

}  // namespace

NodeSpec read_node(TomlSection section) {
    NodeSpec node;
    node.line = section.line();
    section.read("name", node.name);
    if (node.name.empty()) section.fail("a [[node]] needs a name");
    section.read("parent", node.parent);
    section.read("position", node.position);
    section.read("rotation", node.orientation);
    section.read("scale", node.scale, 1e-6, 1e6);
    section.read("enabled", node.enabled);
    read_drive(section, node);
    section.read_list("switch", node.switches, read_switch);
    section.refuse_unknown();
    return node;
}

}  // namespace trocar
