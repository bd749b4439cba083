#include "systems/advance.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/check.hpp"
#include "engine/deformable_setup.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/parallel.hpp"
#include "engine/shape_fit.hpp"
#include "engine/skin.hpp"
#include "engine/spring_step.hpp"
#include "engine/surfaces.hpp"
#include "systems/advance_implicit.hpp"
namespace trocar {
namespace {

// Farther than this from its origin (m) a particle counts as lost, like one that is not finite.
constexpr float kLost = 1e6f;
constexpr uint32_t kBodiesAtOnce = 32;

AdvanceBody make_body(const AdvanceIsland& island, uint32_t body, uint32_t buffer) {
    const Bodies& bodies = island.inputs.bodies;
    const Springs& springs = island.inputs.springs;
    AdvanceBody b;
    b.body = body;
    b.particles = bodies.particles[body];
    if (const uint32_t skin = springs.info[bodies.mesh[body]].skin; skin > 0) {
        const Solids& solids = *island.inputs.other.solids;
        const uint32_t first = solids.info[bodies.mesh[body]].skin.first;
        b.skin_node = solids.skin_node.data() + first;
        b.skin_weight = solids.skin_weight.data() + first;
        b.particles = {b.particles.first + skin, b.particles.count - skin};
    }
    b.slices = springs.info[bodies.mesh[body]].slices.count;
    b.buffer = buffer;
    b.shape = bodies.anchor_frame[body] == AnchorFrame::kShape;
    b.damping = bodies.tissue[body].damping;
    b.last_dt = island.particles.last_dt[body];
    b.stepping = stepping_of(bodies, body);
    // an impulse acts in the kick, as every force: what damps a held body after it damps the impulse, or else a load at rest
    // would be borne by damping in part
    if (!b.shape && !b.measured()) b.impulse_left = std::exp(-0.5 * b.damping * island.dt);
    b.origin = to_vec4(island.poses.origin[body]);
    b.orientation = island.poses.orientation[body];
    b.now = island.particles.offset.data() + b.particles.first;
    b.step = bind_body(springs, bodies, island.inputs.anchors, island.particles, body, island.inputs.other.torn_springs);
    b.tear = tear_of(island.inputs.other.tears, body);
    SpringStep& step = b.step;
    step.new_velocity_x = island.particles.velocity_x.data() + b.particles.first;
    step.new_velocity_y = island.particles.velocity_y.data() + b.particles.first;
    step.new_velocity_z = island.particles.velocity_z.data() + b.particles.first;
    step.dt = static_cast<float>(island.dt);
    for (int i = 0; i < 3; ++i) step.gravity[i] = static_cast<float>(island.params.gravity[i]);
    return b;
}

// Whether rounding takes more than half a percent of 1 mm/s from places stepped by dt: then a body carries what it left
// out from substep to substep. At the end of a call the remainder, less than half an ulp, goes: round_remainders.
bool carry_remainder(const AdvanceIsland& island, uint32_t body) {
    if (island.params.substeps == 1 || stepping_of(island.inputs.bodies, body).integrator != Integrator::kLeapfrog) return false;
    const float radius = static_cast<float>(island.inputs.meshes.info[island.inputs.bodies.mesh[body]].radius);
    const double ulp = std::nextafter(radius, std::numeric_limits<float>::infinity()) - radius;
    return ulp > 0.01 * 1e-3 * island.dt;
}

void give_remainders(AdvanceIsland& island, uint32_t particles) {
    AdvanceScratch& s = island.scratch;
    const auto carries = [&](const AdvanceBody& b) { return carry_remainder(island, b.body); };
    if (std::none_of(s.body.begin(), s.body.end(), carries)) return;
    s.remainder.assign(size_t{3} * particles, 0.0f);
    for (AdvanceBody& b : s.body) {
        if (!carries(b)) continue;
        b.step.remainder_x = s.remainder.data() + b.buffer;
        b.step.remainder_y = b.step.remainder_x + particles;
        b.step.remainder_z = b.step.remainder_y + particles;
    }
}

void gather_bodies(AdvanceIsland& island, std::span<const uint32_t> island_bodies) {
    AdvanceScratch& s = island.scratch;
    s.body.clear();
    s.rigid.clear();
    s.node.resize(0);
    s.change.resize(0);
    s.free.clear();
    s.turning.clear();
    s.slot_of_body.resize(island.inputs.bodies.mesh.size(), kNone);
    uint32_t particles = 0;
    for (const uint32_t body : island_bodies) {
        if (is_deformable(island.inputs.bodies, body)) {
            s.slot_of_body[body] = static_cast<uint32_t>(s.body.size());
            s.body.push_back(make_body(island, body, particles));
            particles += s.body.back().particles.count;
        } else if (joins_islands(island.inputs.bodies.motion[body])) {
            rigid_slot(island, body);
        }
    }
    parallel_for(static_cast<uint32_t>(s.body.size()), kBodiesAtOnce, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) s.body[i].kinetic = kinetic_energy(island, s.body[i]);
    });
    have_rows(s.offset_a, particles);
    have_rows(s.offset_b, particles);
    give_remainders(island, particles);
    gather_links(island);
    give_forces(island, particles);
}

