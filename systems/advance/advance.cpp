#include "systems/advance/advance.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/base/check.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/relaxation.hpp"
#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/contact/contact_impulses.hpp"
#include "systems/advance/contact/implicit_contacts.hpp"
#include "systems/advance/contact/position_correction.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/advance/rigid/driven_bodies.hpp"
#include "systems/advance/rigid/free_bodies.hpp"
#include "systems/advance/rigid/grasped_bodies.hpp"
#include "systems/advance/rigid/rigid_bodies.hpp"
#include "systems/advance/tissue/backward_euler.hpp"
#include "systems/advance/tissue/fine_steps.hpp"
#include "systems/advance/tissue/forces.hpp"
#include "systems/advance/tissue/link_forces.hpp"
#include "systems/advance/tissue/runaway.hpp"
#include "systems/advance/tissue/tears.hpp"
#include "systems/advance/tissue/thread_forces.hpp"
namespace trocar {
namespace {

constexpr uint32_t kBodiesAtOnce = 32;

AdvanceBody make_body(const AdvanceCall& call, uint32_t body, uint32_t buffer, const AdvanceState& state) {
    const Bodies& bodies = call.inputs.bodies;
    const Springs& springs = call.inputs.springs;
    AdvanceBody b;
    b.body = body;
    b.particles = bodies.particles[body];
    if (const uint32_t skin = springs.info[bodies.mesh[body]].skin; skin > 0) {
        const Solids& solids = *call.inputs.other.solids;
        const uint32_t first = solids.info[bodies.mesh[body]].skin.first;
        b.embedding_node = solids.embedding_node.data() + first;
        b.embedding_weight = solids.embedding_weight.data() + first;
        b.particles = {b.particles.first + skin, b.particles.count - skin};
    }
    b.slices = springs.info[bodies.mesh[body]].slices.count;
    b.buffer = buffer;
    b.shape = bodies.anchor_frame[body] == AnchorFrame::kShape;
    b.damping = bodies.tissue[body].damping;
    b.last_dt = state.particles.last_dt[body];
    b.stepping = stepping_of(call.inputs, body);
    // impulses act in the kick, like all forces. The damping after a held body's kick must damp them too, or
    // damping would carry part of a resting load
    if (!b.shape) b.impulse_left = std::exp(-0.5 * b.damping * call.dt);
    b.origin = to_vec4(state.poses.origin[body]);
    b.orientation = state.poses.orientation[body];
    b.now = state.particles.offset.data() + b.particles.first;
    b.step = bind_body(springs, bodies, call.inputs.anchors, state.particles, body, call.inputs.other.torn_springs);
    bind_relaxation(call.inputs.other.relaxation, bodies, body, b.last_dt, b.step);
    b.tear = tear_of(call.inputs.other.tears, body);
    SpringStep& step = b.step;
    step.new_velocity_x = state.particles.velocity_x.data() + b.particles.first;
    step.new_velocity_y = state.particles.velocity_y.data() + b.particles.first;
    step.new_velocity_z = state.particles.velocity_z.data() + b.particles.first;
    step.dt = static_cast<float>(call.dt);
    for (int i = 0; i < 3; ++i) step.gravity[i] = static_cast<float>(call.params.gravity[i]);
    return b;
}

// Whether rounding takes more than half a percent of 1 mm/s from positions stepped by dt: the body then keeps
// the remainder from substep to substep, and round_remainders removes it at the end of a call.
bool carry_remainder(const AdvanceCall& call, uint32_t body) {
    if (call.params.substeps == 1 || stepping_of(call.inputs, body).integrator != Integrator::kLeapfrog) return false;
    const float radius = static_cast<float>(call.inputs.meshes.info[call.inputs.bodies.mesh[body]].radius);
    const double ulp = std::nextafter(radius, std::numeric_limits<float>::infinity()) - radius;
    return ulp > 0.01 * 1e-3 * call.dt;
}

void give_remainders(const AdvanceCall& call, uint32_t particles, TissueScratch& scratch, AdvanceIsland& island) {
    const auto carries = [&](const AdvanceBody& b) { return carry_remainder(call, b.body); };
    if (std::none_of(island.body.begin(), island.body.end(), carries)) return;
    const auto is_stiff = [&](const AdvanceBody& b) {
        return carries(b) && is_heated_by_rounding(call.inputs.meshes.info[call.inputs.bodies.mesh[b.body]].radius, call.dt);
    };
    const size_t copies = std::any_of(island.body.begin(), island.body.end(), is_stiff) ? 2 : 1;
    scratch.remainder.assign(3 * copies * particles, 0.0f);
    for (AdvanceBody& b : island.body) {
        if (!carries(b)) continue;
        b.step.remainder_step = is_stiff(b) ? long{3} * particles : 0;  // neighbours read the former ones
        b.step.remainder_x = scratch.remainder.data() + b.buffer;
        b.step.remainder_y = b.step.remainder_x + particles;
        b.step.remainder_z = b.step.remainder_y + particles;
    }
}

// Memory to account for changes of the step, where instruments act.
void give_velocities_before(const AdvanceCall& call, uint32_t particles, TissueScratch& scratch, AdvanceIsland& island) {
    if (!call.inputs.other.actions || !call.params.account_energy) return;
    scratch.velocity_before.resize(3 * size_t{particles});
    for (AdvanceBody& b : island.body)
        if (b.last_dt != call.dt) b.velocity_before = scratch.velocity_before.data() + 3 * size_t{b.buffer};
}

void gather_bodies(const AdvanceCall& call, std::span<const uint32_t> island_bodies, TissueScratch& scratch, AdvanceIsland& island,
                   const AdvanceState& state, AdvanceResult& result) {
    island.body.clear();
    island.rigid.clear();
    island.nodes.node.resize(0);
    island.nodes.change.resize(0);
    island.free.clear();
    island.slot_of_body.resize(call.inputs.bodies.mesh.size(), kNone);
    uint32_t particles = 0;
    for (const uint32_t body : island_bodies) {
        if (is_deformable(call.inputs.bodies, body)) {
            island.slot_of_body[body] = static_cast<uint32_t>(island.body.size());
            island.body.push_back(make_body(call, body, particles, state));
            particles += island.body.back().particles.count;
        } else if (joins_islands(call.inputs.bodies.motion[body])) {
            rigid_slot(call, body, island, state);
        }
    }
    parallel_for(static_cast<uint32_t>(island.body.size()), kBodiesAtOnce, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) island.body[i].kinetic = kinetic_energy(state.particles, island.body[i]);
    });
    resize_raw(scratch.offset_a, particles);
    resize_raw(scratch.offset_b, particles);
    give_remainders(call, particles, scratch, island);
    give_velocities_before(call, particles, scratch, island);
    gather_links(call, island, state, result);
    gather_threads(call, island, state);
    gather_grasps(call, island, state);
    give_forces(call, state.particles, particles, scratch, island);
}

