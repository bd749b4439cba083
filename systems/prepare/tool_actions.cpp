#include "systems/prepare/tool_actions.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

// Whether the trigger is pulled at the start of this pass. Of times, every second one ends what the one before began.
bool is_pulled(const ActionPass& pass, const ToolAction& action, ActionProgress& progress) {
    const ToolState& hand = pass.states[action.tool];
    const bool laid_down = pass.node_state && action.tool < pass.node_state->laid_down.size() && pass.node_state->laid_down[action.tool];
    if (laid_down) return false;
    switch (action.when) {
        case ActionTrigger::kButton:
            return (hand.device.buttons & action.buttons) != 0;
        case ActionTrigger::kGrip:
            return hand.device.grip < action.grip;
        case ActionTrigger::kForce:
            return hand.command.force.norm() > action.force;
        case ActionTrigger::kAlways:
            return true;
        case ActionTrigger::kTimes:
            break;
    }
    while (progress.next < action.times.count && pass.now >= pass.actions.time[action.times.first + progress.next]) ++progress.next;
    return progress.next % 2 != 0;
}

// Number of times that a trigger was pulled since the last pass: one per rise, or per time that has come.
uint32_t count_pulls(const ActionPass& pass, const ToolAction& action, ActionProgress& progress) {
    const uint32_t before = progress.next;
    const bool was_on = progress.on;
    progress.on = is_pulled(pass, action, progress);
    if (action.when == ActionTrigger::kTimes) return progress.next - before;
    return progress.on && !was_on ? 1 : 0;
}

bool is_part_of(const ActionPass& pass, const HandTool& tool, uint32_t body) {
    const auto jaws = pass.jaws.subspan(tool.jaws.first, tool.jaws.count);
    return body == tool.body || std::any_of(jaws.begin(), jaws.end(), [&](const ToolJaw& jaw) { return jaw.body == body; });
}

bool is_there(const ActionPass& pass, uint32_t body) {
    const bool away = pass.spawning && body < pass.spawning->away.size() && is_away(*pass.spawning, body);
    const bool off = pass.node_state && body < pass.node_state->off.size() && is_off(*pass.node_state, body);
    return !away && !off && pass.world.surfaces.bodies.mesh[body] != kNone;
}

// The two nearest surfaces to a point, nearest first. Other hands' instruments are nothing to be stapled.
std::array<StapledSurface, 2> two_nearest(const ActionPass& pass, const ToolAction& action, const Vec3d& point) {
    std::array<StapledSurface, 2> best;
    const Bodies& bodies = pass.world.surfaces.bodies;
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body) {
        if (bodies.motion[body] == Motion::kHand || is_part_of(pass, pass.tools[action.tool], body) || !is_there(pass, body)) continue;
        const StapledSurface here = nearest_surface(pass.world, body, point, action.reach);
        if (here.distance < best[0].distance)
            best[1] = best[0], best[0] = here;
        else if (here.distance < best[1].distance)
            best[1] = here;
    }
    return best;
}

// A free slot, so that a link group needs no memory.
bool any_free_group(const Links& links) {
    return std::any_of(links.group.begin(), links.group.end(), [](const LinkGroup& g) { return g.body == kNone; });
}

// A group of links in the world's frame that holds `held` at a point, in a free slot.
LinkGroup group_at(const ActionPass& pass, const ToolAction& action, uint32_t held, uint32_t holder, const Vec3d& point, double radius) {
    const Surfaces& s = pass.world.surfaces;
    LinkGroup g;
    g.body = held, g.holder = holder;
    g.frame = RegionFrame::kWorld;
    g.region = {RegionKind::kSphere, point, point, radius};
    // of a grasp, action.stiffness is that of its pads
    g.stiffness = action.kind == ActionKind::kStaple && action.stiffness > 0 ? action.stiffness
                                                                             : 4 * static_cast<double>(s.bodies.spring_stiffness[held]);
    g.gauge = s.meshes.info[s.bodies.mesh[held]].mean_edge;
    g.begin = pass.now;
    return g;
}

// Makes the links of a group; an unset name if there was nothing to hold.
Entity hold(const ActionPass& pass, const LinkGroup& group, LinkScratch& scratch, Links& links, Energy& energy) {
    const Entity name = add_link_group(links, group);
    if (make_links(pass.world, name.index, scratch, links, energy) > 0) return name;
    free_link_group(links, name, energy);
    return {};
}