// Lanes of damping work, kept per chunk over the whole call.
void clear_sums(AdvanceScratch& s) {
    size_t chunks = 0;
    for (const AdvanceBody& b : s.body) chunks += chunk_count(b.slices, kSlicesPerChunk);
    s.sums.assign(chunks * kSliceWidth, 0.0);
}

// One kick and drift.
void step_leapfrog(AdvanceIsland& island, const SpringKernels& kernels, AdvanceBody& b, double* work, std::vector<double>& shape_sums) {
    // the very first kick is half a one: velocities fall half a step behind
    const double kick = 0.5 * (b.last_dt + island.dt);
    b.last_dt = island.dt;
    // damping acts half before and half after the kick: second order (Strang). A free body's goes with its rigid motion,
    // which no damping may slow: there it acts before, of first order
    const double left = b.shape ? 1.0 : std::exp(-0.5 * b.damping * kick);
    b.step.kick_dt = static_cast<float>(kick * left);
    b.step.kick_less = static_cast<float>(kick * (left - 1));
    b.step.keep = static_cast<float>(std::exp(-b.damping * kick));
    if (b.shape) {
        const ShapeTotals totals = sum_shape(b.step, b.slices, shape_sums);
        fit_goals(totals, island.poses.orientation[b.body], b.step);
        fit_drag(totals, b.step);
    }
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
        kernels.step(&b.step, begin, end, work ? work + begin / kSlicesPerChunk * kSliceWidth : nullptr);
    });
}

// Forces besides springs and anchors at the start of a substep. Whether a body stepped by leapfrog must go through it finely.
bool find_forces_of(AdvanceIsland& island, AdvanceBody& b) {
    if (!b.step.force_x) return false;
    const double so_far = std::exchange(island.result.min_volume_ratio, std::numeric_limits<double>::infinity());
    find_forces(island, b);
    const double least = std::exchange(island.result.min_volume_ratio, std::min(so_far, island.result.min_volume_ratio));
    return b.stepping.integrator == Integrator::kLeapfrog && !b.touched && is_wild(island, b, least);
}

void step_wild(AdvanceIsland& island, AdvanceBody& b, double* work) {
    const double damped = step_finely(island, b);
    if (work) work[0] += damped;
}

// Bodies whose steps need nothing but springs and anchors: many of them are stepped at the same time.
bool steps_alone(const AdvanceBody& b) { return b.stepping.integrator == Integrator::kLeapfrog && !b.step.force_x; }

void step_bodies(AdvanceIsland& island, const SpringKernels& kernels, uint32_t substep) {
    constexpr uint32_t kBodiesPerChunk = 16;
    AdvanceScratch& s = island.scratch;
    const uint32_t bodies = static_cast<uint32_t>(s.body.size());
    uint32_t chunk = 0;
    for (AdvanceBody& b : s.body) {
        b.first_chunk = chunk;
        chunk += chunk_count(b.slices, kSlicesPerChunk);
    }
    if (s.body_shape_sums.size() < chunk_count(bodies, kBodiesPerChunk)) s.body_shape_sums.resize(chunk_count(bodies, kBodiesPerChunk));
    const auto step = [&](AdvanceBody& b, std::vector<double>& shape_sums) {
        b.next = (substep % 2 == 0 ? s.offset_a : s.offset_b).data() + b.buffer;
        b.step.offset = &b.now->x;
        b.step.new_offset = &b.next->x;
        double* work = island.params.account_energy && b.damping > 0 ? s.sums.data() + b.first_chunk * kSliceWidth : nullptr;
        const bool wild = find_forces_of(island, b);
        switch (b.stepping.integrator) {
            case Integrator::kLeapfrog:
                wild ? step_wild(island, b, work) : step_leapfrog(island, kernels, b, work, shape_sums);
                break;
            case Integrator::kMidpoint:
                step_midpoint(island, b, work);
                break;
        }
        const float* drag = b.step.drag_velocity;
        const float* turn = b.step.drag_turn;
        b.drag_velocity = make_vec4(drag[0], drag[1], drag[2]);
        b.drag_turn = make_vec4(turn[0], turn[1], turn[2]);
    };
    if (!std::all_of(s.body.begin(), s.body.end(), steps_alone)) {
        for (AdvanceBody& b : s.body) step(b, s.shape_sums);
        return;
    }
    parallel_for(bodies, kBodiesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) step(s.body[i], s.body_shape_sums[begin / kBodiesPerChunk]);
    });
}

