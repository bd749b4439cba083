#include "systems/advance/tissue/thread_forces.hpp"

#include <algorithm>
#include <cmath>

#include "engine/mesh/surfaces.hpp"
#include "engine/thread/needle_grip.hpp"
#include "engine/thread/rod.hpp"
#include "engine/thread/touch.hpp"
#include "systems/advance/rigid/rigid_bodies.hpp"
namespace trocar {
namespace {

bool holds_in_island(const AdvanceIsland& island, const Bodies& bodies, uint32_t body) {
    if (body == kNone || body >= island.slot_of_body.size() || !joins_islands(bodies.motion[body])) return false;
    const uint32_t slot = island.slot_of_body[body];
    if (slot == kNone) return false;
    if (is_deformable(bodies, body)) return slot < island.body.size() && island.body[slot].body == body;
    return slot < island.rigid.size() && island.rigid[slot].body == body;
}

// In the place of a rigid slot: a deformable body that is not in the island, because it is switched off. It stays where it was.
constexpr uint32_t kAwayBody = kNone - 1;

double energy_of_hold(double stiffness, const Vec3d& stretch) { return 0.5 * stiffness * stretch.squaredNorm(); }

// Sum over the nodes of a hold or a touch of weight times what `of` says about the node.
template <typename At, typename Of>
Vec3d sum_held_nodes(const At& hold, const Of& of) {
    Vec3d sum = Vec3d::Zero();
    for (uint32_t k = 0; k < 4 && hold.node[k] != kNone; ++k) sum += hold.weight[k] * of(hold.node[k]);
    return sum;
}

Vec3d node_place(const AdvanceBody& b, const Float4* offsets, uint32_t node) {
    return to_vec3(b.origin) + Vec3d(offsets[node].x, offsets[node].y, offsets[node].z);
}
Vec3d node_velocity(const Particles& particles, const AdvanceBody& b, uint32_t node) {
    const uint32_t p = b.particles.first + node;
    return {particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]};
}

template <typename At>
const AdvanceBody& threaded_body(const AdvanceIsland& island, const At& hold) {
    return island.body[island.slot_of_body[hold.body]];
}

// What there is between the nodes' point and the body's, m.
Vec3d opening_of(const ThreadTouch& touch) { return touch.point; }
Vec3d opening_of(const ThreadHold& hold) { return is_grip(hold) ? Vec3d(Vec3d::Zero()) : hold.point; }

// The body's point when its forces are found: as of a link (link_forces.cpp).
template <typename At>
Vec3d thread_place_at_kick(const AdvanceCall& call, const Particles& particles, const AdvanceIsland& island, const At& hold,
                           uint32_t rigid) {
    if (rigid == kAwayBody) return hold.before;
    if (rigid != kNone) return to_vec3(island.rigid[rigid].pose[0](to_vec4(hold.point)));
    if (hold.body == kNone) return hold.point;
    const AdvanceBody& b = threaded_body(island, hold);
    const double ahead = b.synchronous() ? 0.5 * call.dt : 0.0;
    return opening_of(hold) +
           sum_held_nodes(hold, [&](uint32_t n) { return Vec3d(node_place(b, b.now, n) + ahead * node_velocity(particles, b, n)); });
}

// And at the time of the velocities.
template <typename At>
Vec3d thread_place_at_velocity(const Particles& particles, const AdvanceIsland& island, const At& hold, uint32_t rigid) {
    if (rigid == kAwayBody) return hold.before;
    if (rigid != kNone) return to_vec3(island.rigid[rigid].pose[1](to_vec4(hold.point)));
    if (hold.body == kNone) return hold.point;
    const AdvanceBody& b = threaded_body(island, hold);
    return opening_of(hold) + sum_held_nodes(hold, [&](uint32_t n) {
               return Vec3d(node_place(b, b.next, n) - 0.5 * b.last_dt * node_velocity(particles, b, n));
           });
}

template <typename At>
double kick_on(const AdvanceCall& call, const AdvanceIsland& island, const At& hold, uint32_t rigid) {
    if (rigid != kNone || hold.body == kNone) return call.dt;
    const AdvanceBody& b = threaded_body(island, hold);
    return (b.synchronous() ? 1.0 : 0.5) * call.dt + 0.5 * b.last_dt;
}

// Energy of a thread, its springs and its contacts, with the bodies' points as at the end of the last substep.
double energy_of_thread(const AdvanceCall& call, const Thread& thread, const Rod& rod) {
    const ThreadState& state = *call.inputs.other.thread_state;
    double sum = energy_of_rod(thread, rod, state.hold, call.params.gravity).sum();
    for (uint32_t i = 0; i < rod.count; ++i) {
        if (const uint32_t h = rod.held[i]; h != kNone)
            sum += energy_of_hold(state.hold[h].stiffness, rod.position[i] - state.hold[h].before);
        else
            for (const uint32_t t : touches_of(rod, i))
                if (t != kNone) sum += energy_of_touch(state.touch[t], rod.position[i], state.touch[t].before);
    }
    return sum;
}

// Draws a thread and the tissue of its new bites together. Returns the work of that, J.
double close_bites(const AdvanceCall& call, const AdvanceIsland& island, const Rod& rod) {
    double work = 0;
    for (uint32_t i = 0; i < rod.count; ++i) {
        const uint32_t h = rod.held[i];
        if (h == kNone) continue;
        ThreadHold& hold = call.inputs.other.thread_state->hold[h];
        const double left = hold.point.norm();
        if (!hold.slides || hold.body == kNone || island.threads.rigid[h] != kNone || !(left > 0)) continue;
        const double before = energy_of_hold(hold.stiffness, rod.position[i] - hold.before);
        const Vec3d closed = std::min(1.0, kClosingSpeed * call.dt / left) * hold.point;
        hold.point -= closed, hold.before -= closed;
        work += energy_of_hold(hold.stiffness, rod.position[i] - hold.before) - before;
    }
    return work;
}

// Lets points out that are nearer to bodies than they should be. Returns the work of that, J.
double let_points_out(const AdvanceCall& call, const Thread& thread, const Rod& rod) {
    ThreadState& state = *call.inputs.other.thread_state;
    double work = 0;
    for (uint32_t i = 0; i < rod.count; ++i)
        for (const uint32_t k : touches_of(rod, i))
            if (k != kNone && rod.held[i] == kNone)
                work += let_out(thread.radius + 0.5 * call.inputs.bodies.thickness[state.touch[k].body], call.dt, rod.position[i],
                                state.touch[k]);
    return work;
}

void set_planes(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, const Rod& rod) {
    IslandThreads& t = island.threads;
    const ThreadState& state = *call.inputs.other.thread_state;
    for (const uint32_t index : rod.touching.first(size_t{kTouchesPerPoint} * rod.count)) {
        if (index == kNone) continue;
        const ThreadTouch& touch = state.touch[index];
        const Vec3d place = thread_place_at_kick(call, particles, island, touch, t.touch_rigid[index]);
        Vec3d velocity = Vec3d::Zero();
        if (t.touch_rigid[index] == kNone) {
            const AdvanceBody& b = threaded_body(island, touch);
            velocity = sum_held_nodes(touch, [&](uint32_t n) { return node_velocity(particles, b, n); });
        } else if (t.touch_rigid[index] != kAwayBody) {
            const AdvanceRigid& rigid = island.rigid[t.touch_rigid[index]];
            const Vec4d point = to_vec4(touch.point);
            velocity = to_vec3(rigid.node == kNone ? (rigid.pose[1](point) - rigid.pose[0](point)) / call.dt
                                                   : island.nodes.node[rigid.node].velocity + rigid.velocity(point));
        }
        t.plane[index] = {touch.normal, touch.normal.dot(place) + touch.gap, velocity, touch.friction};
    }
}

// Forces of a thread on the bodies after its step. Returns the work of contact friction on the thread, J.
double set_thread_forces(const AdvanceCall& call, AdvanceIsland& island, uint32_t first, const Rod& rod) {
    IslandThreads& t = island.threads;
    const ThreadState& state = *call.inputs.other.thread_state;
    double work = 0;
    for (uint32_t i = 0; i < rod.count; ++i) {
        if (const uint32_t h = rod.held[i]; h != kNone) {
            t.row[h] = first + i;
            t.force[h] = state.hold[h].stiffness * (rod.position[i] - t.place[h]);
            if (!t.force[h].allFinite()) t.force[h].setZero();  // of a body about to be restored
            t.kick[h] = kick_on(call, island, state.hold[h], t.rigid[h]);
            continue;
        }
        for (const uint32_t k : touches_of(rod, i)) {
            if (k == kNone) continue;
            const Vec3d start = rod.position[i] - call.dt * rod.velocity[i];
            const PlaneForce force = force_of_plane(t.plane[k], start, rod.position[i], call.dt);
            t.touch_row[k] = first + i;
            t.touch_force[k] = -force.normal - force.friction, t.touch_friction[k] = -force.friction;
            if (!t.touch_force[k].allFinite()) t.touch_force[k] = t.touch_friction[k] = Vec3d::Zero();
            work += call.dt * force.friction.dot(rod.velocity[i]);
        }
    }
    return work;
}

// Slot of the needle of a thread in island.rigid, or kNone.
uint32_t needle_slot(const AdvanceCall& call, const AdvanceIsland& island, uint32_t thread) {
    const uint32_t tool = call.inputs.other.threads->thread[thread].tool;
    return tool == kNone ? kNone : island.slot_of_body[call.inputs.tools[tool].body];
}
Vec3d needle_place(const AdvanceRigid& needle, const ThreadHold& grip, int end) { return to_vec3(needle.pose[end](to_vec4(grip.point))); }

// Forces of a needle on the tissue that holds it, which slips where they are too large.
void set_grip_forces(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, uint32_t thread, AdvanceResult& result) {
    IslandThreads& t = island.threads;
    ThreadState& state = *call.inputs.other.thread_state;
    const uint32_t slot = needle_slot(call, island, thread);
    for (uint32_t h = 0; h < state.hold.size() && slot != kNone; ++h) {
        ThreadHold& grip = state.hold[h];
        if (grip.thread != thread || !is_grip(grip) || t.rigid[h] != kNone) continue;
        const AdvanceRigid& needle = island.rigid[slot];
        const Vec3d place = thread_place_at_kick(call, particles, island, grip, kNone), at = needle_place(needle, grip, 0);
        const double force = grip.stiffness * (at - place).norm();
        if (!std::isfinite(force)) continue;
        Vec3d held = at;
        if (force > grip.upper) {
            held = place + grip.upper / force * (at - place);
            grip.point = to_vec3(needle.pose[0].turn_back(to_vec4(held) - needle.pose[0].shift));
            result.work_contact += energy_of_hold(grip.stiffness, held - grip.before) - energy_of_hold(grip.stiffness, at - grip.before);
        }
        t.row[h] = call.inputs.other.threads->thread[thread].rows.first;  // any
        t.force[h] = grip.stiffness * (held - place), t.kick[h] = kick_on(call, island, grip, kNone);
    }
}

void add_force(const std::array<uint32_t, 4>& node, const std::array<double, 4>& weight, const Vec3d& force, float* const axis[3]) {
    for (uint32_t k = 0; k < 4 && node[k] != kNone; ++k)
        for (int i = 0; i < 3; ++i) axis[i][node[k]] += static_cast<float>(weight[k] * force[i]);
}

}  // namespace