// Energy (J) that leapfrog gains in a kick where the step changes from h1 to h2: -(h2 - h1) / 4 F (v+ - v-), with the force F at
// the kick (from the energy of body_energy.hpp on both sides of it and the work at the mean velocity).
double gain_of_changed_step(const AdvanceBody& b, double change) {
    const float* old[3] = {b.velocity_before, b.velocity_before + b.particles.count, b.velocity_before + 2 * size_t{b.particles.count}};
    const float* now[3] = {b.step.new_velocity_x, b.step.new_velocity_y, b.step.new_velocity_z};
    const double lost = b.shape ? 0.0 : double{b.step.keep} - 1;
    double sum = 0;
    for (uint32_t p = 0; p < b.particles.count; ++p) {
        if (!(b.now[p].w > 0)) continue;
        double power = 0;
        for (int i = 0; i < 3; ++i) {
            const double kick = double{now[i][p]} - double{old[i][p]};
            power += (kick - lost * double{old[i][p]}) * kick;
        }
        sum += power / double{b.now[p].w};
    }
    return -0.25 * change * sum / double{b.step.kick_dt};
}

// Lanes of damping work, kept per chunk over the whole call.
void clear_sums(const AdvanceIsland& island, TissueScratch& scratch) {
    size_t chunks = 0;
    for (const AdvanceBody& b : island.body) chunks += chunk_count(b.slices, kSlicesPerChunk);
    scratch.sums.assign(chunks * kSliceWidth, 0.0);
}