bool is_lost(const Float4& o) { return !(std::abs(o.x) < kLost && std::abs(o.y) < kLost && std::abs(o.z) < kLost); }

uint32_t count_lost(const Float4* offsets, uint32_t count) {
    uint32_t lost = 0;
    for (uint32_t p = 0; p < count; ++p) lost += is_lost(offsets[p]);
    return lost;
}

// Puts a body back to the start of the call, at rest. Particles that were already lost there go to their goals.
void restore_body(AdvanceIsland& island, const AdvanceBody& b) {
    Particles& particles = island.particles;
    const Range rows = b.particles;
    for (auto* field : {&particles.velocity_x, &particles.velocity_y, &particles.velocity_z}) {
        std::fill_n(field->begin() + rows.first, rows.count, 0.0f);
    }
    particles.last_dt[b.body] = 0;
    island.poses.orientation[b.body] = b.orientation;
    Vec3d centre = Vec3d::Zero();
    double weight = 0;
    const Quat turn = b.shape ? b.orientation : Quat{};
    const auto goal = [&](uint32_t p) {
        const Anchors& a = island.inputs.anchors;
        return rotate(turn, Vec3d(a.rest_x[p], a.rest_y[p], a.rest_z[p]));
    };
    if (b.shape) {
        for (uint32_t p = rows.first; p < rows.end(); ++p) {
            const Float4& o = particles.offset[p];
            if (is_lost(o)) continue;
            const double k = island.inputs.anchors.stiffness[p];
            centre += k * (Vec3d(o.x, o.y, o.z) - goal(p));
            weight += k;
        }
        if (weight > 0) centre /= weight;
    }
    for (uint32_t p = rows.first; p < rows.end(); ++p) {
        Float4& o = particles.offset[p];
        if (!is_lost(o)) continue;
        const Vec3d g = centre + goal(p);
        o = {static_cast<float>(g.x()), static_cast<float>(g.y()), static_cast<float>(g.z()), o.w};
    }
}

// What the places of a body leave out goes at the end of a call: rounded up or down as a hash of call and particle falls,
// in proportion, so that what hundreds of calls leave out adds up to nothing.
void round_remainders(AdvanceIsland& island, const AdvanceBody& b) {
    const float* remainder[3] = {b.step.remainder_x, b.step.remainder_y, b.step.remainder_z};
    uint64_t call = (island.params.tick + 1) * 0xbf58476d1ce4e5b9ull;
    call ^= call >> 29;
    const auto round = [&](uint32_t v) {
        Float4& o = island.particles.offset[b.particles.first + v];
        if (!(o.w > 0)) return;
        const uint64_t z = (call + v) * 0x9e3779b97f4a7c15ull;  // a Weyl sequence: evenly spread over the particles
        float* const place[3] = {&o.x, &o.y, &o.z};
        for (int i = 0; i < 3; ++i) {
            const float r = remainder[i][v], from = *place[i];
            // the next float that way; without branches: they would fall as dice do
            const int32_t away = (from != 0) * (2 * ((r > 0) == (from > 0)) - 1);
            const float next = std::bit_cast<float>(std::bit_cast<int32_t>(from) + away);
            const float dice = static_cast<float>(static_cast<int32_t>(z >> (4 + 20 * i) & 0xfffff)) * 0x1p-20f;
            *place[i] = std::abs(r) > dice * std::abs(next - from) ? next : from;
        }
    };
    parallel_for_even(b.particles.count, kSlicesPerChunk * kSliceWidth, kLeastShared, [&](uint32_t begin, uint32_t end) {
        for (uint32_t v = begin; v < end; ++v) round(v);
    });
}