void gather_threads(const AdvanceCall& call, AdvanceIsland& island, const AdvanceState& state) {
    IslandThreads& t = island.threads;
    t.thread.clear();
    const Threads* threads = call.inputs.other.threads;
    if (!threads) return;
    ThreadState& all = *call.inputs.other.thread_state;
    const Bodies& bodies = call.inputs.bodies;
    const auto note = [&](uint32_t thread, uint32_t body) {
        if (holds_in_island(island, bodies, body) && std::ranges::find(t.thread, thread) == t.thread.end()) t.thread.push_back(thread);
    };
    for (const ThreadHold& hold : all.hold) note(hold.thread, hold.body);
    for (const ThreadTouch& touch : all.touch) note(touch.thread, touch.body);
    std::sort(t.thread.begin(), t.thread.end());
    const auto assign = [](auto& list, size_t most, size_t count, const auto& value) { list.reserve(most), list.assign(count, value); };
    const size_t most = threads->most_holds, holds = all.hold.size(), rows = all.touching.size(), touches = all.touch.size();
    for (auto* list : {&t.place, &t.force}) assign(*list, most, holds, Vec3d(Vec3d::Zero()));
    for (auto* list : {&t.row, &t.rigid}) assign(*list, most, holds, kNone);
    assign(t.kick, most, holds, 0.0);
    for (auto* list : {&t.touch_force, &t.touch_friction}) assign(*list, rows, touches, Vec3d(Vec3d::Zero()));
    for (auto* list : {&t.touch_row, &t.touch_rigid}) assign(*list, rows, touches, kNone);
    assign(t.plane, rows, touches, RodPlane{});
    const auto bind = [&](const auto& at, uint32_t& rigid) {
        if (at.body == kNone || std::ranges::find(t.thread, at.thread) == t.thread.end()) return;
        if (!is_deformable(bodies, at.body))
            rigid = rigid_slot(call, at.body, island, state);
        else if (holds_in_island(island, bodies, at.body))
            island.body[island.slot_of_body[at.body]].threaded = true;
        else
            rigid = kAwayBody;
    };
    for (uint32_t h = 0; h < holds; ++h) bind(all.hold[h], t.rigid[h]);
    for (uint32_t k = 0; k < touches; ++k) bind(all.touch[k], t.touch_rigid[k]);
    for (const uint32_t index : t.thread) all.progress[index].stepped = true;
}