// One kick and drift of a leapfrog body.
void step_leapfrog(const AdvanceCall& call, Poses& poses, AdvanceBody& b, std::vector<double>& shape_sums) {
    const SpringKernels& kernels = spring_kernels();
    // the first kick is a half one, after which velocities are half a step behind
    const double kick = 0.5 * (b.last_dt + call.dt), change = call.dt - b.last_dt;
    if (b.step.branches > 0) set_relaxing_time(prony_of(call.inputs.bodies, b.body), b.last_dt, b.step);
    b.last_dt = call.dt;
    // damping acts half before and half after the kick: second order (Strang). Free bodies are damped
    // relative to their rigid motion, which must not slow down: all before the kick, first order
    const double left = b.shape ? 1.0 : std::exp(-0.5 * b.damping * kick);
    b.step.kick_dt = static_cast<float>(kick * left);
    b.step.kick_less = static_cast<float>(kick * (left - 1));
    b.step.keep = static_cast<float>(std::exp(-b.damping * kick));
    if (b.shape) {
        const ShapeTotals totals = sum_shape(b.step, b.slices, shape_sums);
        fit_goals(totals, poses.orientation[b.body], b.step);
        fit_drag(totals, b.step);
    }
    const bool changes = b.velocity_before && change != 0;
    if (changes) {
        const float* const from[3] = {b.step.velocity_x, b.step.velocity_y, b.step.velocity_z};
        for (int i = 0; i < 3; ++i) std::copy_n(from[i], b.particles.count, b.velocity_before + size_t(i) * b.particles.count);
    }
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
        kernels.step(&b.step, begin, end, b.damping_work ? b.damping_work + begin / kSlicesPerChunk * kSliceWidth : nullptr);
    });
    if (changes) b.changed_step = gain_of_changed_step(b, change);
    if (b.step.remainder_step == 0) return;
    for (float** remainder : {&b.step.remainder_x, &b.step.remainder_y, &b.step.remainder_z}) *remainder += b.step.remainder_step;
    b.step.remainder_step = -b.step.remainder_step;
}

// Forces besides springs and anchors at a substep's start. Returns whether a leapfrog body needs finer steps.
bool find_forces_of(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, TissueScratch& scratch,
                    AdvanceBody& b, AdvanceResult& result) {
    if (!b.step.force_x) return false;
    const double so_far = std::exchange(result.min_volume_ratio, std::numeric_limits<double>::infinity());
    find_forces(call, island, particles, scratch, b, result);
    const double least = std::exchange(result.min_volume_ratio, std::min(so_far, result.min_volume_ratio));
    return b.stepping.integrator == Integrator::kLeapfrog && !b.touched && needs_subcycling(call, particles, b, least, scratch);
}

void step_subcycled(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                    AdvanceResult& result) {
    const double damped = step_finely(call, island, scratch, state, b, result);
    if (b.damping_work) b.damping_work[0] += damped;
}

// Bodies with springs and anchors only; several are stepped in parallel.
bool steps_alone(const AdvanceBody& b) { return b.stepping.integrator == Integrator::kLeapfrog && !b.step.force_x; }

