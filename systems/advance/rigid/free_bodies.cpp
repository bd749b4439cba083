#include "systems/advance/rigid/free_bodies.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/motion/free_rotation.hpp"
#include "systems/advance/rigid/driven_bodies.hpp"
#include "systems/advance/rigid/held_tools.hpp"
namespace trocar {
namespace {

Quat principal_frame(const AdvanceFree& f, const Quat& orientation) { return multiply(orientation, f.mass.axes); }

Vec4d spin_momentum(const AdvanceFree& f, const Quat& orientation, Vec4d spin) {
    return to_vec4(momentum_of(f.mass.moments, principal_frame(f, orientation), to_vec3(spin)));
}

void set_inertia(AdvanceFree& f, const Quat& orientation) {
    const Quat principal = principal_frame(f, orientation);
    for (int i = 0; i < 3; ++i) f.inv_inertia[i] = to_vec4(spin_of(f.mass.moments, principal, Vec3d::Unit(i)));
}

// Rotational part of the velocity along `along`, relative to the plane, caused by a unit impulse along
// `direction`.
double angular_response(const AdvanceIsland& island, const PreparedConstraint::Angular& angular, Vec4d direction, Vec4d along) {
    double sum = 0;
    for (int side = 0; side < 2; ++side) {
        if (angular.free[side] == kNone) continue;
        const AdvanceFree& f = island.free[angular.free[side]];
        sum += dot(along, cross(f.respond(cross(angular.arm[side], direction)), angular.arm[side]) + f.yield(direction));
    }
    return sum;
}

Vec4d any_tangent(Vec4d normal) {
    const Vec4d axis = std::abs(normal[0]) < 0.6 ? make_vec4(1, 0, 0) : make_vec4(0, 1, 0);
    const Vec4d t = cross(normal, axis);
    return t / std::sqrt(norm2(t));
}

// Least effective mass over the tangential directions. A scalar: with a matrix, friction on a sliding
// constraint would converge to matrix times velocity, not opposite to the velocity.
double friction_mass(const AdvanceIsland& island, double nodes_response, Vec4d normal, const PreparedConstraint::Angular& angular) {
    const Vec4d u = any_tangent(normal), v = cross(normal, u);
    const double uu = angular_response(island, angular, u, u), vv = angular_response(island, angular, v, v),
                 uv = angular_response(island, angular, u, v);
    const double half = 0.5 * (uu - vv);
    const double largest = nodes_response + 0.5 * (uu + vv) + std::sqrt(half * half + uv * uv);
    return largest > 0 ? 1 / largest : 0;
}

}  // namespace

Vec4d free_point_velocity(const AdvanceIsland& island, const PreparedConstraint& constraint) {
    const auto& angular = constraint.angular;
    Vec4d v = constraint.rigid_velocity;
    for (uint32_t k = 0; k < constraint.nodes; ++k) v += constraint.weight[k] * island.nodes.node[constraint.node[k]].velocity;
    if (angular.free[0] != kNone) v += cross(island.free[angular.free[0]].spin, angular.arm[0]);
    if (angular.free[1] != kNone) v -= cross(island.free[angular.free[1]].spin, angular.arm[1]);
    return v;
}

void place_end(AdvanceRigid& rigid, const AdvanceFree& f, Vec4d centre, const Quat& orientation) {
    RigidMap& pose = rigid.pose[1];
    rigid.orientation[1] = orientation;
    for (int i = 0; i < 3; ++i) pose.column[i] = to_vec4(rotate(orientation, Vec3d::Unit(i)));
    pose.shift = centre - pose.turn(f.centre);
}

void add_free_body(const AdvanceCall& call, uint32_t rigid_index, AdvanceIsland& island, const AdvanceState& state) {
    AdvanceRigid& rigid = island.rigid[rigid_index];
    const RigidMass* mass = find_rigid_mass(call.inputs.bodies, rigid.body);
    TROCAR_ASSERT(mass != nullptr);
    rigid.free = static_cast<uint32_t>(island.free.size());
    rigid.node = static_cast<uint32_t>(island.nodes.node.size());
    AdvanceFree& f = island.free.emplace_back();
    f.mass = *mass;
    f.rigid = rigid_index;
    f.damping = call.inputs.bodies.tissue[rigid.body].damping;
    f.last_dt = state.particles.last_dt[rigid.body];
    f.centre = to_vec4(mass->centre);
    f.spin = to_vec4(state.poses.angular_velocity[rigid.body]);
    const Vec4d arm = to_vec4(rotate(state.poses.orientation[rigid.body], mass->centre));
    const ContactNode node = add_node(island.nodes);
    node.owner = rigid_index;
    node.inv_mass = 1 / mass->mass;
    node.position = to_vec4(state.poses.origin[rigid.body]) + arm;
    node.velocity = to_vec4(state.poses.velocity[rigid.body]) + cross(f.spin, arm);
    bind_drive(call, rigid.free, island);
}

void kick_free_bodies(const AdvanceCall& call, AdvanceIsland& island, AdvanceResult& result) {
    for (AdvanceFree& f : island.free) {
        if (f.drive != kNone) {
            kick_driven(call, island, f);
            continue;
        }
        AdvanceRigid& rigid = island.rigid[f.rigid];
        const ContactNode node = island.nodes.node[rigid.node];
        if (f.held) {
            pull_held_body(call, island, f);
            continue;
        }
        // the first kick is a half one: velocities fall half a step behind; a body stopped in this substep
        // takes a shorter step, or none, and then neither falls nor is damped
        const double seconds = moving_time(call, rigid.body), kick = seconds > 0 ? 0.5 * (f.last_dt + seconds) : 0;
        const double keep = std::exp(-f.damping * kick);
        f.keep = keep;
        if (seconds > 0) f.last_dt = seconds;
        island.nodes.change[rigid.node].before = node.velocity;
        const Vec4d fall = kick * to_vec4(call.params.gravity), lost = (keep - 1) * node.velocity;
        if (f.damping > 0 && call.params.account_energy) {
            const Vec4d spin = keep * f.spin;
            result.work_damping += dot(lost, node.velocity + 0.5 * (lost + fall)) * f.mass.mass +
                                   0.5 * dot(spin_momentum(f, rigid.orientation[0], spin - f.spin), spin + f.spin);
        }
        node.velocity += lost + fall;
        f.spin *= keep;
        f.spin_before = f.spin;
        f.shift = f.turn = Vec4d{};
        set_inertia(f, rigid.orientation[0]);
        const RigidMap& pose = rigid.pose[0];
        for (int i = 0; i < 3; ++i) rigid.velocity.column[i] = cross(f.spin, pose.column[i]);
        rigid.velocity.shift = cross(f.spin, pose.shift - node.position);
    }
}

void move_free_bodies(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools) {
    for (AdvanceFree& f : island.free) {
        if (f.drive != kNone) {
            move_driven(call, island, f);
            continue;
        }
        AdvanceRigid& rigid = island.rigid[f.rigid];
        const ContactNode node = island.nodes.node[rigid.node];
        const double seconds = moving_time(call, rigid.body);
        node.position += seconds * node.velocity;
        node.after = node.position;
        const Quat principal = principal_frame(f, rigid.orientation[0]);
        const Vec3d momentum = momentum_of(f.mass.moments, principal, to_vec3(f.spin));
        const Quat turned = turn_freely(f.mass.moments, momentum, seconds, principal);
        f.spin = to_vec4(spin_of(f.mass.moments, turned, momentum));
        place_end(rigid, f, node.position, normalized(multiply(turned, conjugate(f.mass.axes))));
        if (f.held) note_coupling(call, f, island, tools);
    }
}

void finish_free_bodies(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result) {
    Poses& poses = state.poses;
    for (const AdvanceFree& f : island.free) {
        const AdvanceRigid& rigid = island.rigid[f.rigid];
        const ConstContactNode node = island.nodes.node[rigid.node];
        const Quat& q = rigid.orientation[1];
        const Vec4d arm = rigid.pose[1].turn(f.centre);
        if (!std::isfinite(norm2(node.position) + norm2(node.velocity) + norm2(f.spin) + norm2(arm))) {
            ++result.nonfinite_particles;
            poses.velocity[rigid.body] = poses.angular_velocity[rigid.body] = Vec3d::Zero();
            if (!f.held) state.particles.last_dt[rigid.body] = 0;
            if (f.drive != kNone) restore_drive(call, f);
            continue;
        }
        poses.origin[rigid.body] = to_vec3(node.position - arm);
        poses.orientation[rigid.body] = q;
        poses.velocity[rigid.body] = to_vec3(node.velocity - cross(f.spin, arm));
        poses.angular_velocity[rigid.body] = to_vec3(f.spin);
        if (!f.held) state.particles.last_dt[rigid.body] = f.last_dt;
    }
}

double contact_work_on_free(const AdvanceIsland& island) {
    double work = 0;
    for (const AdvanceFree& f : island.free) {
        if (f.drive != kNone) continue;  // handled by finish_drives
        if (f.held) continue;            // its work is the hand's
        const uint32_t n = island.rigid[f.rigid].node;
        const ConstContactNodeChange change = island.nodes.change[n];
        const Vec4d kick = island.nodes.node[n].velocity - change.kicked;
        // as for particles: a kick does work at the mean of the velocities before and after all of its parts
        work += 0.5 * f.mass.mass * dot(kick, f.keep * change.before + island.nodes.node[n].velocity);
        const Vec4d spin_kick = spin_momentum(f, island.rigid[f.rigid].orientation[0], f.spin - f.spin_before);
        work += 0.5 * dot(spin_kick, f.spin + f.spin_before);
    }
    return work;
}

void add_angular_parts(const AdvanceIsland& island, Vec4d at, PreparedConstraint& c) {
    PreparedConstraint::Angular& angular = c.angular;
    angular = {};
    const uint32_t side_rigid[2] = {c.rigid_a, c.rigid_b};
    for (int side = 0; side < 2; ++side) {
        if (side_rigid[side] == kNone || island.rigid[side_rigid[side]].free == kNone) continue;
        const AdvanceRigid& rigid = island.rigid[side_rigid[side]];
        angular.free[side] = rigid.free;
        angular.arm[side] = at - island.nodes.node[rigid.node].position;
    }
    const double nodes_response = c.effective_mass > 0 ? 1 / c.effective_mass : 0;
    const double response = nodes_response + angular_response(island, angular, c.normal, c.normal);
    c.effective_mass = response > 0 ? 1 / response : 0;
    angular.friction_mass = friction_mass(island, nodes_response, c.normal, angular);
}

void give_impulse(const PreparedConstraint& c, Vec4d impulse, AdvanceIsland& island) {
    for (uint32_t k = 0; k < c.nodes; ++k) {
        const ContactNode node = island.nodes.node[c.node[k]];
        node.velocity += (c.weight[k] * node.inv_mass) * impulse;
    }
    for (int side = 0; side < 2; ++side) {
        if (c.angular.free[side] == kNone) continue;
        AdvanceFree& f = island.free[c.angular.free[side]];
        const Vec4d j = side == 0 ? impulse : -impulse;
        f.spin += f.respond(cross(c.angular.arm[side], j));
        if (f.slides) island.nodes.node[island.rigid[f.rigid].node].velocity += f.yield(j);
    }
}

double solve_angular_constraint(AdvanceIsland& island, PreparedConstraint& c) {
    Vec4d velocity = free_point_velocity(island, c);
    const double normal_impulse = corrected_normal_impulse(c, dot(c.normal, velocity));
    // most constraints have no impulse and get none
    if (normal_impulse == 0 && c.normal_impulse == 0 && norm2(c.friction_impulse) == 0) return 0;
    const double normal_change = normal_impulse - c.normal_impulse;
    c.normal_impulse = normal_impulse;
    double change = std::abs(normal_change);
    if (normal_change != 0) give_impulse(c, normal_change * c.normal, island);
    if (c.friction > 0) {
        velocity = free_point_velocity(island, c);
        const Vec4d sliding = velocity - dot(c.normal, velocity) * c.normal;
        const Vec4d friction = limit_friction(c.friction_impulse - c.angular.friction_mass * sliding, c.friction * normal_impulse);
        const Vec4d friction_change = friction - c.friction_impulse;
        c.friction_impulse = friction;
        give_impulse(c, friction_change, island);
        change = std::max(change, std::sqrt(norm2(friction_change)));
    }
    return c.effective_mass > 0 ? change / c.effective_mass : 0;
}

void correct_free_sides(const PreparedConstraint& c, Vec4d correction, AdvanceIsland& island) {
    const auto& angular = c.angular;
    for (int side = 0; side < 2; ++side) {
        if (angular.free[side] == kNone) continue;
        AdvanceFree& f = island.free[angular.free[side]];
        AdvanceRigid& rigid = island.rigid[f.rigid];
        const ContactNode node = island.nodes.node[rigid.node];
        const Vec4d signed_correction = side == 0 ? correction : -correction;
        const Vec4d shift = node.inv_mass * signed_correction + f.yield(signed_correction),
                    turn = f.respond(cross(angular.arm[side], signed_correction));
        f.shift += shift;
        f.turn += turn;
        node.after += shift;
        RigidMap& pose = rigid.pose[1];
        for (Vec4d& column : pose.column) column += cross(turn, column);
        pose.shift = node.after - pose.turn(f.centre);
        for (size_t k = 0; f.held && k < island.rigid.size(); ++k) {
            AdvanceRigid& jaw = island.rigid[k];
            if (jaw.jaw == kNone || jaw.free != angular.free[side]) continue;
            for (Vec4d& column : jaw.pose[1].column) column += cross(turn, column);
            jaw.pose[1].shift += shift + cross(turn, jaw.pose[1].shift - node.after);
        }
    }
}

void finish_free_corrections(const AdvanceCall& call, double most, AdvanceIsland& island, AdvanceResult& result) {
    for (AdvanceFree& f : island.free) {
        AdvanceRigid& rigid = island.rigid[f.rigid];
        const ContactNode node = island.nodes.node[rigid.node];
        const double radius = call.inputs.meshes.info[call.inputs.bodies.mesh[rigid.body]].radius;
        const double distance = std::sqrt(norm2(f.shift)) + radius * std::sqrt(norm2(f.turn));
        if (distance == 0) continue;
        const double share = distance > most ? most / distance : 1;
        if (f.drive != kNone) {
            correct_driven(call, share, island, f, result);
            continue;
        }
        const Vec4d shift = share * f.shift;
        node.position += shift;
        node.after = node.position;
        // angular momentum is constant: the spin follows the rotated inertia
        const Vec4d momentum = spin_momentum(f, rigid.orientation[1], f.spin);
        const Quat turned = multiply(from_rotation_vector(to_vec3(share * f.turn)), rigid.orientation[1]);
        place_end(rigid, f, node.position, normalized(turned));
        const Vec3d spin = spin_of(f.mass.moments, principal_frame(f, rigid.orientation[1]), to_vec3(momentum));
        if (f.held) continue;
        result.work_push += 0.5 * dot(momentum, to_vec4(spin) - f.spin) - f.mass.mass * dot(to_vec4(call.params.gravity), shift);
        f.spin = to_vec4(spin);
    }
}

}  // namespace trocar
