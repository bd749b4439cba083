#include "systems/advance/rigid/driven_bodies.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "engine/motion/node_drive.hpp"
#include "systems/advance/rigid/free_bodies.hpp"
namespace trocar {
namespace {

const NodeDrive& drive_of(const AdvanceCall& call, const AdvanceFree& f) { return call.inputs.other.nodes->drive[f.drive]; }
DriveState& state_of(const AdvanceCall& call, const AdvanceFree& f) { return call.inputs.other.node_state->drive[f.drive]; }

double rate_of(const AdvanceIsland& island, const AdvanceFree& f) {
    return dot(f.axis, f.slides ? island.nodes.node[island.rigid[f.rigid].node].velocity : f.spin);
}
void set_rate(double rate, AdvanceIsland& island, AdvanceFree& f) {
    (f.slides ? island.nodes.node[island.rigid[f.rigid].node].velocity : f.spin) = rate * f.axis;
}

// Sets the pose at the end of the substep from the coordinate.
void place_driven(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f) {
    const NodeDrive& drive = drive_of(call, f);
    const double coordinate = state_of(call, f).coordinate;
    AdvanceRigid& rigid = island.rigid[f.rigid];
    const ContactNode node = island.nodes.node[rigid.node];
    node.position = node.after = to_vec4(drive_point(drive, coordinate, to_vec3(f.centre)));
    place_end(rigid, f, node.position, drive_orientation(drive, coordinate));
}

}  // namespace

void bind_drive(const AdvanceCall& call, uint32_t free_index, AdvanceIsland& island) {
    AdvanceFree& f = island.free[free_index];
    if (!call.inputs.other.nodes) return;
    const std::vector<NodeDrive>& drives = call.inputs.other.nodes->drive;
    const uint32_t body = island.rigid[f.rigid].body;
    const auto found = std::lower_bound(drives.begin(), drives.end(), body, [](const NodeDrive& d, uint32_t b) { return d.body < b; });
    if (found == drives.end() || found->body != body) return;
    const NodeDrive& drive = *found;
    f.drive = static_cast<uint32_t>(found - drives.begin());
    f.before = state_of(call, f);
    f.slides = !turns(drive);
    f.axis = to_vec4(drive.axis);
    f.inertia = drive.inertia;
    f.damping += drive.damping / drive.inertia;
    f.hold = drive.friction;
    f.arm = f.slides ? 1 : call.inputs.meshes.info[call.inputs.bodies.mesh[body]].radius;
    const ContactNode node = island.nodes.node[island.rigid[f.rigid].node];
    node.inv_mass = 0;
    if (f.slides) {
        f.slide = f.axis / std::sqrt(drive.inertia);
    } else {
        // the node is on the axis: impulses there do not move it
        f.centre = to_vec4(rotate_back(drive.orientation, drive.pivot - drive.origin));
        for (int i = 0; i < 3; ++i) f.inv_inertia[i] = (f.axis[i] / drive.inertia) * f.axis;
    }
    node.position = to_vec4(drive_point(drive, f.before.coordinate, to_vec3(f.centre)));
    node.velocity = f.spin = Vec4d{};
    set_rate(f.before.rate, island, f);
}

void kick_driven(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f) {
    const NodeDrive& drive = drive_of(call, f);
    DriveState& state = state_of(call, f);
    AdvanceRigid& rigid = island.rigid[f.rigid];
    const double seconds = moving_time(call, rigid.body), kick = seconds > 0 ? 0.5 * (f.last_dt + seconds) : 0;
    f.keep = std::exp(-f.damping * kick);
    if (seconds > 0) f.last_dt = seconds;
    const Vec3d centre = drive_point(drive, state.coordinate, f.mass.centre);
    const double force = drive_force(drive, state.coordinate) + drive_weight(drive, f.mass.mass, call.params.gravity, centre);
    f.rate_before = rate_of(island, f);
    // damping acts before all forces, first order: a balance of spring and contact stays
    f.damping_impulse = f.inertia * (f.keep - 1) * f.rate_before;
    f.rate_kicked = f.keep * f.rate_before + kick * force / f.inertia;
    f.most_friction = f.hold * kick;
    f.least_rate = (drive.lowest - state.coordinate) / call.dt;
    f.most_rate = (drive.highest - state.coordinate) / call.dt;
    // limits and friction warm start from the preceding substep
    f.friction_impulse = std::clamp(state.friction_impulse, -f.most_friction, f.most_friction);
    f.stop_impulse = state.stop_impulse;
    island.nodes.change[rigid.node].before = island.nodes.node[rigid.node].velocity;
    set_rate(f.rate_kicked + (f.friction_impulse + f.stop_impulse) / f.inertia, island, f);
    f.shift = f.turn = Vec4d{};
    for (int i = 0; i < 3; ++i) rigid.velocity.column[i] = cross(f.spin, rigid.pose[0].column[i]);
    rigid.velocity.shift = cross(f.spin, rigid.pose[0].shift - island.nodes.node[rigid.node].position);
}

double solve_drives(AdvanceIsland& island) {
    double change = 0;
    for (AdvanceFree& f : island.free) {
        if (f.drive == kNone) continue;
        const double start = rate_of(island, f);
        double rate = start - f.friction_impulse / f.inertia;
        f.friction_impulse = std::clamp(-f.inertia * rate, -f.most_friction, f.most_friction);
        rate += (f.friction_impulse - f.stop_impulse) / f.inertia;
        const double within = std::clamp(rate, f.least_rate, f.most_rate);
        f.stop_impulse = f.inertia * (within - rate);
        set_rate(within, island, f);
        change = std::max(change, std::abs(within - start) * f.arm);
    }
    return change;
}

void finish_drives(const AdvanceCall& call, AdvanceIsland& island, AdvanceResult& result) {
    solve_drives(island);
    for (AdvanceFree& f : island.free) {
        if (f.drive == kNone) continue;
        DriveState& state = state_of(call, f);
        state.friction_impulse = f.friction_impulse;
        state.stop_impulse = f.stop_impulse;
        state.rate = rate_of(island, f);
        if (!call.params.account_energy) continue;
        // all impulses of a substep do work at the mean of the velocities before and after it
        const double mean = 0.5 * (f.rate_before + state.rate), held = f.friction_impulse + f.stop_impulse;
        result.work_damping += (f.damping_impulse + held) * mean;
        result.work_contact += (f.inertia * (state.rate - f.rate_kicked) - held) * mean;
    }
}

void move_driven(const AdvanceCall& call, AdvanceIsland& island, AdvanceFree& f) {
    const NodeDrive& drive = drive_of(call, f);
    DriveState& state = state_of(call, f);
    const double seconds = moving_time(call, island.rigid[f.rigid].body);
    state.coordinate = std::clamp(state.coordinate + seconds * state.rate, drive.lowest, drive.highest);
    note_coordinate(drive, substep_time(call.params, call.substep + 1), state);
    place_driven(call, island, f);
}

void correct_driven(const AdvanceCall& call, double share, AdvanceIsland& island, AdvanceFree& f, AdvanceResult& result) {
    const NodeDrive& drive = drive_of(call, f);
    DriveState& state = state_of(call, f);
    const double from = state.coordinate, displacement = share * dot(f.axis, f.slides ? f.shift : f.turn);
    state.coordinate = std::clamp(from + displacement, drive.lowest, drive.highest);
    const Vec3d rise = drive_point(drive, state.coordinate, f.mass.centre) - drive_point(drive, from, f.mass.centre);
    result.work_push += drive_energy(drive, state.coordinate) - drive_energy(drive, from) - f.mass.mass * call.params.gravity.dot(rise);
    place_driven(call, island, f);
}

void restore_drive(const AdvanceCall& call, const AdvanceFree& f) {
    DriveState& state = state_of(call, f);
    state.coordinate = f.before.coordinate;
    state.rate = state.friction_impulse = state.stop_impulse = 0;
}

}  // namespace trocar