void step_bodies(const AdvanceCall& call, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result) {
    constexpr uint32_t kBodiesPerChunk = 16;
    const uint32_t bodies = static_cast<uint32_t>(island.body.size());
    uint32_t chunk = 0;
    for (AdvanceBody& b : island.body) {
        b.first_chunk = chunk;
        chunk += chunk_count(b.slices, kSlicesPerChunk);
    }
    if (scratch.body_shape_sums.size() < chunk_count(bodies, kBodiesPerChunk))
        scratch.body_shape_sums.resize(chunk_count(bodies, kBodiesPerChunk));
    const auto step = [&](AdvanceBody& b, std::vector<double>& shape_sums) {
        b.next = (call.substep % 2 == 0 ? scratch.offset_a : scratch.offset_b).data() + b.buffer;
        b.step.offset = &b.now->x;
        b.step.new_offset = &b.next->x;
        b.damping_work = call.params.account_energy && (b.damping > 0 || b.step.branches > 0)
                             ? scratch.sums.data() + b.first_chunk * kSliceWidth
                             : nullptr;
        const bool subcycled = find_forces_of(call, island, state.particles, scratch, b, result);
        switch (b.stepping.integrator) {
            case Integrator::kLeapfrog:
                subcycled ? step_subcycled(call, island, scratch, state, b, result) : step_leapfrog(call, state.poses, b, shape_sums);
                break;
            case Integrator::kBackwardEuler:
                if (!b.touched) step_backward_euler(call, island, scratch, state, b, result);  // else begin_touched_steps
                break;
        }
        const float* drag = b.step.drag_velocity;
        const float* turn = b.step.drag_turn;
        b.drag_velocity = make_vec4(drag[0], drag[1], drag[2]);
        b.drag_turn = make_vec4(turn[0], turn[1], turn[2]);
    };
    if (!std::all_of(island.body.begin(), island.body.end(), steps_alone)) {
        for (AdvanceBody& b : island.body) step(b, scratch.shape_sums);
        return;
    }
    parallel_for(bodies, kBodiesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) step(island.body[i], scratch.body_shape_sums[begin / kBodiesPerChunk]);
    });
}

bool is_lost(const Float4& o) { return !(std::abs(o.x) < kLost && std::abs(o.y) < kLost && std::abs(o.z) < kLost); }

uint32_t count_lost(const Float4* offsets, uint32_t count) {
    uint32_t lost = 0;
    for (uint32_t p = 0; p < count; ++p) lost += is_lost(offsets[p]);
    return lost;
}

// Restores a body to the start of the call, at rest; particles already lost there are put at their goals.
void restore_body(const AdvanceCall& call, const AdvanceBody& b, const AdvanceState& state) {
    Particles& particles = state.particles;
    const Range range = b.particles;
    for (auto* field : {&particles.velocity_x, &particles.velocity_y, &particles.velocity_z}) {
        std::fill_n(field->begin() + range.first, range.count, 0.0f);
    }
    particles.last_dt[b.body] = 0;
    state.poses.orientation[b.body] = b.orientation;
    Vec3d centre = Vec3d::Zero();
    double weight = 0;
    const Quat turn = b.shape ? b.orientation : Quat{};
    const auto goal = [&](uint32_t p) {
        const Anchors& a = call.inputs.anchors;
        return rotate(turn, Vec3d(a.rest_x[p], a.rest_y[p], a.rest_z[p]));
    };
    if (b.shape) {
        for (uint32_t p = range.first; p < range.end(); ++p) {
            const Float4& o = particles.offset[p];
            if (is_lost(o)) continue;
            const double k = call.inputs.anchors.stiffness[p];
            centre += k * (Vec3d(o.x, o.y, o.z) - goal(p));
            weight += k;
        }
        if (weight > 0) centre /= weight;
    }
    for (uint32_t p = range.first; p < range.end(); ++p) {
        Float4& o = particles.offset[p];
        if (!is_lost(o)) continue;
        const Vec3d g = centre + goal(p);
        o = {static_cast<float>(g.x()), static_cast<float>(g.y()), static_cast<float>(g.z()), o.w};
    }
    if (b.step.branches > 0) {
        SpringStep step = b.step;
        step.offset = &particles.offset[range.first].x;
        forget_relaxation(step, b.slices);
    }
}

// m, of a particle's anchor.
double goal_of(const SpringStep& step, uint32_t v, int axis) {
    const float rest[3] = {step.anchor_x[v], step.anchor_y[v], step.anchor_z[v]};
    double goal = double{step.centre[axis]} + step.centre_rest[axis];
    for (int k = 0; k < 3; ++k) goal += (double{step.turn[3 * axis + k]} + step.turn_rest[3 * axis + k]) * rest[k];
    return goal;
}