// Sets one staple at a point. False if there is nothing to hold.
bool set_staple(const ActionPass& pass, uint32_t index, const Vec3d& point, LinkScratch& scratch, ActionState& state, Links& links,
                Sleep& sleep, Energy& energy) {
    const ToolAction& action = pass.actions.action[index];
    const Surfaces& s = pass.world.surfaces;
    const auto near = two_nearest(pass, action, point);
    if (near[1].body == kNone || !any_free_group(links)) return false;
    uint32_t held = near[0].body, holder = near[1].body;
    if (!is_deformable(s.bodies, held)) std::swap(held, holder);
    if (!is_deformable(s.bodies, held)) return false;
    // a point of a triangle is at most an edge, stretched to twice its length, from the nearest node
    LinkGroup g = group_at(pass, action, held, holder, point, action.reach + 2 * s.meshes.info[s.bodies.mesh[held]].max_edge);
    g.name = "staple " + std::to_string(state.progress[index].done + 1) + " of " + s.bodies.name[pass.tools[action.tool].body];
    g.most = 1;
    const Entity name = hold(pass, g, scratch, links, energy);
    if (name == Entity{}) return false;
    LinkGroup& made = links.group[name.index];
    const double rest = links.rest[made.links.first];
    made.break_strain = action.pull_out / (made.stiffness * (rest > 0 ? rest : made.gauge));
    const HandTool& tool = pass.tools[action.tool];
    state.staple.push_back({index, name, rotate(s.poses.orientation[tool.body], Vec3d::UnitX())});
    wake_body(sleep, held), wake_body(sleep, holder);
    return true;
}

// Counts the staples that no longer hold, and frees their groups.
bool forget_pulled(ActionState& state, Links& links, Energy& energy) {
    const size_t before = state.staple.size();
    std::erase_if(state.staple, [&](const ToolStaple& staple) {
        const uint32_t group = find_link_group(links, staple.group);
        if (group != kNone) {
            const Range range = links.group[group].links;
            ActionProgress& progress = state.progress[staple.action];
            progress.largest_force = std::max(progress.largest_force, links.group[group].largest_force);
            bool holds = false;
            for (uint32_t i = range.first; i < range.end(); ++i) holds = holds || links.whole[i];
            if (holds) return false;
            // what it held still rings
            state.released.push_back(links.group[group].body), state.released.push_back(links.group[group].holder);
            free_link_group(links, staple.group, energy);
        }
        ++state.progress[staple.action].pulled_out;
        return true;
    });
    return state.staple.size() != before;
}

// Nodes of a deformable body that one grasp holds at most; as many are reserved at load (build_actions.cpp).
constexpr uint32_t kGraspNodes = 64;

bool grasp_tissue(const ActionPass& pass, uint32_t index, uint32_t body, const Vec3d& point, LinkScratch& scratch, ToolGrasp& grasp,
                  Links& links, Energy& energy) {
    if (!any_free_group(links)) return false;
    const ToolAction& action = pass.actions.action[index];
    const Surfaces& s = pass.world.surfaces;
    LinkGroup g = group_at(pass, action, body, pass.tools[action.tool].body, point, action.reach);
    g.name = "grasp of " + s.bodies.name[pass.tools[action.tool].body];
    g.most = kGraspNodes;
    grasp.group = hold(pass, g, scratch, links, energy);
    if (grasp.group == Entity{}) {  // of a coarse mesh
        g.region.radius += 2 * s.meshes.info[s.bodies.mesh[body]].max_edge, g.most = 1;
        grasp.group = hold(pass, g, scratch, links, energy);
    }
    return !(grasp.group == Entity{});
}

bool has_one_coordinate(const ActionPass& pass, uint32_t body) {
    return pass.nodes && std::any_of(pass.nodes->drive.begin(), pass.nodes->drive.end(), [&](const auto& d) { return d.body == body; });
}

// Holds what lies at a point. Returns whether anything does.
bool begin_grasp(const ActionPass& pass, uint32_t index, const Vec3d& point, LinkScratch& scratch, ActionState& state, Links& links,
                 Sleep& sleep, Energy& energy) {
    const ToolAction& action = pass.actions.action[index];
    const HandTool& tool = pass.tools[action.tool];
    const Surfaces& s = pass.world.surfaces;
    bool any = false;
    for (uint32_t body = 0; body < s.bodies.mesh.size(); ++body) {
        const bool soft = is_deformable(s.bodies, body), free = s.bodies.motion[body] == Motion::kFree && !has_one_coordinate(pass, body);
        if ((!soft && !free) || is_part_of(pass, tool, body) || !is_there(pass, body)) continue;
        if (nearest_surface(pass.world, body, point, action.reach).body == kNone) continue;
        ToolGrasp grasp;
        grasp.action = index, grasp.body = body;
        grasp.point = action.point;
        grasp.arm = world_to_frame(s, body, point);
        grasp.turn = multiply(conjugate(s.poses.orientation[tool.body]), s.poses.orientation[body]);
        if (soft && !grasp_tissue(pass, index, body, point, scratch, grasp, links, energy)) continue;
        state.grasp.push_back(grasp);
        wake_body(sleep, body);
        any = true;
    }
    return any;
}