void step_threads(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result) {
    IslandThreads& t = island.threads;
    for (const uint32_t index : t.thread) {
        ThreadState& state = *call.inputs.other.thread_state;
        const Thread& thread = call.inputs.other.threads->thread[index];
        Rod rod = rod_of(thread, index, state);
        const double drawn = close_bites(call, island, rod), let = let_points_out(call, thread, rod);
        for (uint32_t i = 0; i < rod.count; ++i)
            if (const uint32_t h = rod.held[i]; h != kNone)
                t.place[h] = thread_place_at_kick(call, particles, island, state.hold[h], t.rigid[h]);
        set_planes(call, particles, island, rod);
        const bool account = call.params.account_energy;
        const double before = account ? energy_of_thread(call, thread, rod) : 0;
        const RodStep step = step_rod(thread, call.params.gravity, call.dt, rod, state.hold, t.place, t.plane, t.rod);
        if (!step.finite) ++result.nonfinite_particles;
        for (uint32_t h = 0; h < state.hold.size(); ++h)
            if (state.hold[h].thread == index) t.row[h] = kNone;
        for (uint32_t k = 0; k < state.touch.size(); ++k)
            if (state.touch[k].thread == index) t.touch_row[k] = kNone;
        const double rubbed = set_thread_forces(call, island, thread.rows.first, rod);
        set_grip_forces(call, particles, island, index, result);
        ThreadProgress& progress = state.progress[index];
        if (account) {
            result.work_damping += step.damping_work, result.work_contact += step.friction_work + rubbed + let;
            result.work_links += drawn + step.knot_work;
            const double numeric =
                energy_of_thread(call, thread, rod) - before - step.damping_work - step.friction_work - step.knot_work - rubbed;
            if (std::isfinite(numeric)) result.work_numeric += numeric;
        }
        progress.largest_tension = std::max(progress.largest_tension, step.largest_tension);
        progress.friction_work += step.friction_work;
    }
}

