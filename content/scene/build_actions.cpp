#include "content/scene/build_actions.hpp"

#include <algorithm>

#include "content/scene/find_body.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/heat.hpp"
#include "engine/tissue/links.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

bool names(const ActionSpec& spec, const std::string& body) {
    return std::find(spec.bodies.begin(), spec.bodies.end(), body) != spec.bodies.end();
}

// Row of a tool that a scene describes: instruments that the hand changes to have none of their own.
uint32_t tool_row_of(const SceneFile& scene, const ToolSpec& spec, const World& world) {
    return find_of_body(world.haptics.tool, find_body(scene, spec.line, world, spec.body));
}

// Index of a body in heat_body; it is added if it is new.
uint32_t heat_body(const SceneFile& scene, const ActionSpec& spec, uint32_t body, World& world) {
    const std::string where = "a cautery: body \"" + world.bodies.name[body] + "\" ";
    if (!is_deformable(world.bodies, body)) refuse(scene, spec.line, where + "must be deformable");
    if (find_of_body(world.actions.cut_solid, body) != kNone)
        refuse(scene, spec.line, where + "is a solid that instruments cut: its nodes would change");
    const uint32_t cut = find_of_body(world.actions.cut_body, body);
    const uint32_t known = find_of_body(world.actions.heat_body, body);
    if (known != kNone) return known;
    const auto of =
        std::find_if(scene.bodies.begin(), scene.bodies.end(), [&](const BodySpec& b) { return b.name == world.bodies.name[body]; });
    const HeatTissue heat = of == scene.bodies.end() ? HeatTissue{} : of->heat;
    const Tissue& tissue = world.bodies.tissue[body];
    const double wall = world.bodies.thickness[body] > 0 ? world.bodies.thickness[body] : tissue.wall;
    const bool shell = !is_solid(world.solids, world.bodies.mesh[body]);
    if (heat.parts && shell && (has_pressure(world.bodies, body) || has_bending(world.bodies, body)))
        refuse(scene, spec.line, where + "parts where it boils away: set pressure_modulus and bending to 0");
    if (heat.parts && cut != kNone) refuse(scene, spec.line, where + "parts where it boils away, and instruments cut it: one of both");
    if (heat.stiffening > 1 && body < world.bodies.stepping.size() && world.bodies.stepping[body].integrator == Integrator::kBackwardEuler)
        refuse(scene, spec.line, where + "is stepped by backward Euler, whose matrix is constant: take integrator = \"leapfrog\" or stiffening = 1");
    add_heat_body(heat, tissue.density, wall, body, cut, world.bodies, world.meshes, world.solids, world.actions, world.action_state.heat);
    if (heat.stiffening > 1) let_stiffen(world.actions.heat_body.back(), world.springs, world.solids, world.bodies, world.actions);
    return static_cast<uint32_t>(world.actions.heat_body.size() - 1);
}

void add_action(const SceneFile& scene, const ActionSpec& spec, uint32_t tool, World& world) {
    Actions& actions = world.actions;
    ToolAction action = spec.action;
    action.tool = tool;
    if (!spec.point_given) action.point = world.haptics.tool[tool].tip;
    action.times = {static_cast<uint32_t>(actions.time.size()), static_cast<uint32_t>(spec.at.size())};
    actions.time.insert(actions.time.end(), spec.at.begin(), spec.at.end());
    const uint32_t index = static_cast<uint32_t>(actions.action.size());
    const std::string kind = action.kind == ActionKind::kCut ? "a cut: " : "a cautery: ";
    for (const std::string& name : action.kind == ActionKind::kSuture ? std::vector<std::string>{} : spec.bodies) {  // of a suture: add_scene_threads
        const uint32_t body = find_body(scene, spec.line, world, name, kind);
        if (action.kind == ActionKind::kCauterise) {
            actions.heats.push_back({index, heat_body(scene, spec, body, world)});
            continue;
        }
        if (const uint32_t solid = find_of_body(actions.cut_solid, body); solid != kNone) {
            actions.solid_cuts.push_back({index, solid});
            continue;
        }
        const uint32_t cut = find_of_body(actions.cut_body, body);
        if (cut == kNone) refuse(scene, spec.line, "a cut: body \"" + name + "\" must be deformable");
        actions.cuts.push_back({index, cut});
    }
    // pads that give a tenth of a millimetre before what they hold slips: the teeth of a grasper are of that size
    constexpr double kGive = 1e-4;  // m
    if (action.kind == ActionKind::kGrasp && action.stiffness == 0) action.stiffness = 2 * action.friction * action.press_force / kGive;
    actions.action.push_back(action);
    world.action_state.progress.emplace_back();
}

}  // namespace

bool is_heated_by_tools(const SceneFile& scene, const std::string& body) {
    return std::any_of(scene.tools.begin(), scene.tools.end(), [&](const ToolSpec& tool) {
        return std::any_of(tool.actions.begin(), tool.actions.end(),
                           [&](const ActionSpec& spec) { return spec.action.kind == ActionKind::kCauterise && names(spec, body); });
    });
}

bool is_cut_by_tools(const SceneFile& scene, const std::string& body) {
    return std::any_of(scene.tools.begin(), scene.tools.end(), [&](const ToolSpec& tool) {
        return std::any_of(tool.actions.begin(), tool.actions.end(),
                           [&](const ActionSpec& spec) { return spec.action.kind == ActionKind::kCut && names(spec, body); });
    });
}

void add_scene_actions(const SceneFile& scene, World& world) {
    uint32_t staples = 0, grasps = 0;
    for (const ToolSpec& spec : scene.tools) {
        for (const ActionSpec& action : spec.actions) {
            add_action(scene, action, tool_row_of(scene, spec, world), world);
            if (action.action.kind == ActionKind::kStaple) staples += action.action.magazine;
            if (action.action.kind == ActionKind::kGrasp) ++grasps;
        }
    }
    world.action_state.burnt.reserve(world.actions.heat_volume.size());
    if (staples + grasps == 0) return;
    // a grasp: links of 64 nodes of each of two bodies, such as two sheets (tool_actions.cpp)
    reserve_links(world.links, world.links.node.capacity() + staples + 128 * grasps, staples + 2 * grasps);
    world.action_state.staple.reserve(staples), world.action_state.grasp.reserve(4 * grasps);
    world.action_state.released.reserve(4 * grasps + 2 * staples);
}

}  // namespace trocar