// Writes the particles of a body back, or restores those that it had.
void finish_body(AdvanceIsland& island, const AdvanceBody& b) {
    const auto count = [](uint64_t& counter, uint64_t more) { std::atomic_ref(counter).fetch_add(more, std::memory_order_relaxed); };
    const uint32_t lost = count_lost(b.now, b.particles.count);
    const bool ran_away = lost == 0 && has_run_away(island, b);
    if (lost > 0) count(island.result.nonfinite_particles, lost);
    if (ran_away) count(island.result.runaway_bodies, 1);
    if (lost > 0 || ran_away) return restore_body(island, b);
    std::copy_n(b.now, b.particles.count, island.particles.offset.begin() + b.particles.first);
    if (b.step.remainder_x) round_remainders(island, b);
    island.particles.last_dt[b.body] = b.last_dt;
}

void finish_bodies(AdvanceIsland& island) {
    const std::vector<AdvanceBody>& bodies = island.scratch.body;
    parallel_for(static_cast<uint32_t>(bodies.size()), kBodiesAtOnce, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) finish_body(island, bodies[i]);
    });
    for (const AdvanceBody& b : island.scratch.body) {
        if (b.skin_node) drape_skin(*island.inputs.other.solids, island.inputs.bodies, b.body, island.particles);
    }
    for (const AdvanceRigid& rigid : island.scratch.rigid) {
        if (rigid.node == kNone || (rigid.free != kNone && rigid.jaw == kNone)) continue;
        const ContactNode node = island.scratch.node[rigid.node];
        island.poses.origin[rigid.body] = to_vec3(rigid.jaw == kNone ? node.place : rigid.place[1].shift);
        Vec4d velocity = node.velocity;
        if (rigid.free != kNone) velocity += cross(island.scratch.free[rigid.free].spin, rigid.place[1].shift - node.place);
        island.poses.velocity[rigid.body] = to_vec3(velocity);
        island.poses.orientation[rigid.body] = rigid.orientation[1];
        island.poses.angular_velocity[rigid.body] = rotation_vector(rigid.orientation[0], rigid.orientation[1]) / island.dt;
    }
    finish_free_bodies(island);
}

}  // namespace

