#include <algorithm>

#include "engine/best_fit_rotation.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/keyframe_path.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

std::span<const Keyframe> keys_of(const Paths& paths, uint32_t path) {
    return std::span(paths.key).subspan(paths.keys[path].first, paths.keys[path].count);
}

void set_pose(AdvanceRigid& rigid, int end, Vec4d origin, const Quat& orientation) {
    rigid.place[end].shift = origin;
    rigid.orientation[end] = orientation;
    for (int i = 0; i < 3; ++i) rigid.place[end].column[i] = to_vec4(rotate(orientation, Vec3d::Unit(i)));
}

// Row of the jaw that a body is, or kNone.
uint32_t jaw_of(const AdvanceInputs& in, uint32_t body) {
    for (uint32_t j = 0; j < in.jaws.size(); ++j)
        if (in.jaws[j].body == body) return j;
    return kNone;
}

// Where the grip puts a jaw on its tool at a moment of the call.
void place_jaw(const AdvanceIsland& island, AdvanceRigid& rigid, int end, Vec4d tool_origin, const Quat& tool_turn, uint32_t substep) {
    const ToolJaw& jaw = island.inputs.jaws[rigid.jaw];
    const double angle = jaw.share * hand_pose(island, island.scratch.rigid[rigid.holder].tool, substep).grip;
    const Quat on_tool = multiply(from_rotation_vector(angle * jaw.axis), jaw.closed);
    set_pose(rigid, end, tool_origin + to_vec4(rotate(tool_turn, jaw.pivot)), normalized(multiply(tool_turn, on_tool)));
}

// A jaw moves with its tool's node, so that what presses on it presses on the tool, and turns beside it.
uint32_t jaw_slot(AdvanceIsland& island, uint32_t row) {
    AdvanceScratch& s = island.scratch;
    const auto tools = island.inputs.tools;
    const auto tool =
        std::find_if(tools.begin(), tools.end(), [&](const HandTool& t) { return row >= t.jaws.first && row < t.jaws.end(); });
    const uint32_t holder = rigid_slot(island, tool->body), slot = static_cast<uint32_t>(s.rigid.size());
    AdvanceRigid& rigid = s.rigid.emplace_back();
    rigid.body = island.inputs.jaws[row].body;
    rigid.velocity = RigidMap{};
    rigid.jaw = row;
    rigid.holder = holder;
    rigid.node = s.rigid[holder].node;
    rigid.free = s.rigid[holder].free;
    s.slot_of_body[rigid.body] = slot;
    place_jaw(island, rigid, 1, s.rigid[holder].place[1].shift, s.rigid[holder].orientation[1], 0);
    rigid.place[0] = rigid.place[1];
    rigid.orientation[0] = rigid.orientation[1];
    return slot;
}

// The turn of a jaw and the way of its pivot about the tool's origin in a substep; the tool's own way is the node's.
void turn_jaw(const AdvanceIsland& island, AdvanceRigid& rigid, uint32_t substep) {
    const AdvanceRigid& tool = island.scratch.rigid[rigid.holder];
    place_jaw(island, rigid, 0, tool.place[0].shift, tool.orientation[0], substep);
    place_jaw(island, rigid, 1, tool.place[0].shift, tool.orientation[1], substep + 1);
    rigid.velocity.shift = (rigid.place[1].shift - rigid.place[0].shift) / island.dt;
    for (int i = 0; i < 3; ++i) rigid.velocity.column[i] = (rigid.place[1].column[i] - rigid.place[0].column[i]) / island.dt;
    rigid.grip_velocity = rigid.velocity;
}

}  // namespace

void note_spin(AdvanceScratch& s, const AdvanceFree& f) {
    for (AdvanceRigid& rigid : s.rigid) {
        if (rigid.free == kNone || &s.free[rigid.free] != &f) continue;
        const RigidMap& place = rigid.place[0];
        rigid.velocity = rigid.jaw == kNone ? RigidMap{} : rigid.grip_velocity;
        for (int i = 0; i < 3; ++i) rigid.velocity.column[i] += cross(f.spin, place.column[i]);
        rigid.velocity.shift += cross(f.spin, place.shift - s.node[rigid.node].place);
    }
}