// Removes a body's rounding remainders at the end of a call: rounds each up or down by a hash of call and
// particle, with probability by size, so that over hundreds of calls the errors cancel. In a stiff body that would add energy in every
// call: each is rounded towards its goal.
void round_remainders(const AdvanceCall& call, const AdvanceBody& b, Particles& particles) {
    const float* remainder[3] = {b.step.remainder_x, b.step.remainder_y, b.step.remainder_z};
    uint64_t seed = (call.params.tick + 1) * 0xbf58476d1ce4e5b9ull;
    seed ^= seed >> 29;
    const bool stiff = b.step.remainder_step != 0;
    const auto round = [&](uint32_t v) {
        Float4& o = particles.offset[b.particles.first + v];
        if (!(o.w > 0)) return;
        const uint64_t z = (seed + v) * 0x9e3779b97f4a7c15ull;  // a Weyl sequence: evenly distributed over the particles
        float* const position[3] = {&o.x, &o.y, &o.z};
        for (int i = 0; i < 3; ++i) {
            const float r = remainder[i][v], from = *position[i];
            // the next float in that direction; branch-free, as branches would be unpredictable
            const int32_t away = (from != 0) * (2 * ((r > 0) == (from > 0)) - 1);
            const float next = std::bit_cast<float>(std::bit_cast<int32_t>(from) + away);
            const float dice = static_cast<float>(static_cast<int32_t>(z >> (4 + 20 * i) & 0xfffff)) * 0x1p-20f;
            *position[i] = std::abs(r) > dice * std::abs(next - from) ? next : from;
            if (stiff && b.step.anchor_stiffness[v] > 0)
                *position[i] = r != 0 && (r > 0) == (goal_of(b.step, v, i) > double{from} + r) ? next : from;
        }
    };
    parallel_for_even(b.particles.count, kSlicesPerChunk * kSliceWidth, kLeastShared, [&](uint32_t begin, uint32_t end) {
        for (uint32_t v = begin; v < end; ++v) round(v);
    });
}

// Volumes are looked at one by one only where some were small at the start of a substep, or where nothing measured them.
uint32_t count_inverted(const AdvanceCall& call, uint32_t body, const Particles& particles, double least_ratio) {
    const OtherForces& other = call.inputs.other;
    const Bodies& bodies = call.inputs.bodies;
    if (!other.solids || !is_solid(*other.solids, bodies.mesh[body])) return 0;
    if (least_ratio > kPressedFlat && has_tets(other.solids, bodies, body)) return 0;
    return inverted_tetrahedra(bind_tets(*other.solids, bodies, particles, body, other.torn_springs));
}

// Writes the particles of a body back, or restores their values at the start of the call.
void finish_body(const AdvanceCall& call, const AdvanceBody& b, TissueScratch& scratch, const AdvanceState& state, AdvanceResult& result) {
    const auto count = [](uint64_t& counter, uint64_t more) { std::atomic_ref(counter).fetch_add(more, std::memory_order_relaxed); };
    const uint32_t lost = count_lost(b.now, b.particles.count);
    const bool ran_away = lost == 0 && has_run_away(call, state.particles, b, scratch);
    if (lost > 0) count(result.nonfinite_particles, lost);
    if (ran_away) count(result.runaway_bodies, 1);
    if (lost > 0 || ran_away) return restore_body(call, b, state);
    std::copy_n(b.now, b.particles.count, state.particles.offset.begin() + b.particles.first);
    if (b.step.remainder_x) round_remainders(call, b, state.particles);
    if (const uint32_t inverted = count_inverted(call, b.body, state.particles, result.min_volume_ratio); inverted > 0)
        count(result.inverted_tetrahedra, inverted);
    state.particles.last_dt[b.body] = b.last_dt;
}

