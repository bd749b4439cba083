#include "content/scene/build_actions.hpp"

#include <algorithm>

#include "content/scene/find_body.hpp"
#include "engine/tissue/links.hpp"
namespace trocar {
namespace {

bool names(const ActionSpec& spec, const std::string& body) {
    return std::find(spec.bodies.begin(), spec.bodies.end(), body) != spec.bodies.end();
}

// Row of a tool that a scene describes: instruments that the hand changes to have none of their own.
uint32_t tool_row_of(const SceneFile& scene, const ToolSpec& spec, const World& world) {
    return find_of_body(world.haptics.tool, find_body(scene, spec.line, world, spec.body));
}

void add_action(const SceneFile& scene, const ActionSpec& spec, uint32_t tool, World& world) {
    Actions& actions = world.actions;
    ToolAction action = spec.action;
    action.tool = tool;
    if (!spec.point_given) action.point = world.haptics.tool[tool].tip;
    action.times = {static_cast<uint32_t>(actions.time.size()), static_cast<uint32_t>(spec.at.size())};
    actions.time.insert(actions.time.end(), spec.at.begin(), spec.at.end());
    for (const std::string& name : spec.bodies) {
        const uint32_t body = find_body(scene, spec.line, world, name, "a cut: ");
        const uint32_t cut = find_of_body(actions.cut_body, body);
        if (cut == kNone) refuse(scene, spec.line, "a cut: body \"" + name + "\" must be deformable");
        actions.cuts.push_back({static_cast<uint32_t>(actions.action.size()), cut});
    }
    actions.action.push_back(action);
    world.action_state.progress.emplace_back();
}

}  // namespace

bool is_cut_by_tools(const SceneFile& scene, const std::string& body) {
    return std::any_of(scene.tools.begin(), scene.tools.end(), [&](const ToolSpec& tool) {
        return std::any_of(tool.actions.begin(), tool.actions.end(), [&](const ActionSpec& spec) { return names(spec, body); });
    });
}

void add_scene_actions(const SceneFile& scene, World& world) {
    uint32_t staples = 0;
    for (const ToolSpec& spec : scene.tools) {
        for (const ActionSpec& action : spec.actions) {
            add_action(scene, action, tool_row_of(scene, spec, world), world);
            if (action.action.kind == ActionKind::kStaple) staples += action.action.magazine;
        }
    }
    if (staples == 0) return;
    reserve_links(world.links, world.links.node.capacity() + staples, staples);
    world.action_state.staple.reserve(staples);
}

}  // namespace trocar
