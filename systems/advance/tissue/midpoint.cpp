#include "systems/advance/tissue/midpoint.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/geometry/best_fit_rotation.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/kernels/implicit_kernels.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/advance/tissue/energy.hpp"
#include "systems/advance/tissue/fine_steps.hpp"
#include "systems/advance/tissue/forces.hpp"
#include "systems/advance/tissue/implicit_contact.hpp"
namespace trocar {
namespace {

// The rigid motion that best fits the conjugate gradients' direction, weighted by the anchors: the motion of
// a free body's goals if its particles move along that direction. Without it the anchors would hold the body
// in place.
struct GoalMotion {
    double stiffness = 0;
    Vec3d centre = Vec3d::Zero();     // m
    std::array<double, 6> inertia{};  // about the centre: xx yy zz xy xz yz

    GoalMotion(const ImplicitScratch& s, const SpringStep& step) {
        for (uint32_t i = 0; i < s.position.size(); ++i) {
            const double k = step.anchor_stiffness[i];
            stiffness += k;
            centre += k * Vec3d(s.position[i].x, s.position[i].y, s.position[i].z);
        }
        if (stiffness <= 0) return;
        centre /= stiffness;
        for (uint32_t i = 0; i < s.position.size(); ++i) {
            const double k = step.anchor_stiffness[i];
            const Vec3d r = Vec3d(s.position[i].x, s.position[i].y, s.position[i].z) - centre;
            inertia[0] += k * (r.y() * r.y() + r.z() * r.z());
            inertia[1] += k * (r.x() * r.x() + r.z() * r.z());
            inertia[2] += k * (r.x() * r.x() + r.y() * r.y());
            inertia[3] -= k * r.x() * r.y();
            inertia[4] -= k * r.x() * r.z();
            inertia[5] -= k * r.y() * r.z();
        }
    }
    void follow(const ImplicitScratch& s, const SpringStep& step, ImplicitStep& implicit) const {
        if (stiffness <= 0) return;
        Vec3d velocity = Vec3d::Zero(), moment = Vec3d::Zero(), rotation = Vec3d::Zero();
        for (uint32_t i = 0; i < s.position.size(); ++i) {
            const Vec3d p = step.anchor_stiffness[i] * Vec3d(s.direction[i].x, s.direction[i].y, s.direction[i].z);
            velocity += p;
            moment += (Vec3d(s.position[i].x, s.position[i].y, s.position[i].z) - centre).cross(p);
        }
        velocity /= stiffness;
        if (!solve_symmetric(inertia, moment, rotation)) rotation.setZero();
        const Vec3d at_origin = velocity - rotation.cross(centre);
        for (int i = 0; i < 3; ++i) {
            implicit.rigid_velocity[i] = static_cast<float>(at_origin[i]);
            implicit.rigid_turn[i] = static_cast<float>(rotation[i]);
        }
    }
};

ImplicitStep bind_implicit(ImplicitScratch& s, const AdvanceBody& b) {
    const size_t padded_count = b.particles.count, columns = b.step.slice_column[b.slices] - b.step.slice_column[0];
    s.position.resize(padded_count);
    s.direction.resize(padded_count);
    // columns are counted over all prototypes
    s.spring_direction.resize(64 * columns);
    s.block.resize(6 * padded_count);
    for (auto* field : {&s.residual, &s.applied, &s.change}) field->resize(3 * padded_count);
    s.sums.resize(size_t{chunk_count(b.slices, kSlicesPerChunk)} * kSliceWidth);
    ImplicitStep step = {};
    step.spring = &b.step;
    step.position = &s.position[0].x;
    step.direction = &s.direction[0].x;
    step.spring_direction = s.spring_direction.data() - 64 * static_cast<size_t>(b.step.slice_column[0]);
    step.block = s.block.data();
    step.residual = s.residual.data();
    step.applied = s.applied.data();
    step.change = s.change.data();
    step.padded_count = static_cast<uint32_t>(padded_count);
    return step;
}

// The body that is stepped: springs and tetrahedra.
struct MidpointStep {
    AdvanceBody& b;
    ImplicitStep step = {};
    TetStep tets = {};
    ImplicitTets volumes = {};
    uint32_t groups = 0;  // of 16 tetrahedra; 0 = has none
    bool held = false;    // constraints may act within the step
};
// Groups per kernel call.
constexpr uint32_t kGroupsPerChunk = 256;

// Adds the tetrahedra's corner values to three fields of the nodes, which start at 0.
void gather_corners(const AdvanceBody& b, TetStep& tets, float* field, size_t padded_count) {
    std::fill_n(field, 3 * padded_count, 0.0f);
    tets.force_x = field, tets.force_y = field + padded_count, tets.force_z = field + 2 * padded_count;
    parallel_for(b.slices, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { tet_kernels().gather(&tets, begin, end); });
}

// Volume forces and stiffness at the step's positions; records the least volume.
void bind_volumes(const AdvanceCall& call, const Particles& particles, TissueScratch& scratch, MidpointStep& m, AdvanceResult& result) {
    const AdvanceBody& b = m.b;
    ImplicitStep& step = m.step;
    const AdvanceInputs& in = call.inputs;
    if (!has_tets(in.other.solids, in.bodies, b.body)) return;
    ImplicitScratch& s = scratch.implicit;
    const size_t padded_count = b.particles.count;
    m.tets = bind_tets(*in.other.solids, in.bodies, particles, b.body, in.other.torn_springs);
    m.tets.offset = step.position;
    m.tets.corner_force = &scratch.corner_force[0].x;
    m.groups = m.tets.tetrahedra / kSliceWidth;
    s.slope.resize(size_t{12} * m.tets.tetrahedra);
    s.volume_force.assign(3 * padded_count, 0.0f);
    s.volume_block.resize(6 * padded_count);
    m.volumes = {&m.tets, step.direction, s.slope.data()};
    m.tets.force_x = s.volume_force.data(), m.tets.force_y = m.tets.force_x + padded_count, m.tets.force_z = m.tets.force_y + padded_count;
    result.min_volume_ratio = std::min<double>(result.min_volume_ratio, add_tet_forces(m.tets, b.slices));
    const ImplicitKernels& kernels = implicit_kernels();
    parallel_for(m.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_slopes(&m.volumes, begin, end); });
    gather_corners(b, m.tets, s.volume_block.data(), padded_count);
    parallel_for(m.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_blocks(&m.volumes, begin, end); });
    gather_corners(b, m.tets, s.volume_block.data() + 3 * padded_count, padded_count);
    step.volume_force = step.volume_pull = s.volume_force.data();
    step.volume_block = s.volume_block.data();
}