void carry_jaws(AdvanceIsland& island, uint32_t substep) {
    for (AdvanceRigid& rigid : island.scratch.rigid) {
        if (rigid.jaw == kNone || rigid.free == kNone) continue;
        const AdvanceRigid& tool = island.scratch.rigid[rigid.holder];
        place_jaw(island, rigid, 1, tool.place[1].shift, tool.orientation[1], substep);
    }
}

void add_grip_moment(AdvanceIsland& island, uint32_t rigid_row, Vec4d at, Vec4d impulse) {
    const AdvanceRigid& rigid = island.scratch.rigid[rigid_row];
    if (rigid.jaw == kNone) return;
    const AdvanceRigid& tool = island.scratch.rigid[rigid.holder];
    const ToolJaw& jaw = island.inputs.jaws[rigid.jaw];
    const Vec4d axis = tool.place[0].turn(to_vec4(jaw.axis));
    island.tools[tool.tool].grip_moment += jaw.share * dot(axis, cross(at - rigid.place[0].shift, impulse));
}

HandPose hand_pose(const AdvanceIsland& island, uint32_t t, uint32_t substep) {
    const AdvanceParams& params = island.params;
    const uint32_t ms = std::min(substep * params.ticks / params.substeps, params.ticks - 1);
    const double share = static_cast<double>(substep * params.ticks - ms * params.substeps) / params.substeps;
    const DeviceState* device = island.inputs.devices.data() + size_t{t} * island.inputs.device_stride + ms;
    const Vec3d tip = device[0].position + share * (device[1].position - device[0].position);
    const Quat orientation = normalized(
        multiply(from_rotation_vector(share * rotation_vector(device[0].orientation, device[1].orientation)), device[0].orientation));
    return {tip - rotate(orientation, island.inputs.tools[t].tip), orientation, device[0].grip + share * (device[1].grip - device[0].grip)};
}

double substep_time(const AdvanceParams& params, uint32_t substep) {
    const uint64_t steps = params.tick * params.substeps + uint64_t{params.ticks} * substep;
    return 1e-3 * (static_cast<double>(steps) / params.substeps);
}

uint32_t rigid_slot(AdvanceIsland& island, uint32_t body) {
    AdvanceScratch& s = island.scratch;
    if (s.slot_of_body[body] != kNone) return s.slot_of_body[body];
    if (const uint32_t jaw = jaw_of(island.inputs, body); jaw != kNone) return jaw_slot(island, jaw);
    const uint32_t slot = static_cast<uint32_t>(s.rigid.size());
    s.slot_of_body[body] = slot;
    AdvanceRigid& rigid = s.rigid.emplace_back();
    rigid.body = body;
    rigid.velocity = RigidMap{};
    const AdvanceInputs& in = island.inputs;
    if (in.bodies.motion[body] == Motion::kKinematic) {
        const auto path = std::find(in.paths.body.begin(), in.paths.body.end(), body);
        if (path != in.paths.body.end()) rigid.path = static_cast<uint32_t>(path - in.paths.body.begin());
    }
    if (in.bodies.motion[body] == Motion::kHand) {
        const auto tool = std::find_if(in.tools.begin(), in.tools.end(), [&](const HandTool& t) { return t.body == body; });
        if (tool != in.tools.end()) rigid.tool = static_cast<uint32_t>(tool - in.tools.begin());
    }
    if (rigid.tool != kNone && in.tools[rigid.tool].inertia > 0 && in.bodies.inv_mass[body] > 0) {
        add_held_body(island, slot);
    } else if (in.bodies.motion[body] == Motion::kHand) {
        rigid.node = static_cast<uint32_t>(s.node.size());
        const ContactNode node = add_node(s);
        node.owner = slot;
        node.inv_mass = in.bodies.inv_mass[body];
        node.place = to_vec4(island.poses.origin[body]);
        node.velocity = to_vec4(island.poses.velocity[body]);
    }
    if (in.bodies.motion[body] == Motion::kFree) add_free_body(island, slot);
    if (rigid.path != kNone) {
        const PathPoint at = sample_path(keys_of(in.paths, rigid.path), substep_time(island.params, 0));
        set_pose(rigid, 1, to_vec4(at.position), at.orientation);
    } else {
        set_pose(rigid, 1, to_vec4(island.poses.origin[body]), island.poses.orientation[body]);
    }
    rigid.place[0] = rigid.place[1];
    rigid.orientation[0] = rigid.orientation[1];
    return slot;
}