void add_thread_forces(const OtherForces& other, const AdvanceIsland& island, uint32_t body, float* const axis[3]) {
    const IslandThreads& t = island.threads;
    const ThreadState& state = *other.thread_state;
    for (uint32_t h = 0; h < t.row.size(); ++h)
        if (t.row[h] != kNone && state.hold[h].body == body) add_force(state.hold[h].node, state.hold[h].weight, t.force[h], axis);
    for (uint32_t k = 0; k < t.touch_row.size(); ++k)
        if (t.touch_row[k] != kNone && state.touch[k].body == body)
            add_force(state.touch[k].node, state.touch[k].weight, t.touch_force[k], axis);
}

double work_of_threads(const OtherForces& other, const AdvanceIsland& island, const AdvanceBody& b) {
    const IslandThreads& t = island.threads;
    const ThreadState& state = *other.thread_state;
    const auto moved = [&](uint32_t n) { return Vec3d(node_place(b, b.next, n) - node_place(b, b.now, n)); };
    double work = 0;
    for (uint32_t h = 0; h < t.row.size(); ++h)
        if (t.row[h] != kNone && state.hold[h].body == b.body) work += t.force[h].dot(sum_held_nodes(state.hold[h], moved));
    for (uint32_t k = 0; k < t.touch_row.size(); ++k)
        if (t.touch_row[k] != kNone && state.touch[k].body == b.body) work += t.touch_force[k].dot(sum_held_nodes(state.touch[k], moved));
    return work;
}