// Lets go of what a grasp holds.
void let_grasp_go(const ActionPass& pass, const ToolGrasp& grasp, ActionState& state, Links& links, Sleep& sleep, Energy& energy) {
    if (is_deformable(pass.world.surfaces.bodies, grasp.body))
        free_link_group(links, grasp.group, energy), state.released.push_back(grasp.body);
    energy.work_links -= grasp.stored;
    wake_body(sleep, grasp.body);
}

bool has_slipped(const ActionPass& pass, const ToolGrasp& grasp, const Links& links) {
    const ToolAction& action = pass.actions.action[grasp.action];
    if (!is_deformable(pass.world.surfaces.bodies, grasp.body)) return grasp.slipped > action.reach;
    const uint32_t group = find_link_group(links, grasp.group);
    return group == kNone || links.group[group].largest_force > 2 * action.friction * action.press_force;
}

// Ends grasps whose trigger is free, whose body is away, or that slipped. Returns whether links changed.
bool end_grasps(const ActionPass& pass, ActionState& state, Links& links, Sleep& sleep, Energy& energy) {
    bool changed = false;
    std::erase_if(state.grasp, [&](ToolGrasp& grasp) {
        ActionProgress& progress = state.progress[grasp.action];
        const bool slipped = has_slipped(pass, grasp, links);
        progress.largest_force = std::max(progress.largest_force, grasp.largest_force);
        grasp.impulse.setZero(), grasp.moment.setZero();
        if (!slipped && progress.on && is_there(pass, grasp.body)) return false;
        progress.slips += slipped;
        let_grasp_go(pass, grasp, state, links, sleep, energy);
        return changed = true;
    });
    return changed;
}

}  // namespace

StapledSurface nearest_surface(const LinkWorld& world, uint32_t body, const Vec3d& point, double reach) {
    const Surfaces& s = world.surfaces;
    StapledSurface near;
    const Vec3d local = world_to_frame(s, body, point);
    if (!is_deformable(s.bodies, body)) {
        const uint32_t tree = s.bodies.tree[body];
        if (tree >= world.trees.size() || !world.trees[tree]) return near;
        const SurfacePoint hit = world.trees[tree]->query(local, reach);
        // inside a closed body the distance is negative
        if (hit.triangle != kNone && std::abs(hit.distance) <= reach) near = {body, std::abs(hit.distance)};
        return near;
    }
    double squared = reach * reach;
    for (const Triangle& t : mesh_view(s.meshes, s.bodies.mesh[body]).triangle) {
        const TrianglePoint p = closest_point_on_triangle(local, vertex_in_frame(s, body, t[0]), vertex_in_frame(s, body, t[1]),
                                                          vertex_in_frame(s, body, t[2]));
        if (p.squared_distance <= squared) squared = p.squared_distance, near = {body, std::sqrt(squared)};
    }
    return near;
}

void act(const ActionPass& pass, LinkScratch& scratch, ActionState& state, Links& links, Sleep& sleep, Energy& energy) {
    state.released.clear();
    bool changed = forget_pulled(state, links, energy);
    for (uint32_t index = 0; index < pass.actions.action.size(); ++index) {
        const ToolAction& action = pass.actions.action[index];
        ActionProgress& progress = state.progress[index];
        const bool held = progress.on;
        const uint32_t pulls = count_pulls(pass, action, progress);
        const HandTool& tool = pass.tools[action.tool];
        const Vec3d point = frame_to_world(pass.world.surfaces, tool.body, action.point);
        if (action.kind == ActionKind::kGrasp && progress.on && !held)
            begin_grasp(pass, index, point, scratch, state, links, sleep, energy) ? ++progress.done : ++progress.misfires, changed = true;
        if (action.kind != ActionKind::kStaple) continue;
        for (uint32_t pull = 0; pull < pulls; ++pull) {
            const bool pressed = !(pass.states[action.tool].command.force.norm() < action.press);
            const bool left = progress.done < action.magazine;
            if (pressed && left && set_staple(pass, index, point, scratch, state, links, sleep, energy))
                ++progress.done, changed = true;
            else
                ++progress.misfires;
        }
    }
    changed = end_grasps(pass, state, links, sleep, energy) || changed;
    if (changed) {
        const Surfaces& s = pass.world.surfaces;
        update_link_limits(s.bodies, pass.world.solids, s.particles, scratch, links);
    }
}

}  // namespace trocar