// For a body that was stepped by leapfrog: a kick of half its last step brings its velocities to the time of
// its positions.
void catch_up(const AdvanceCall& call, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b) {
    const AdvanceInputs& in = call.inputs;
    SpringStep step = b.step;
    step.dt = 0;
    step.remainder_x = nullptr;
    const double kick = 0.5 * b.last_dt, left = b.shape ? 1.0 : std::exp(-0.5 * b.damping * kick);
    step.kick_dt = static_cast<float>(kick * left);
    step.kick_less = static_cast<float>(kick * (left - 1));
    step.keep = static_cast<float>(std::exp(-b.damping * kick));
    if (b.shape) {
        const ShapeTotals totals = sum_shape(step, b.slices, scratch.shape_sums);
        fit_goals(totals, state.poses.orientation[b.body], step);
        fit_drag(totals, step);
    }
    if (has_tets(in.other.solids, in.bodies, b.body)) {
        const size_t padded_count = b.particles.count;
        std::vector<float>& force = scratch.implicit.volume_force;
        force.assign(3 * padded_count, 0.0f);
        const float* const others[3] = {step.force_x, step.force_y, step.force_z};
        for (size_t i = 0; i < 3 && step.force_x; ++i) std::copy_n(others[i], padded_count, force.data() + i * padded_count);
        TetStep tets = bind_tets(*in.other.solids, in.bodies, state.particles, b.body, in.other.torn_springs);
        tets.offset = step.offset;
        tets.corner_force = &scratch.corner_force[0].x;
        tets.force_x = force.data(), tets.force_y = tets.force_x + padded_count, tets.force_z = tets.force_y + padded_count;
        add_tet_forces(tets, b.slices);
        step.force_x = tets.force_x, step.force_y = tets.force_y, step.force_z = tets.force_z;
    }
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
        spring_kernels().step(&step, begin, end, b.damping_work ? b.damping_work + begin / kSlicesPerChunk * kSliceWidth : nullptr);
    });
    b.last_dt = 0;
}

// Stiffness of the tetrahedra times the direction.
void pull_volumes(TissueScratch& scratch, MidpointStep& m) {
    if (m.groups == 0) return;
    const ImplicitKernels& kernels = implicit_kernels();
    parallel_for(m.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_pull(&m.volumes, begin, end); });
    gather_corners(m.b, m.tets, scratch.implicit.volume_force.data(), m.b.particles.count);
}