namespace {

// Applies an impulse (N s) at a point (m, of its frame) to a rigid body. Returns the kinetic energy that a free one gains, J.
double push_rigid(const AdvanceCall& call, AdvanceIsland& island, uint32_t slot, const Vec3d& point, const Vec3d& push,
                  std::span<ToolState> tools) {
    AdvanceRigid& rigid = island.rigid[slot];
    const Vec4d impulse = to_vec4(push), at = rigid.pose[0](to_vec4(point));
    const uint32_t tool = rigid.holder == kNone ? rigid.tool : island.rigid[rigid.holder].tool;
    if (tool != kNone) tools[tool].contact_impulse += push;
    add_grip_moment(call, island, slot, at, impulse, tools);
    if (rigid.node == kNone) return 0;
    const ContactNode node = island.nodes.node[rigid.node];
    const auto speed = [&] { return node.velocity + rigid.velocity(to_vec4(point)); };
    const Vec4d before = speed();
    node.velocity += node.inv_mass * impulse;
    if (rigid.free == kNone) return 0;
    AdvanceFree& f = island.free[rigid.free];
    f.spin += f.respond(cross(at - node.position, impulse));
    f.spin_before = f.spin;
    note_spin(f, island);
    return f.held ? 0 : 0.5 * dot(impulse, before + speed());
}

}  // namespace

void pull_threaded_rigids(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools, AdvanceResult& result) {
    const IslandThreads& t = island.threads;
    if (t.thread.empty()) return;
    const ThreadState& state = *call.inputs.other.thread_state;
    const auto in_island = [](uint32_t row, uint32_t rigid) { return row != kNone && rigid != kNone && rigid != kAwayBody; };
    for (uint32_t h = 0; h < t.row.size(); ++h) {
        const ThreadHold& hold = state.hold[h];
        if (in_island(t.row[h], t.rigid[h]))
            push_rigid(call, island, t.rigid[h], hold.point, t.kick[h] * t.force[h], tools);
        else if (t.row[h] != kNone && is_grip(hold))
            push_rigid(call, island, needle_slot(call, island, hold.thread), hold.point, -call.dt * t.force[h], tools);
    }
    for (uint32_t k = 0; k < t.touch_row.size(); ++k)
        if (in_island(t.touch_row[k], t.touch_rigid[k]))
            result.work_numeric += push_rigid(call, island, t.touch_rigid[k], state.touch[k].point, call.dt * t.touch_force[k], tools);
}

namespace {

// The part of an energy that leapfrog has in its step, as in engine/tissue/body_energy.hpp.
template <typename At>
double of_step(const AdvanceCall& call, const Particles& particles, const AdvanceIsland& island, const At& hold, uint32_t rigid,
               const Vec3d* axis) {
    if (!call.inputs.other.actions || rigid != kNone || hold.body == kNone) return 0;
    const AdvanceBody& b = threaded_body(island, hold);
    if (b.synchronous()) return 0;
    const Vec3d rate = sum_held_nodes(hold, [&](uint32_t n) { return node_velocity(particles, b, n); });
    const double speed2 = axis ? std::pow(axis->dot(rate), 2) : rate.squaredNorm();
    return -0.125 * b.last_dt * b.last_dt * speed2;
}

// A free body, which no hand holds.
bool is_unheld(const AdvanceIsland& island, uint32_t rigid) {
    if (rigid == kNone || rigid == kAwayBody) return false;
    const uint32_t free = island.rigid[rigid].free;
    return free != kNone && !island.free[free].held;
}

// Touches whose points have been taken out store nothing: that went to work_numeric.
void drop_touches(uint32_t thread, const Rod& rod, ThreadState& state) {
    for (uint32_t k = 0; k < state.touch.size(); ++k)
        if (state.touch[k].thread == thread && state.touch[k].stored != 0 &&
            std::ranges::count(rod.touching.first(size_t{kTouchesPerPoint} * rod.count), k) == 0)
            state.touch[k].stored = 0;
}

}  // namespace