uint32_t count_substeps(const Bodies& bodies, std::span<const uint32_t> island_bodies, double seconds, double largest,
                        std::span<const double> linked) {
    double stable = std::numeric_limits<double>::infinity();
    for (const uint32_t body : island_bodies) {
        if (body < linked.size()) stable = std::min(stable, linked[body]);
        const Stepping stepping = stepping_of(bodies, body);
        const bool leapfrog = stepping.integrator == Integrator::kLeapfrog;
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

// Gives the vectors that field(scratch) names of all scratches the largest of their capacities.
template <typename Field>
void share_capacity(std::span<AdvanceScratch> scratches, const Field& field) {
    size_t most = 0;
    for (AdvanceScratch& s : scratches) most = std::max(most, field(s).capacity());
    for (AdvanceScratch& s : scratches) field(s).reserve(most);
}

}  // namespace

void share_room(std::span<AdvanceScratch> scratches) {
    using S = AdvanceScratch;
    const auto level = [&](auto... field) { (share_capacity(scratches, [&](S& s) -> decltype(auto) { return (s.*field); }), ...); };
    level(&S::offset_a, &S::offset_b, &S::remainder, &S::force, &S::force_sums, &S::corner_force, &S::hinge_force);
    level(&S::body, &S::rigid, &S::free, &S::sums, &S::shape_sums, &S::touched, &S::overstretched);
    level(&S::node, &S::change, &S::moved_in, &S::node_of_particle, &S::slot_of_body, &S::node_sums);
    level(&S::link, &S::link_end, &S::link_group);
    level(&S::plan, &S::sketch, &S::may_oppose, &S::skin_point, &S::turning, &S::held, &S::held_active, &S::warm);
    level(&S::block, &S::fixed, &S::open_blocks_of_node);
    level(&S::settling, &S::component, &S::component_of);
    level(&S::strip, &S::along, &S::group_of_row, &S::next_of_group, &S::dealt, &S::ungrouped);

    size_t groups = 0, chunks = 0, directs = 0;
    for (const S& s : scratches) {
        groups = std::max(groups, s.group.size());
        chunks = std::max(chunks, s.body_shape_sums.size());
        directs = std::max(directs, s.direct.size());
    }
    for (S& s : scratches) s.group.resize(groups), s.body_shape_sums.resize(chunks), s.direct.resize(directs);
    for (size_t g = 0; g < groups; ++g) {
        share_capacity(scratches, [&](S& s) -> decltype(auto) { return (s.group[g].active); });
        share_capacity(scratches, [&](S& s) -> decltype(auto) { return (s.group[g].active_block); });
    }
    for (size_t c = 0; c < chunks; ++c) share_capacity(scratches, [&](S& s) -> decltype(auto) { return (s.body_shape_sums[c]); });

    using D = DirectSolve;
    for (size_t i = 0; i < directs; ++i) {
        const auto level_direct = [&](auto... field) {
            (share_capacity(scratches, [&](S& s) -> decltype(auto) { return (s.direct[i].*field); }), ...);
        };
        level_direct(&D::body, &D::ordered, &D::first, &D::begin, &D::matrix, &D::solution, &D::impulse, &D::before, &D::impulse_before);
    }

    using I = ImplicitScratch;
    const auto level_implicit = [&](auto... field) {
        (share_capacity(scratches, [&](S& s) -> decltype(auto) { return (s.implicit.*field); }), ...);
    };
    level_implicit(&I::place, &I::direction, &I::sums, &I::spoke, &I::block, &I::residual, &I::applied, &I::change);
    level_implicit(&I::free_residual, &I::free_block, &I::slope, &I::volume_force, &I::volume_block);
    share_capacity(scratches, [](S& s) -> decltype(auto) { return (s.implicit.tet_energy.place); });
    share_capacity(scratches, [](S& s) -> decltype(auto) { return (s.implicit.tet_energy.sums); });
}

void advance_island(const AdvanceParams& params, const AdvanceInputs& inputs, std::span<const uint32_t> island_bodies,
                    std::span<const uint32_t> island_rows, AdvanceScratch& scratch, AdvanceState state, AdvanceResult& result) {
    TROCAR_ASSERT(params.substeps > 0 && params.ticks > 0);
    const double dt = 1e-3 * (static_cast<double>(params.ticks) / params.substeps);
    result.deepest_residual = 0;
    result.opposing_planes = 0;
    AdvanceIsland island{params, inputs, scratch, state.particles, state.poses, state.rows, state.tools, result, dt};
    const SpringKernels& kernels = spring_kernels();
    gather_bodies(island, island_bodies);
    const auto observe = [&](void (*call)(void*)) {
        if (call && !island_rows.empty()) call(params.observer.user);
    };
    observe(params.observer.begin);
    plan_contacts(island, island_rows);
    note_velocities(island);
    observe(params.observer.end);
    clear_sums(scratch);
    const uint32_t per_ms = params.substeps / params.ticks;
    TROCAR_ASSERT(!params.tick_hook.run || per_ms * params.ticks == params.substeps);
    for (uint32_t substep = 0; substep < params.substeps; ++substep) {
        if (params.tick_hook.run && substep % per_ms == 0) params.tick_hook.run(params.tick_hook.user, substep / per_ms);
        place_rigid_bodies(island, substep);
        island.substep = substep;
        find_link_forces(island);
        find_held_rows(island);
        step_bodies(island, kernels, substep);
        pull_hands(island, substep);
        kick_free_bodies(island);
        pull_linked_rigids(island);
        observe(params.observer.begin);
        const bool books = params.account_energy && has_rows(scratch);
        if (has_rows(scratch)) apply_impulses(island);
        settle_drives(island);
        if (books) book_measured(island, false, result.work_contact);
        move_hands(island);
        move_free_bodies(island);
        carry_jaws(island, substep + 1);
        if (has_rows(scratch)) push_out(island, substep), carry_jaws(island, substep + 1);
        if (books) book_measured(island, true, result.work_push);
        observe(params.observer.end);
        finish_links(island);
        break_springs(island);
        for (AdvanceBody& b : scratch.body) b.now = b.next;
    }
    for (const double work : scratch.sums) result.work_damping += work;
    finish_bodies(island);
    forget_contacts(island);
}

}  // namespace trocar