void finish_bodies(const AdvanceCall& call, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                   AdvanceResult& result) {
    const std::vector<AdvanceBody>& bodies = island.body;
    parallel_for(static_cast<uint32_t>(bodies.size()), kBodiesAtOnce, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) finish_body(call, bodies[i], scratch, state, result);
    });
    for (const AdvanceBody& b : island.body) {
        if (b.embedding_node) drape_skin(*call.inputs.other.solids, call.inputs.bodies, b.body, state.particles);
    }
    for (const AdvanceRigid& rigid : island.rigid) {
        if (rigid.node == kNone || (rigid.free != kNone && rigid.jaw == kNone)) continue;
        const ContactNode node = island.nodes.node[rigid.node];
        state.poses.origin[rigid.body] = to_vec3(rigid.jaw == kNone ? node.position : rigid.pose[1].shift);
        Vec4d velocity = node.velocity;
        if (rigid.free != kNone) velocity += cross(island.free[rigid.free].spin, rigid.pose[1].shift - node.position);
        state.poses.velocity[rigid.body] = to_vec3(velocity);
        state.poses.orientation[rigid.body] = rigid.orientation[1];
        state.poses.angular_velocity[rigid.body] = rotation_vector(rigid.orientation[0], rigid.orientation[1]) / call.dt;
    }
    finish_free_bodies(call, island, state, result);
}

}  // namespace

uint32_t count_substeps(const Bodies& bodies, std::span<const uint32_t> island_bodies, double seconds, double largest,
                        std::span<const double> linked, bool all_leapfrog) {
    double stable = std::numeric_limits<double>::infinity();
    for (const uint32_t body : island_bodies) {
        if (body < linked.size()) stable = std::min(stable, linked[body]);
        const Stepping stepping = stepping_of(bodies, body);
        const bool leapfrog = all_leapfrog || stepping.integrator == Integrator::kLeapfrog;
        stable = std::min(stable, leapfrog ? std::min({bodies.stable_dt[body], largest, stepping.step}) : stepping.step);
    }
    return substeps_for(seconds, stable, seconds);
}

void add_advance_result(const AdvanceResult& result, Energy& energy, Report& report) {
    energy.work_hand += result.work_hand;
    energy.work_contact += result.work_contact;
    energy.work_damping += result.work_damping;
    energy.work_push += result.work_push;
    energy.work_numeric += result.work_numeric;
    energy.work_links += result.work_links;
    add_to_report(result, report);
}

namespace {

// Reserves in all scratches the largest capacity of the vectors that field(scratch) names.
template <typename Field>
void share_capacity(std::span<AdvanceScratch> scratches, const Field& field) {
    size_t most = 0;
    for (AdvanceScratch& s : scratches) most = std::max(most, field(s).capacity());
    for (AdvanceScratch& s : scratches) field(s).reserve(most);
}

}  // namespace