void place_rigid_bodies(AdvanceIsland& island, uint32_t substep) {
    const AdvanceInputs& in = island.inputs;
    for (AdvanceRigid& rigid : island.scratch.rigid) {
        rigid.place[0] = rigid.place[1];
        rigid.orientation[0] = rigid.orientation[1];
        if (rigid.jaw != kNone) {
            turn_jaw(island, rigid, substep);
            continue;
        }
        if (rigid.path == kNone && (rigid.tool == kNone || rigid.free != kNone)) continue;
        if (rigid.tool != kNone) {
            // the hand turns with the device; its translation follows in pull_hands
            set_pose(rigid, 1, rigid.place[0].shift, hand_pose(island, rigid.tool, substep + 1).orientation);
        } else {
            const auto keys = keys_of(in.paths, rigid.path);
            const double from = substep_time(island.params, substep), to = substep_time(island.params, substep + 1);
            const PathPoint at = sample_path(keys, to);
            set_pose(rigid, 1, to_vec4(at.position), at.orientation);
            // a body that jumps is at its new place for the whole substep: a jump has no velocity
            if (path_jumps(keys, from, to)) set_pose(rigid, 0, to_vec4(at.position), at.orientation);
            rigid.velocity.shift = (rigid.place[1].shift - rigid.place[0].shift) / island.dt;
        }
        for (int i = 0; i < 3; ++i) {
            rigid.velocity.column[i] = (rigid.place[1].column[i] - rigid.place[0].column[i]) / island.dt;
        }
    }
}

void pull_hands(AdvanceIsland& island, uint32_t substep) {
    for (AdvanceRigid& rigid : island.scratch.rigid) {
        if (rigid.node == kNone || rigid.free != kNone || rigid.jaw != kNone) continue;
        const ContactNode node = island.scratch.node[rigid.node];
        const ContactNodeChange change = island.scratch.change[rigid.node];
        change.before = node.velocity;
        if (rigid.tool == kNone) {
            node.velocity = Vec4d{};  // nobody holds it
            continue;
        }
        const HandTool& tool = island.inputs.tools[rigid.tool];
        const Vec3d from = hand_pose(island, rigid.tool, substep).origin;
        const Vec3d to = hand_pose(island, rigid.tool, substep + 1).origin;
        const double dt = island.dt, w = island.inputs.bodies.inv_mass[rigid.body];
        const double k = tool.coupling_stiffness, b = tool.coupling_damping;
        rigid.target = to;
        rigid.target_velocity = (to - from) / dt;
        if (w > 0) {
            // spring and damper act with their values at the end of the substep: stable for any dt, mass and stiffness.
            // They resist the rows' impulses too, as if the hand were that much heavier
            node.inv_mass = w / (1 + dt * w * (b + k * dt));
            const Vec4d pull = k * (to_vec4(to) - node.place) + b * to_vec4(rigid.target_velocity);
            node.velocity = node.inv_mass * (node.velocity / w + dt * pull);
        } else {
            node.velocity = (to_vec4(to) - node.place) / dt;
        }
    }
}

void move_hands(AdvanceIsland& island) {
    for (AdvanceRigid& rigid : island.scratch.rigid) {
        if (rigid.node == kNone || rigid.free != kNone) continue;
        const ContactNode node = island.scratch.node[rigid.node];
        if (rigid.jaw != kNone) {
            rigid.place[1].shift += node.place - island.scratch.rigid[rigid.holder].place[0].shift;
            continue;
        }
        node.place += moving_time(island, rigid.body) * node.velocity;
        node.after = node.place;
        rigid.place[1].shift = node.place;
        if (rigid.tool == kNone) continue;
        const HandTool& tool = island.inputs.tools[rigid.tool];
        island.tools[rigid.tool].coupling_force = tool.coupling_stiffness * (rigid.target - to_vec3(node.place)) +
                                                  tool.coupling_damping * (rigid.target_velocity - to_vec3(node.velocity));
    }
}

}  // namespace trocar
