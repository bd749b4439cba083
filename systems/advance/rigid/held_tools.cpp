#include "systems/advance/rigid/held_tools.hpp"

#include "engine/geometry/quaternion.hpp"
#include "systems/advance/rigid/rigid_bodies.hpp"
namespace trocar {

void add_held_body(const AdvanceCall& call, const Poses& poses, uint32_t rigid_index, AdvanceIsland& island) {
    AdvanceRigid& rigid = island.rigid[rigid_index];
    const HandTool& tool = call.inputs.tools[rigid.tool];
    rigid.free = static_cast<uint32_t>(island.free.size());
    rigid.node = static_cast<uint32_t>(island.nodes.node.size());
    AdvanceFree& f = island.free.emplace_back();
    f.held = true;
    f.rigid = rigid_index;
    f.mass.body = rigid.body;
    f.mass.mass = 1 / call.inputs.bodies.inv_mass[rigid.body];
    f.mass.centre = tool.tip;
    f.mass.moments = Vec3d::Constant(tool.inertia);
    f.centre = to_vec4(tool.tip);
    f.spin = to_vec4(poses.angular_velocity[rigid.body]);
    const Vec4d arm = to_vec4(rotate(poses.orientation[rigid.body], tool.tip));
    const ContactNode node = add_node(island.nodes);
    node.owner = rigid_index;
    node.inv_mass = call.inputs.bodies.inv_mass[rigid.body];
    node.position = to_vec4(poses.origin[rigid.body]) + arm;
    node.velocity = to_vec4(poses.velocity[rigid.body]) + cross(f.spin, arm);
}

// Springs and dampers act with their values at the end of the substep, as for hands that only translate:
// stable for any dt, mass and stiffness.
void pull_held_body(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f) {
    AdvanceRigid& rigid = island.rigid[f.rigid];
    const ContactNode node = island.nodes.node[rigid.node];
    const HandTool& tool = call.inputs.tools[rigid.tool];
    const HandPose from = hand_pose(call, rigid.tool, call.substep), to = hand_pose(call, rigid.tool, call.substep + 1);
    const double dt = call.dt, w = call.inputs.bodies.inv_mass[rigid.body], v = 1 / tool.inertia;
    rigid.target = to.origin + rotate(to.orientation, tool.tip);
    rigid.target_velocity = (rigid.target - from.origin - rotate(from.orientation, tool.tip)) / dt;
    f.target = to.orientation;
    f.target_spin = rotation_vector(from.orientation, to.orientation) / dt;

    island.nodes.change[rigid.node].before = node.velocity;
    f.spin_before = f.spin;
    const double k = tool.coupling_stiffness, b = tool.coupling_damping;
    node.inv_mass = w / (1 + dt * w * (b + k * dt));
    node.velocity =
        node.inv_mass * (node.velocity / w + dt * (k * (to_vec4(rigid.target) - node.position) + b * to_vec4(rigid.target_velocity)));
    const double turn_k = tool.turn_stiffness, turn_b = tool.turn_damping;
    const double inv_inertia = v / (1 + dt * v * (turn_b + turn_k * dt));
    const Vec3d torque = turn_k * rotation_vector(rigid.orientation[0], to.orientation) + turn_b * f.target_spin;
    f.spin = inv_inertia * (f.spin / v + dt * to_vec4(torque));
    for (int i = 0; i < 3; ++i) f.inv_inertia[i] = inv_inertia * to_vec4(Vec3d::Unit(i));
    f.shift = f.turn = Vec4d{};
    note_spin(f, island);
}

void note_coupling(const AdvanceCall& call, const AdvanceFree& f, AdvanceIsland& island, std::span<ToolState> tools) {
    const AdvanceRigid& rigid = island.rigid[f.rigid];
    const ContactNode node = island.nodes.node[rigid.node];
    const HandTool& tool = call.inputs.tools[rigid.tool];
    ToolState& state = tools[rigid.tool];
    state.coupling_force = tool.coupling_stiffness * (rigid.target - to_vec3(node.position)) +
                           tool.coupling_damping * (rigid.target_velocity - to_vec3(node.velocity));
    state.coupling_torque =
        tool.turn_stiffness * rotation_vector(rigid.orientation[1], f.target) + tool.turn_damping * (f.target_spin - to_vec3(f.spin));
}

}  // namespace trocar