// Conjugate gradients on the velocities, after begin. Counts iterations and records the residual. start:
// residual . (block * residual).
void solve(const AdvanceIsland& island, double start, TissueScratch& scratch, ContactSolver& solver, MidpointStep& m,
           AdvanceResult& result) {
    const AdvanceBody& b = m.b;
    ImplicitStep& step = m.step;
    const ImplicitKernels& kernels = implicit_kernels();
    ImplicitScratch& s = scratch.implicit;
    const GoalMotion goals = b.shape ? GoalMotion(s, b.step) : GoalMotion({}, b.step);
    double rest = start;
    uint32_t iteration = 0;
    const double enough = b.stepping.tolerance * b.stepping.tolerance * start;
    for (; iteration < b.stepping.iterations && rest > enough; ++iteration) {
        goals.follow(s, b.step, step);
        pull_volumes(scratch, m);
        double bent = sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.apply(&step, begin, end, lanes); });
        if (m.held) bent += apply_implicit_contacts(island, b, scratch, solver);
        if (!(bent > 0)) break;
        const float a = static_cast<float>(rest / bent);
        const double next =
            sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.move(&step, a, begin, end, lanes); });
        const float turn = static_cast<float>(next / rest);
        rest = next;
        for_slices(b.slices, [&](uint32_t begin, uint32_t end) { kernels.turn(&step, turn, begin, end); });
    }
    result.implicit_iterations += iteration;
    if (start > 0) result.worst_implicit_residual = std::max(result.worst_implicit_residual, std::sqrt(rest / start));
}

// Pressure and bending at the particles' expected midpoints. Evaluated at the start they would act as
// explicit Euler, which amplifies; evaluated there they are as stable as in leapfrog, independent of the
// springs: with x' = v, v' = -w^2 x the step's matrix has determinant 1 and trace 2 - (w h)^2.
void find_midpoint_forces(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, TissueScratch& scratch,
                          AdvanceBody& b, AdvanceResult& result) {
    const Bodies& bodies = call.inputs.bodies;
    if (!has_pressure(bodies, b.body) && !has_bending(bodies, b.body)) return;
    const auto start = std::exchange(b.now, scratch.implicit.position.data());
    find_forces(call, island, particles, scratch, b, result);
    b.now = start;
}

}  // namespace

void step_midpoint(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, ContactSolver& solver,
                   const AdvanceState& state, AdvanceBody& b, AdvanceResult& result) {
    const ImplicitKernels& kernels = implicit_kernels();
    ImplicitScratch& s = scratch.implicit;
    MidpointStep m{b, bind_implicit(s, b)};
    ImplicitStep& step = m.step;
    const bool accounting = call.params.account_energy;
    if (b.last_dt > 0) catch_up(call, scratch, state, b);
    const double before = accounting ? energy_before(call, b, scratch, state) : 0;
    // impulses on single particles make the midpoint rule oscillate for ever at steps beyond the explicit
    // limit; backward Euler damps that
    if (!b.touched && needs_subcycling(call, state.particles, b, least_volume(call, state.particles, b, 0, scratch), scratch)) {
        const double damped = step_finely(call, island, scratch, state, b, result);
        if (!accounting) return;
        if (b.damping_work) b.damping_work[0] += damped;
        result.work_numeric += own_work(call, before, damped + work_of_others(b.step, b.particles.count), scratch, state, b);
        return;
    }
    step.theta = b.touched ? 1.0f : 0.5f;
    b.step.kick_dt = b.step.dt;
    // a held body is damped half before and half after, which is second order; a free body's rigid motion,
    // which is not damped, is known only at the start
    const double share = b.shape ? 1 : 0.5;
    step.keep_before = static_cast<float>(std::exp(-b.damping * share * call.dt));
    step.keep_after = static_cast<float>(std::exp(-b.damping * (1 - share) * call.dt));
    b.step.keep = static_cast<float>(std::exp(-b.damping * call.dt));
    if (b.shape) {
        b.step.back = 0;
        fit_drag(sum_shape(b.step, b.slices, scratch.shape_sums), b.step);
    }
    double damped = sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.predict(&step, begin, end, lanes); });
    if (b.shape) {
        SpringStep at_midpoint = b.step;
        at_midpoint.offset = step.position;
        fit_goals(sum_shape(at_midpoint, b.slices, scratch.shape_sums), state.poses.orientation[b.body], b.step);
    }
    if (!b.touched)
        find_midpoint_forces(call, island, state.particles, scratch, b,
                             result);  // with backward Euler, forces evaluated at the start allow longer steps
    bind_volumes(call, state.particles, scratch, m, result);
    const double start = sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.begin(&step, begin, end, lanes); });
    ++result.implicit_steps;
    m.held = bind_implicit_contacts(call, island, b, scratch, solver);
    if (!m.held) solve(island, start, scratch, solver, m, result);
    for (uint32_t attempt = 0; m.held && attempt < kMostSolves; ++attempt) {
        solve(island, start_implicit_contacts(island, b, scratch, solver, step), scratch, solver, m, result);
        if (!update_implicit_contacts(call, scratch, island, b, attempt + 3 < kMostSolves, solver)) break;
    }
    const double pressed = m.held ? finish_implicit_contacts(island, b, solver) : 0;
    damped += sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.finish(&step, begin, end, lanes); });
    if (!accounting) return;
    if (b.damping_work) b.damping_work[0] += damped;
    if (std::isfinite(pressed)) result.work_contact += pressed;  // otherwise a body about to be restored
    result.work_numeric += own_work(call, before, damped + pressed + work_of_others(b.step, b.particles.count), scratch, state, b);
}

}  // namespace trocar