void share_room(std::span<AdvanceScratch> scratches) {
    const auto level = [&](const auto& part, auto... field) {
        (share_capacity(scratches, [&](AdvanceScratch& s) -> decltype(auto) { return (part(s).*field); }), ...);
    };
    const auto island = [](AdvanceScratch& s) -> AdvanceIsland& { return s.island; };
    const auto nodes = [](AdvanceScratch& s) -> ContactNodeSet& { return s.island.nodes; };
    const auto links = [](AdvanceScratch& s) -> IslandLinks& { return s.island.links; };
    const auto solver = [](AdvanceScratch& s) -> ContactSolver& { return s.solver; };
    const auto sorting = [](AdvanceScratch& s) -> ContactSorting& { return s.sorting; };
    const auto components = [](AdvanceScratch& s) -> ContactComponents& { return s.components; };
    const auto tissue = [](AdvanceScratch& s) -> TissueScratch& { return s.tissue; };
    const auto implicit = [](AdvanceScratch& s) -> ImplicitScratch& { return s.tissue.implicit; };
    using I = AdvanceIsland;
    level(island, &I::body, &I::rigid, &I::free, &I::slot_of_body, &I::grasp);
    using N = ContactNodeSet;
    level(nodes, &N::node, &N::change, &N::pressed, &N::tangled, &N::moved_in, &N::node_of_particle, &N::embedded_point, &N::node_sums,
          &N::response);
    level(links, &IslandLinks::link, &IslandLinks::link_end, &IslandLinks::link_group);
    const auto threads = [](AdvanceScratch& s) -> IslandThreads& { return s.island.threads; };
    const auto rod = [](AdvanceScratch& s) -> RodScratch& { return s.island.threads.rod; };
    using H = IslandThreads;
    level(threads, &H::thread, &H::row, &H::rigid, &H::place, &H::force, &H::kick, &H::touch_row, &H::touch_rigid, &H::touch_force,
          &H::touch_friction, &H::plane);
    using Q = RodScratch;
    level(rod, &Q::band, &Q::right, &Q::small, &Q::slide, &Q::bite, &Q::mass, &Q::start_material, &Q::start, &Q::goal, &Q::flow, &Q::grip,
          &Q::knot);
    using C = ContactSolver;
    level(solver, &C::prepared, &C::wide_constraint, &C::fixed);
    using S = ContactSorting;
    level(sorting, &S::order, &S::ungrouped, &S::slab, &S::along, &S::group_of_constraint, &S::next_of_group);
    level(sorting, &S::key, &S::may_conflict, &S::open_wide_of_node);
    using K = ContactComponents;
    level(components, &K::sorted_active, &K::component, &K::component_of);
    using T = TissueScratch;
    level(tissue, &T::offset_a, &T::offset_b, &T::remainder, &T::force, &T::velocity_before, &T::force_sums, &T::corner_force,
          &T::hinge_force);
    level(tissue, &T::sums, &T::shape_sums, &T::overstretched);
    using M = ImplicitScratch;
    level(implicit, &M::position, &M::inertia, &M::displacement, &M::force, &M::change, &M::volume_gradient, &M::volume_response);
    level(implicit, &M::rate, &M::still, &M::volume_force, &M::sums);
    level(tissue, &T::factor);
    for (uint32_t k = 0; k < M::kHistory; ++k)
        for (const auto fields : {&M::iterate, &M::changes, &M::forces})
            share_capacity(scratches, [&](AdvanceScratch& s) -> decltype(auto) { return ((s.tissue.implicit.*fields)[k]); });

    size_t groups = 0, chunks = 0, directs = 0, touched = 0;
    for (const AdvanceScratch& s : scratches) {
        groups = std::max(groups, s.solver.group.size());
        chunks = std::max(chunks, s.tissue.body_shape_sums.size());
        directs = std::max(directs, s.components.direct.size());
        touched = std::max(touched, s.tissue.touched.size());
    }
    for (AdvanceScratch& s : scratches) s.tissue.touched.resize(touched);
    for (size_t i = 0; i < touched; ++i) {
        const auto of_body = [&](AdvanceScratch& s) -> ImplicitScratch& { return s.tissue.touched[i]; };
        level(of_body, &M::position, &M::inertia, &M::displacement, &M::force, &M::change, &M::volume_gradient, &M::volume_response);
        level(of_body, &M::rate, &M::still, &M::metric, &M::response);
        for (uint32_t k = 0; k < M::kHistory; ++k)
            for (const auto fields : {&M::iterate, &M::changes, &M::forces})
                share_capacity(scratches, [&](AdvanceScratch& s) -> decltype(auto) { return ((of_body(s).*fields)[k]); });
    }
    for (AdvanceScratch& s : scratches)
        s.solver.group.resize(groups), s.tissue.body_shape_sums.resize(chunks), s.components.direct.resize(directs);
    for (size_t g = 0; g < groups; ++g)
        level([&](AdvanceScratch& s) -> ConstraintGroup& { return s.solver.group[g]; }, &ConstraintGroup::active,
              &ConstraintGroup::active_wide, &ConstraintGroup::pressing);
    for (size_t c = 0; c < chunks; ++c)
        share_capacity(scratches, [&](AdvanceScratch& s) -> decltype(auto) { return (s.tissue.body_shape_sums[c]); });
    using D = DirectSolve;
    for (size_t i = 0; i < directs; ++i) {
        level([&](AdvanceScratch& s) -> DirectSolve& { return s.components.direct[i]; }, &D::body, &D::ordered, &D::first, &D::begin,
              &D::matrix, &D::solution, &D::impulse, &D::before, &D::impulse_before);
    }
}

