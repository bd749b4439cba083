#include "systems/advance/rigid/rigid_bodies.hpp"

#include <algorithm>

#include "engine/geometry/best_fit_rotation.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/motion/keyframe_path.hpp"
#include "systems/advance/rigid/free_bodies.hpp"
#include "systems/advance/rigid/held_tools.hpp"
namespace trocar {
namespace {

std::span<const Keyframe> keys_of(const Paths& paths, uint32_t path) {
    return std::span(paths.key).subspan(paths.keys[path].first, paths.keys[path].count);
}

void set_pose(AdvanceRigid& rigid, int end, Vec4d origin, const Quat& orientation) {
    rigid.pose[end].shift = origin;
    rigid.orientation[end] = orientation;
    for (int i = 0; i < 3; ++i) rigid.pose[end].column[i] = to_vec4(rotate(orientation, Vec3d::Unit(i)));
}

// Index of a body's jaw, or kNone.
uint32_t jaw_of(const AdvanceInputs& in, uint32_t body) {
    for (uint32_t j = 0; j < in.jaws.size(); ++j)
        if (in.jaws[j].body == body) return j;
    return kNone;
}

struct ToolPose {
    Vec4d origin;  // m
    const Quat& turn;
};
// Puts a jaw at its grip angle on its tool at the start of a substep.
void place_jaw(const AdvanceCall& call, const AdvanceIsland& island, int end, const ToolPose& tool, uint32_t substep, AdvanceRigid& rigid) {
    const ToolJaw& jaw = call.inputs.jaws[rigid.jaw];
    const double angle = jaw.share * hand_pose(call, island.rigid[rigid.holder].tool, substep).grip;
    const Quat on_tool = multiply(from_rotation_vector(angle * jaw.axis), jaw.closed);
    set_pose(rigid, end, tool.origin + to_vec4(rotate(tool.turn, jaw.pivot)), normalized(multiply(tool.turn, on_tool)));
}

// A jaw shares its tool's node, so that loads on it act on the tool, but rotates separately.
uint32_t jaw_slot(const AdvanceCall& call, uint32_t jaw, AdvanceIsland& island, const AdvanceState& state) {
    const auto tools = call.inputs.tools;
    const auto tool =
        std::find_if(tools.begin(), tools.end(), [&](const HandTool& t) { return jaw >= t.jaws.first && jaw < t.jaws.end(); });
    const uint32_t holder = rigid_slot(call, tool->body, island, state), slot = static_cast<uint32_t>(island.rigid.size());
    AdvanceRigid& rigid = island.rigid.emplace_back();
    rigid.body = call.inputs.jaws[jaw].body;
    rigid.velocity = RigidMap{};
    rigid.jaw = jaw;
    rigid.holder = holder;
    rigid.node = island.rigid[holder].node;
    rigid.free = island.rigid[holder].free;
    island.slot_of_body[rigid.body] = slot;
    place_jaw(call, island, 1, {island.rigid[holder].pose[1].shift, island.rigid[holder].orientation[1]}, 0, rigid);
    rigid.pose[0] = rigid.pose[1];
    rigid.orientation[0] = rigid.orientation[1];
    return slot;
}

// Rotation of a jaw and displacement of its pivot about the tool's origin; the node moves the tool.
void turn_jaw(const AdvanceCall& call, const AdvanceIsland& island, AdvanceRigid& rigid) {
    const AdvanceRigid& tool = island.rigid[rigid.holder];
    place_jaw(call, island, 0, {tool.pose[0].shift, tool.orientation[0]}, call.substep, rigid);
    place_jaw(call, island, 1, {tool.pose[0].shift, tool.orientation[1]}, call.substep + 1, rigid);
    rigid.velocity.shift = (rigid.pose[1].shift - rigid.pose[0].shift) / call.dt;
    for (int i = 0; i < 3; ++i) rigid.velocity.column[i] = (rigid.pose[1].column[i] - rigid.pose[0].column[i]) / call.dt;
    rigid.grip_velocity = rigid.velocity;
}

}  // namespace

void note_spin(const AdvanceFree& f, AdvanceIsland& island) {
    for (AdvanceRigid& rigid : island.rigid) {
        if (rigid.free == kNone || &island.free[rigid.free] != &f) continue;
        const RigidMap& pose = rigid.pose[0];
        rigid.velocity = rigid.jaw == kNone ? RigidMap{} : rigid.grip_velocity;
        for (int i = 0; i < 3; ++i) rigid.velocity.column[i] += cross(f.spin, pose.column[i]);
        rigid.velocity.shift += cross(f.spin, pose.shift - island.nodes.node[rigid.node].position);
    }
}

void carry_jaws(const AdvanceCall& call, uint32_t substep, AdvanceIsland& island) {
    for (AdvanceRigid& rigid : island.rigid) {
        if (rigid.jaw == kNone || rigid.free == kNone) continue;
        const AdvanceRigid& tool = island.rigid[rigid.holder];
        place_jaw(call, island, 1, {tool.pose[1].shift, tool.orientation[1]}, substep, rigid);
    }
}

void add_grip_moment(const AdvanceCall& call, const AdvanceIsland& island, uint32_t rigid_index, Vec4d at, Vec4d impulse,
                     std::span<ToolState> tools) {
    const AdvanceRigid& rigid = island.rigid[rigid_index];
    if (rigid.jaw == kNone) return;
    const AdvanceRigid& tool = island.rigid[rigid.holder];
    const ToolJaw& jaw = call.inputs.jaws[rigid.jaw];
    const Vec4d axis = tool.pose[0].turn(to_vec4(jaw.axis));
    tools[tool.tool].grip_moment += jaw.share * dot(axis, cross(at - rigid.pose[0].shift, impulse));
}

HandPose hand_pose(const AdvanceCall& call, uint32_t t, uint32_t substep) {
    const AdvanceParams& params = call.params;
    const uint32_t ms = std::min(substep * params.ticks / params.substeps, params.ticks - 1);
    const double share = static_cast<double>(substep * params.ticks - ms * params.substeps) / params.substeps;
    const DeviceState* device = call.inputs.devices.data() + size_t{t} * call.inputs.device_stride + ms;
    const Vec3d tip = device[0].position + share * (device[1].position - device[0].position);
    const Quat orientation = normalized(
        multiply(from_rotation_vector(share * rotation_vector(device[0].orientation, device[1].orientation)), device[0].orientation));
    return {tip - rotate(orientation, call.inputs.tools[t].tip), orientation, device[0].grip + share * (device[1].grip - device[0].grip)};
}

double substep_time(const AdvanceParams& params, uint32_t substep) {
    const uint64_t steps = params.tick * params.substeps + uint64_t{params.ticks} * substep;
    return 1e-3 * (static_cast<double>(steps) / params.substeps);
}

uint32_t rigid_slot(const AdvanceCall& call, uint32_t body, AdvanceIsland& island, const AdvanceState& state) {
    if (island.slot_of_body[body] != kNone) return island.slot_of_body[body];
    if (const uint32_t jaw = jaw_of(call.inputs, body); jaw != kNone) return jaw_slot(call, jaw, island, state);
    const uint32_t slot = static_cast<uint32_t>(island.rigid.size());
    island.slot_of_body[body] = slot;
    AdvanceRigid& rigid = island.rigid.emplace_back();
    rigid.body = body;
    rigid.velocity = RigidMap{};
    const AdvanceInputs& in = call.inputs;
    if (in.bodies.motion[body] == Motion::kKinematic) {
        const auto path = std::find(in.paths.body.begin(), in.paths.body.end(), body);
        if (path != in.paths.body.end()) rigid.path = static_cast<uint32_t>(path - in.paths.body.begin());
    }
    if (in.bodies.motion[body] == Motion::kHand) {
        const auto tool = std::find_if(in.tools.begin(), in.tools.end(), [&](const HandTool& t) { return t.body == body; });
        if (tool != in.tools.end()) rigid.tool = static_cast<uint32_t>(tool - in.tools.begin());
    }
    if (rigid.tool != kNone && in.tools[rigid.tool].inertia > 0 && in.bodies.inv_mass[body] > 0) {
        add_held_body(call, state.poses, slot, island);
    } else if (in.bodies.motion[body] == Motion::kHand) {
        rigid.node = static_cast<uint32_t>(island.nodes.node.size());
        const ContactNode node = add_node(island.nodes);
        node.owner = slot;
        node.inv_mass = in.bodies.inv_mass[body];
        node.position = to_vec4(state.poses.origin[body]);
        node.velocity = to_vec4(state.poses.velocity[body]);
    }
    if (in.bodies.motion[body] == Motion::kFree) add_free_body(call, slot, island, state);
    if (rigid.path != kNone) {
        const PathPoint at = sample_path(keys_of(in.paths, rigid.path), substep_time(call.params, 0));
        set_pose(rigid, 1, to_vec4(at.position), at.orientation);
    } else {
        set_pose(rigid, 1, to_vec4(state.poses.origin[body]), state.poses.orientation[body]);
    }
    rigid.pose[0] = rigid.pose[1];
    rigid.orientation[0] = rigid.orientation[1];
    return slot;
}

void place_rigid_bodies(const AdvanceCall& call, AdvanceIsland& island) {
    const uint32_t substep = call.substep;
    const AdvanceInputs& in = call.inputs;
    for (AdvanceRigid& rigid : island.rigid) {
        rigid.pose[0] = rigid.pose[1];
        rigid.orientation[0] = rigid.orientation[1];
        if (rigid.jaw != kNone) {
            turn_jaw(call, island, rigid);
            continue;
        }
        if (rigid.path == kNone && (rigid.tool == kNone || rigid.free != kNone)) continue;
        if (rigid.tool != kNone) {
            // the hand rotates with the device; its translation follows in pull_hands
            set_pose(rigid, 1, rigid.pose[0].shift, hand_pose(call, rigid.tool, substep + 1).orientation);
        } else {
            const auto keys = keys_of(in.paths, rigid.path);
            const double from = substep_time(call.params, substep), to = substep_time(call.params, substep + 1);
            const PathPoint at = sample_path(keys, to);
            set_pose(rigid, 1, to_vec4(at.position), at.orientation);
            // a jumping body is at its new position for the whole substep: a jump has no velocity
            if (path_jumps(keys, from, to)) set_pose(rigid, 0, to_vec4(at.position), at.orientation);
            rigid.velocity.shift = (rigid.pose[1].shift - rigid.pose[0].shift) / call.dt;
        }
        for (int i = 0; i < 3; ++i) {
            rigid.velocity.column[i] = (rigid.pose[1].column[i] - rigid.pose[0].column[i]) / call.dt;
        }
    }
}

void pull_hands(const AdvanceCall& call, AdvanceIsland& island) {
    const uint32_t substep = call.substep;
    for (AdvanceRigid& rigid : island.rigid) {
        if (rigid.node == kNone || rigid.free != kNone || rigid.jaw != kNone) continue;
        const ContactNode node = island.nodes.node[rigid.node];
        const ContactNodeChange change = island.nodes.change[rigid.node];
        change.before = node.velocity;
        if (rigid.tool == kNone) {
            node.velocity = Vec4d{};  // not in the hand
            continue;
        }
        const HandTool& tool = call.inputs.tools[rigid.tool];
        const Vec3d from = hand_pose(call, rigid.tool, substep).origin;
        const Vec3d to = hand_pose(call, rigid.tool, substep + 1).origin;
        const double dt = call.dt, w = call.inputs.bodies.inv_mass[rigid.body];
        const double k = tool.coupling_stiffness, b = tool.coupling_damping;
        rigid.target = to;
        rigid.target_velocity = (to - from) / dt;
        if (w > 0) {
            // spring and damper act with their values at the end of the substep: stable for any dt, mass and
            // stiffness. They resist the contact impulses too, as if the hand were that much heavier
            node.inv_mass = w / (1 + dt * w * (b + k * dt));
            const Vec4d pull = k * (to_vec4(to) - node.position) + b * to_vec4(rigid.target_velocity);
            node.velocity = node.inv_mass * (node.velocity / w + dt * pull);
        } else {
            node.velocity = (to_vec4(to) - node.position) / dt;
        }
    }
}

void move_hands(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools) {
    for (AdvanceRigid& rigid : island.rigid) {
        if (rigid.node == kNone || rigid.free != kNone) continue;
        const ContactNode node = island.nodes.node[rigid.node];
        if (rigid.jaw != kNone) {
            rigid.pose[1].shift += node.position - island.rigid[rigid.holder].pose[0].shift;
            continue;
        }
        node.position += moving_time(call, rigid.body) * node.velocity;
        node.after = node.position;
        rigid.pose[1].shift = node.position;
        if (rigid.tool == kNone) continue;
        const HandTool& tool = call.inputs.tools[rigid.tool];
        tools[rigid.tool].coupling_force = tool.coupling_stiffness * (rigid.target - to_vec3(node.position)) +
                                           tool.coupling_damping * (rigid.target_velocity - to_vec3(node.velocity));
    }
}

}  // namespace trocar