void finish_threads(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result) {
    const IslandThreads& t = island.threads;
    if (t.thread.empty()) return;
    ThreadState& state = *call.inputs.other.thread_state;
    for (uint32_t h = 0; h < t.row.size(); ++h) {
        if (t.row[h] == kNone) continue;
        ThreadHold& hold = state.hold[h];
        hold.impulse += t.kick[h] * t.force[h];
        const AdvanceRigid* needle = is_grip(hold) ? &island.rigid[needle_slot(call, island, hold.thread)] : nullptr;
        const Vec3d at = needle ? needle_place(*needle, hold, 0) : state.position[t.row[h]];
        const Vec3d place = thread_place_at_velocity(particles, island, hold, t.rigid[h]);
        if (!place.allFinite()) continue;  // of a body about to be restored
        const double energy = energy_of_hold(hold.stiffness, at - place),
                     gained = energy - energy_of_hold(hold.stiffness, at - hold.before);
        if (t.rigid[h] != kNone) result.work_hand += gained;
        // what leapfrog gives a body its spring loses; an implicit step is given the force at its middle
        else if (hold.body != kNone && threaded_body(island, hold).synchronous())
            result.work_numeric += gained + t.force[h].dot(place - hold.before);
        const double moved = needle ? energy_of_hold(hold.stiffness, needle_place(*needle, hold, 1) - place) - energy : 0;  // by the hand
        result.work_hand += moved;
        hold.before = place;
        hold.stored = energy + moved + hold.stiffness * of_step(call, particles, island, hold, t.rigid[h], nullptr);
    }
    for (uint32_t k = 0; k < t.touch_row.size(); ++k) {
        if (t.touch_row[k] == kNone) continue;
        ThreadTouch& touch = state.touch[k];
        const Vec3d& at = state.position[t.touch_row[k]];
        const Vec3d place = thread_place_at_velocity(particles, island, touch, t.touch_rigid[k]);
        if (!place.allFinite()) continue;
        const double energy = energy_of_touch(touch, at, place), gained = energy - energy_of_touch(touch, at, touch.before);
        const double rubbed = t.touch_friction[k].dot(place - touch.before);
        const double step = energy > 0 ? kContactStiffness * of_step(call, particles, island, touch, t.touch_rigid[k], &touch.normal) : 0;
        const bool free = is_unheld(island, t.touch_rigid[k]);
        // scripts and hands give and take what friction takes and gives on their side
        if (t.touch_rigid[k] == kNone || free) result.work_contact += rubbed;
        if (free) {
            result.work_numeric += gained - rubbed;
        } else if (t.touch_rigid[k] != kNone) {
            result.work_hand += gained;
        } else {  // what the body's nodes get and the spring does not lose: contact that begins or ends within a substep, and implicit
                  // steps
            const Vec3d start = at - call.dt * state.velocity[t.touch_row[k]];
            const double step_before = touch.stored - energy_of_touch(touch, start, touch.before);
            result.work_numeric += gained + step - step_before + (t.touch_force[k] - t.touch_friction[k]).dot(place - touch.before);
        }
        touch.before = place;
        touch.stored = energy + step;
    }
    for (const uint32_t index : t.thread) {
        const Thread& thread = call.inputs.other.threads->thread[index];
        Rod rod = rod_of(thread, index, state);
        const double before = call.params.account_energy ? energy_of_thread(call, thread, rod) : 0;
        state.progress[index].slipped_off += refine_rod(thread, rod, state.hold);
        for (ThreadHold& hold : state.hold)
            if (hold.thread == index && hold.left) hold.stored = 0;  // its energy goes with the points' to work_numeric
        drop_touches(index, rod, state);
        if (call.params.account_energy) result.work_numeric += energy_of_thread(call, thread, rod) - before;
    }
}

}  // namespace trocar
