#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "engine/node_drive.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

const NodeDrive& drive_of(const AdvanceIsland& island, const AdvanceFree& f) { return island.inputs.other.nodes->drive[f.drive]; }
DriveState& state_of(const AdvanceIsland& island, const AdvanceFree& f) { return island.inputs.other.node_state->drive[f.drive]; }

double rate_of(const AdvanceScratch& s, const AdvanceFree& f) {
    return dot(f.axis, f.slides ? s.node[s.rigid[f.rigid].node].velocity : f.spin);
}
void set_rate(AdvanceScratch& s, AdvanceFree& f, double rate) {
    (f.slides ? s.node[s.rigid[f.rigid].node].velocity : f.spin) = rate * f.axis;
}

// Puts the end of the substep where the coordinate says.
void place_driven(AdvanceIsland& island, AdvanceFree& f) {
    const NodeDrive& drive = drive_of(island, f);
    const double place = state_of(island, f).place;
    AdvanceRigid& rigid = island.scratch.rigid[f.rigid];
    const ContactNode node = island.scratch.node[rigid.node];
    node.place = node.after = to_vec4(drive_point(drive, place, to_vec3(f.centre)));
    place_end(rigid, f, node.place, drive_orientation(drive, place));
}

}  // namespace

void bind_drive(AdvanceIsland& island, uint32_t free_row) {
    AdvanceScratch& s = island.scratch;
    AdvanceFree& f = s.free[free_row];
    if (!island.inputs.other.nodes) return;
    const std::vector<NodeDrive>& drives = island.inputs.other.nodes->drive;
    const uint32_t body = s.rigid[f.rigid].body;
    const auto found = std::lower_bound(drives.begin(), drives.end(), body, [](const NodeDrive& d, uint32_t b) { return d.body < b; });
    if (found == drives.end() || found->body != body) return;
    const NodeDrive& drive = *found;
    f.drive = static_cast<uint32_t>(found - drives.begin());
    f.before = state_of(island, f);
    f.slides = !turns(drive);
    f.axis = to_vec4(drive.axis);
    f.inertia = drive.inertia;
    f.damping += drive.damping / drive.inertia;
    f.hold = drive.friction;
    f.arm = f.slides ? 1 : island.inputs.meshes.info[island.inputs.bodies.mesh[body]].radius;
    const ContactNode node = s.node[s.rigid[f.rigid].node];
    node.inv_mass = 0;
    if (f.slides) {
        f.slide = f.axis / std::sqrt(drive.inertia);
    } else {
        // the node is on the axis: impulses there move nothing
        f.centre = to_vec4(rotate_back(drive.orientation, drive.pivot - drive.origin));
        for (int i = 0; i < 3; ++i) f.inv_inertia[i] = (f.axis[i] / drive.inertia) * f.axis;
    }
    node.place = to_vec4(drive_point(drive, f.before.place, to_vec3(f.centre)));
    node.velocity = f.spin = Vec4d{};
    set_rate(s, f, f.before.rate);
}

void kick_driven(AdvanceIsland& island, AdvanceFree& f) {
    AdvanceScratch& s = island.scratch;
    const NodeDrive& drive = drive_of(island, f);
    DriveState& state = state_of(island, f);
    AdvanceRigid& rigid = s.rigid[f.rigid];
    const double seconds = moving_time(island, rigid.body), kick = seconds > 0 ? 0.5 * (f.last_dt + seconds) : 0;
    f.keep = std::exp(-f.damping * kick);
    if (seconds > 0) f.last_dt = seconds;
    const Vec3d centre = drive_point(drive, state.place, f.mass.centre);
    const double force = drive_force(drive, state.place) + drive_weight(drive, f.mass.mass, island.params.gravity, centre);
    f.rate_before = rate_of(s, f);
    // damping acts before all forces, of first order: what spring and contact hold between them stays held
    f.damping_impulse = f.inertia * (f.keep - 1) * f.rate_before;
    f.rate_kicked = f.keep * f.rate_before + kick * force / f.inertia;
    f.most_friction = f.hold * kick;
    f.least_rate = (drive.lowest - state.place) / island.dt;
    f.most_rate = (drive.highest - state.place) / island.dt;
    // limits and friction start from what they gave in the substep before
    f.friction_impulse = std::clamp(state.friction_impulse, -f.most_friction, f.most_friction);
    f.stop_impulse = state.stop_impulse;
    s.change[rigid.node].before = s.node[rigid.node].velocity;
    set_rate(s, f, f.rate_kicked + (f.friction_impulse + f.stop_impulse) / f.inertia);
    f.shift = f.turn = Vec4d{};
    for (int i = 0; i < 3; ++i) rigid.velocity.column[i] = cross(f.spin, rigid.place[0].column[i]);
    rigid.velocity.shift = cross(f.spin, rigid.place[0].shift - s.node[rigid.node].place);
}

double solve_drives(AdvanceScratch& s) {
    double change = 0;
    for (AdvanceFree& f : s.free) {
        if (f.drive == kNone) continue;
        const double start = rate_of(s, f);
        double rate = start - f.friction_impulse / f.inertia;
        f.friction_impulse = std::clamp(-f.inertia * rate, -f.most_friction, f.most_friction);
        rate += (f.friction_impulse - f.stop_impulse) / f.inertia;
        const double within = std::clamp(rate, f.least_rate, f.most_rate);
        f.stop_impulse = f.inertia * (within - rate);
        set_rate(s, f, within);
        change = std::max(change, std::abs(within - start) * f.arm);
    }
    return change;
}

void settle_drives(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    solve_drives(s);
    for (AdvanceFree& f : s.free) {
        if (f.drive == kNone) continue;
        DriveState& state = state_of(island, f);
        state.friction_impulse = f.friction_impulse;
        state.stop_impulse = f.stop_impulse;
        state.rate = rate_of(s, f);
        if (!island.params.account_energy) continue;
        // all impulses of a substep do work at the mean of the velocities before and after it
        const double mean = 0.5 * (f.rate_before + state.rate), held = f.friction_impulse + f.stop_impulse;
        island.result.work_damping += (f.damping_impulse + held) * mean;
        island.result.work_contact += (f.inertia * (state.rate - f.rate_kicked) - held) * mean;
    }
}

void move_driven(AdvanceIsland& island, AdvanceFree& f) {
    const NodeDrive& drive = drive_of(island, f);
    DriveState& state = state_of(island, f);
    const double seconds = moving_time(island, island.scratch.rigid[f.rigid].body);
    state.place = std::clamp(state.place + seconds * state.rate, drive.lowest, drive.highest);
    note_place(drive, substep_time(island.params, island.substep + 1), state);
    place_driven(island, f);
}

void push_driven(AdvanceIsland& island, AdvanceFree& f, double share) {
    const NodeDrive& drive = drive_of(island, f);
    DriveState& state = state_of(island, f);
    const double from = state.place, way = share * dot(f.axis, f.slides ? f.shift : f.turn);
    state.place = std::clamp(from + way, drive.lowest, drive.highest);
    const Vec3d rise = drive_point(drive, state.place, f.mass.centre) - drive_point(drive, from, f.mass.centre);
    island.result.work_push += drive_energy(drive, state.place) - drive_energy(drive, from) - f.mass.mass * island.params.gravity.dot(rise);
    place_driven(island, f);
}

void restore_drive(AdvanceIsland& island, const AdvanceFree& f) {
    DriveState& state = state_of(island, f);
    state.place = f.before.place;
    state.rate = state.friction_impulse = state.stop_impulse = 0;
}

}  // namespace trocar
