#include "systems/advance/rigid/grasped_bodies.hpp"

#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "systems/advance/rigid/rigid_bodies.hpp"
namespace trocar {
namespace {

// Sweeps over the grasps of a substep: force and torque of one body couple by its arm, and two hands may hold it.
constexpr int kGraspSweeps = 8;

struct GraspInverse {
    double mass = 0;  // 1/kg
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
};

GraspInverse grasp_inverse_of(const AdvanceIsland& island, uint32_t slot) {
    const AdvanceRigid& rigid = island.rigid[slot];
    GraspInverse inverse;
    if (rigid.node != kNone) inverse.mass = ConstContactNode(island.nodes.node[rigid.node]).inv_mass;
    if (rigid.free == kNone) return inverse;
    for (int i = 0; i < 3; ++i) inverse.inertia.col(i) = to_vec3(island.free[rigid.free].inv_inertia[i]);
    return inverse;
}

Eigen::Matrix3d arm_matrix(const Vec3d& a) {
    Eigen::Matrix3d m;
    m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
    return m;
}

// How velocities at a point answer impulses there.
Eigen::Matrix3d grasp_response_at(const GraspInverse& inverse, const Vec3d& arm) {
    const Eigen::Matrix3d r = arm_matrix(arm);
    return inverse.mass * Eigen::Matrix3d::Identity() - r * inverse.inertia * r;
}

Vec3d grasp_spin_of(const AdvanceCall& call, const AdvanceIsland& island, uint32_t slot) {
    const AdvanceRigid& rigid = island.rigid[slot];
    if (rigid.free != kNone) return to_vec3(island.free[rigid.free].spin);
    return rotation_vector(rigid.orientation[0], rigid.orientation[1]) / call.dt;
}

Vec3d grasp_velocity_at(const AdvanceIsland& island, uint32_t slot, const Vec3d& point, const Vec3d& arm) {
    const AdvanceRigid& rigid = island.rigid[slot];
    Vec3d v = rigid.node != kNone ? to_vec3(ConstContactNode(island.nodes.node[rigid.node]).velocity) : Vec3d(Vec3d::Zero());
    if (rigid.free != kNone) return v + to_vec3(island.free[rigid.free].spin).cross(arm);
    return v + to_vec3(rigid.velocity(to_vec4(point)));
}

void give_grasp(AdvanceIsland& island, uint32_t slot, const Vec3d& arm, const Vec3d& impulse, const Vec3d& moment) {
    const AdvanceRigid& rigid = island.rigid[slot];
    if (rigid.node == kNone) return;
    const ContactNode node = island.nodes.node[rigid.node];
    node.velocity += node.inv_mass * to_vec4(impulse);
    if (rigid.free == kNone) return;
    AdvanceFree& f = island.free[rigid.free];
    f.spin += f.respond(to_vec4(arm.cross(impulse) + moment));
}

// Where the pads are stretched beyond what they bear, the body has slid: the held point and orientation follow.
void slide_grasp(const ToolAction& action, const AdvanceIsland& island, ToolGrasp& grasp, AdvanceGrasp& g) {
    const AdvanceRigid &tool = island.rigid[g.tool], &body = island.rigid[g.body];
    const Vec3d held = to_vec3(tool.pose[0](to_vec4(grasp.point)));
    Vec3d at = to_vec3(body.pose[0](to_vec4(grasp.arm)));
    g.stretch = held - at;
    const double most = most_force(action) / action.stiffness, length = g.stretch.norm();
    if (length > most) {
        const Vec3d slid = (1 - most / length) * g.stretch;
        grasp.arm += to_vec3(body.pose[0].turn_back(to_vec4(slid)));
        grasp.slipped += slid.norm();
        at += slid, g.stretch -= slid;
    }
    const Quat held_turn = multiply(tool.orientation[0], grasp.turn);
    g.turn = rotation_vector(body.orientation[0], held_turn);
    const double most_turn = most_torque(action) / turn_stiffness_of(action), angle = g.turn.norm();
    if (angle > most_turn) {
        g.turn *= most_turn / angle;
        grasp.turn = normalized(multiply(conjugate(tool.orientation[0]), multiply(from_rotation_vector(g.turn), body.orientation[0])));
        grasp.turned += angle - most_turn;
    }
    g.at = at;
    const auto centre = [&](const AdvanceRigid& rigid) {
        return rigid.node != kNone ? to_vec3(ConstContactNode(island.nodes.node[rigid.node]).position) : to_vec3(rigid.pose[0].shift);
    };
    g.tool_arm = held - centre(tool), g.body_arm = at - centre(body);
}

// The soft constraint of one grasp and its effective masses.
void prepare_grasp(const AdvanceCall& call, const ToolAction& action, const AdvanceIsland& island, AdvanceGrasp& g) {
    const double h = call.dt, k = action.stiffness, turn_k = turn_stiffness_of(action);
    const AdvanceFree& f = island.free[island.rigid[g.body].free];
    const double moment = f.mass.moments.maxCoeff() + f.mass.mass * g.body_arm.squaredNorm();  // kg m^2, at most, about the point
    const double damping = 2 * std::sqrt(k * f.mass.mass), turn_damping = 2 * std::sqrt(turn_k * moment);
    const GraspInverse tool = grasp_inverse_of(island, g.tool), body = grasp_inverse_of(island, g.body);
    g.soft = 1 / (h * (damping + h * k)), g.turn_soft = 1 / (h * (turn_damping + h * turn_k));
    g.pull = k * h * g.soft * g.stretch, g.twist = turn_k * h * g.turn_soft * g.turn;
    const Eigen::Matrix3d one = Eigen::Matrix3d::Identity();
    g.mass = (grasp_response_at(tool, g.tool_arm) + grasp_response_at(body, g.body_arm) + g.soft * one).inverse();
    g.inertia = (tool.inertia + body.inertia + g.turn_soft * one).inverse();
    g.impulse = g.moment = Vec3d::Zero();
    g.spin_before = to_vec3(f.spin);
    g.tool_velocity = grasp_velocity_at(island, g.tool, g.point, g.tool_arm);
    g.tool_spin = grasp_spin_of(call, island, g.tool);
}

// What an impulse becomes by a step, within what the pads bear. Returns the change.
Vec3d grasp_change_within(const Vec3d& step, double most, Vec3d& sum) {
    Vec3d next = sum + step;
    const double length = next.norm();
    if (length > most) next *= most / length;
    const Vec3d change = next - sum;
    sum = next;
    return change;
}

void sweep_grasp(const AdvanceCall& call, const ToolAction& action, AdvanceIsland& island, AdvanceGrasp& g) {
    const Vec3d turning = grasp_spin_of(call, island, g.tool) - grasp_spin_of(call, island, g.body);
    const Vec3d moment =
        grasp_change_within(g.inertia * (turning + g.twist - g.turn_soft * g.moment), call.dt * most_torque(action), g.moment);
    give_grasp(island, g.body, g.body_arm, Vec3d::Zero(), moment), give_grasp(island, g.tool, g.tool_arm, Vec3d::Zero(), -moment);
    const Vec3d moving =
        grasp_velocity_at(island, g.tool, g.point, g.tool_arm) - grasp_velocity_at(island, g.body, Vec3d::Zero(), g.body_arm);
    const Vec3d impulse = grasp_change_within(g.mass * (moving + g.pull - g.soft * g.impulse), call.dt * most_force(action), g.impulse);
    give_grasp(island, g.body, g.body_arm, impulse, Vec3d::Zero()), give_grasp(island, g.tool, g.tool_arm, -impulse, Vec3d::Zero());
}

void note_grasp_spin(AdvanceIsland& island, uint32_t slot) {
    const uint32_t free = island.rigid[slot].free;
    if (free == kNone) return;
    island.free[free].spin_before = island.free[free].spin;
    note_spin(island.free[free], island);
}

}  // namespace

void gather_grasps(const AdvanceCall& call, AdvanceIsland& island, const AdvanceState& state) {
    island.grasp.clear();
    const OtherForces& other = call.inputs.other;
    if (!other.action_state) return;
    for (uint32_t i = 0; i < other.action_state->grasp.size(); ++i) {
        const ToolGrasp& grasp = other.action_state->grasp[i];
        if (is_deformable(call.inputs.bodies, grasp.body) || island.slot_of_body[grasp.body] == kNone) continue;
        AdvanceGrasp g;
        g.index = i;
        g.body = island.slot_of_body[grasp.body];
        const uint32_t tool = other.actions->action[grasp.action].tool;
        g.tool = rigid_slot(call, call.inputs.tools[tool].body, island, state);
        g.point = grasp.point;
        if (island.rigid[g.body].free != kNone) island.grasp.push_back(g);
    }
}

void pull_grasped_bodies(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools, AdvanceResult& result) {
    if (island.grasp.empty()) return;
    ActionState& state = *call.inputs.other.action_state;
    const auto action_of = [&](const AdvanceGrasp& g) -> const ToolAction& {
        return call.inputs.other.actions->action[state.grasp[g.index].action];
    };
    for (AdvanceGrasp& g : island.grasp) {
        ToolGrasp& grasp = state.grasp[g.index];
        slide_grasp(action_of(g), island, grasp, g);
        const double stored =
            0.5 * action_of(g).stiffness * g.stretch.squaredNorm() + 0.5 * turn_stiffness_of(action_of(g)) * g.turn.squaredNorm();
        if (call.params.account_energy) result.work_contact += stored - grasp.stored;
        grasp.stored = stored;
        prepare_grasp(call, action_of(g), island, g);
    }
    for (int i = 0; i < kGraspSweeps; ++i)
        for (AdvanceGrasp& g : island.grasp) sweep_grasp(call, action_of(g), island, g);
    for (AdvanceGrasp& g : island.grasp) {
        ToolGrasp& grasp = state.grasp[g.index];
        grasp.impulse += g.impulse, grasp.moment += g.moment;
        ToolState& tool = tools[call.inputs.other.actions->action[grasp.action].tool];
        tool.contact_impulse -= g.impulse;
        if (island.rigid[g.tool].free != kNone) tool.contact_moment -= g.tool_arm.cross(g.impulse) + g.moment;
        note_grasp_spin(island, g.body), note_grasp_spin(island, g.tool);
    }
}

void account_grasps(const AdvanceCall& call, const AdvanceIsland& island, AdvanceResult& result) {
    if (!call.params.account_energy) return;
    for (const AdvanceGrasp& g : island.grasp) {
        const AdvanceRigid& body = island.rigid[g.body];
        const AdvanceFree& f = island.free[body.free];
        const ConstContactNode node = island.nodes.node[body.node];
        const Vec3d before = f.keep * to_vec3(ConstContactNodeChange(island.nodes.change[body.node]).before);
        const Vec3d spin = 0.5 * (g.spin_before + to_vec3(f.spin_before));
        const double taken = 0.5 * g.impulse.dot(before + to_vec3(node.velocity)) + (g.body_arm.cross(g.impulse) + g.moment).dot(spin);
        const double hand = 0.5 * g.impulse.dot(g.tool_velocity + grasp_velocity_at(island, g.tool, g.point, g.tool_arm)) +
                            0.5 * g.moment.dot(g.tool_spin + grasp_spin_of(call, island, g.tool));
        result.work_hand += hand, result.work_contact += taken - hand;
    }
}

}  // namespace trocar