namespace {

// One substep: forces and steps of deformable bodies, hands and free bodies, then contact constraints and position corrections.
void run_substep(const AdvanceCall& call, bool has_contacts, AdvanceScratch& s, const AdvanceState& state, AdvanceResult& result) {
    const AdvanceParams& params = call.params;
    AdvanceIsland& island = s.island;
    place_rigid_bodies(call, island);
    find_link_forces(call, state.particles, island);
    step_threads(call, state.particles, island, result);
    step_bodies(call, s.tissue, island, state, result);
    for (AdvanceBody& b : island.body) result.work_numeric += std::exchange(b.changed_step, 0.0);
    begin_touched_steps(call, s.tissue, island, state, result);
    pull_hands(call, island);
    kick_free_bodies(call, island, result);
    pull_linked_rigids(call, island, state.tools);
    pull_threaded_rigids(call, island, state.tools, result);
    pull_grasped_bodies(call, island, state.tools, result);
    if (has_contacts && params.observer.begin) params.observer.begin(params.observer.user);
    if (has_contacts) apply_impulses(call, s.components, s.tissue, s.solver, island, state, result);
    account_grasps(call, island, result);
    finish_drives(call, island, result);
    move_hands(call, island, state.tools);
    move_free_bodies(call, island, state.tools);
    carry_jaws(call, call.substep + 1, island);
    if (has_contacts) correct_positions(call, s.solver, island, state, result), carry_jaws(call, call.substep + 1, island);
    if (has_contacts && params.account_energy) account_implicit_corrections(call, s.tissue, island, state, result);
    if (has_contacts && params.observer.end) params.observer.end(params.observer.user);
    finish_links(call, state.particles, island, result);
    finish_threads(call, state.particles, island, result);
    break_springs(call, state.particles, s.tissue, island, result);
    for (AdvanceBody& b : island.body) b.now = b.next;
}

}  // namespace

void advance_island(const AdvanceParams& params, const AdvanceInputs& inputs, std::span<const uint32_t> island_bodies,
                    std::span<const uint32_t> island_constraints, AdvanceScratch& scratch, AdvanceState state, AdvanceResult& result) {
    TROCAR_ASSERT(params.substeps > 0 && params.ticks > 0);
    const AdvanceWork before = result;
    const uint64_t failed = result.nonfinite_particles + result.runaway_bodies;
    result.deepest_residual = 0;
    result.opposing_planes = 0;
    AdvanceCall call{params, inputs, 1e-3 * (static_cast<double>(params.ticks) / params.substeps)};
    const bool has_contacts = !island_constraints.empty();
    gather_bodies(call, island_bodies, scratch.tissue, scratch.island, state, result);
    if (has_contacts && params.observer.begin) params.observer.begin(params.observer.user);
    prepare_contacts(call, island_constraints, scratch.sorting, scratch.solver, scratch.island, state);
    note_velocities(state.particles, scratch.island.nodes);
    if (has_contacts && params.observer.end) params.observer.end(params.observer.user);
    clear_sums(scratch.island, scratch.tissue);
    const uint32_t per_ms = params.substeps / params.ticks;
    TROCAR_ASSERT(!params.tick_hook.run || per_ms * params.ticks == params.substeps);
    for (uint32_t substep = 0; substep < params.substeps; ++substep) {
        if (params.tick_hook.run && substep % per_ms == 0) params.tick_hook.run(params.tick_hook.user, substep / per_ms);
        call.substep = substep;
        run_substep(call, has_contacts, scratch, state, result);
    }
    if (call.dt < kShortStep) result.short_steps += params.substeps;
    for (const double work : scratch.tissue.sums) result.work_damping += work;
    finish_bodies(call, scratch.tissue, scratch.island, state, result);
    // what moved a body that is back where it started was no work, and is no number or absurd
    if (result.nonfinite_particles + result.runaway_bodies > failed) static_cast<AdvanceWork&>(result) = before;
    release_contacts(call, scratch.solver, scratch.island, state.constraints, result);
}

}  // namespace trocar
