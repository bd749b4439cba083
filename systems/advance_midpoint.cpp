#include "systems/advance_midpoint.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/bending_forces.hpp"
#include "engine/best_fit_rotation.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/implicit_kernels.hpp"
#include "engine/parallel.hpp"
#include "engine/pressure_force.hpp"
#include "engine/shape_fit.hpp"
#include "engine/spring_step.hpp"
#include "engine/tet_forces.hpp"
#include "systems/advance_constants.hpp"
#include "systems/advance_energy.hpp"
#include "systems/advance_fine.hpp"
#include "systems/advance_forces.hpp"
#include "systems/advance_hold.hpp"
namespace trocar {
namespace {

// The rigid motion that best fits the directions of the conjugate gradients, weighted by the anchors: what the goals of
// a free body do when its particles move so. Without it the anchors would hold the body where it is.
struct GoalMotion {
    double stiffness = 0;
    Vec3d centre = Vec3d::Zero();     // m
    std::array<double, 6> inertia{};  // about the centre: xx yy zz xy xz yz

    GoalMotion(const ImplicitScratch& s, const SpringStep& step) {
        for (uint32_t i = 0; i < s.place.size(); ++i) {
            const double k = step.anchor_stiffness[i];
            stiffness += k;
            centre += k * Vec3d(s.place[i].x, s.place[i].y, s.place[i].z);
        }
        if (stiffness <= 0) return;
        centre /= stiffness;
        for (uint32_t i = 0; i < s.place.size(); ++i) {
            const double k = step.anchor_stiffness[i];
            const Vec3d r = Vec3d(s.place[i].x, s.place[i].y, s.place[i].z) - centre;
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
        Vec3d way = Vec3d::Zero(), moment = Vec3d::Zero(), turning = Vec3d::Zero();
        for (uint32_t i = 0; i < s.place.size(); ++i) {
            const Vec3d p = step.anchor_stiffness[i] * Vec3d(s.direction[i].x, s.direction[i].y, s.direction[i].z);
            way += p;
            moment += (Vec3d(s.place[i].x, s.place[i].y, s.place[i].z) - centre).cross(p);
        }
        way /= stiffness;
        if (!solve_symmetric(inertia, moment, turning)) turning.setZero();
        const Vec3d at_origin = way - turning.cross(centre);
        for (int i = 0; i < 3; ++i) {
            implicit.rigid_velocity[i] = static_cast<float>(at_origin[i]);
            implicit.rigid_turn[i] = static_cast<float>(turning[i]);
        }
    }
};

ImplicitStep bind_implicit(ImplicitScratch& s, const AdvanceBody& b) {
    const size_t rows = b.particles.count, columns = b.step.slice_column[b.slices] - b.step.slice_column[0];
    s.place.resize(rows);
    s.direction.resize(rows);
    // columns are counted over all prototypes
    s.spoke.resize(64 * columns);
    s.block.resize(6 * rows);
    for (auto* field : {&s.residual, &s.applied, &s.change}) field->resize(3 * rows);
    s.sums.resize(size_t{chunk_count(b.slices, kSlicesPerChunk)} * kSliceWidth);
    ImplicitStep step = {};
    step.spring = &b.step;
    step.place = &s.place[0].x;
    step.direction = &s.direction[0].x;
    step.spoke = s.spoke.data() - 64 * static_cast<size_t>(b.step.slice_column[0]);
    step.block = s.block.data();
    step.residual = s.residual.data();
    step.applied = s.applied.data();
    step.change = s.change.data();
    step.rows = static_cast<uint32_t>(rows);
    return step;
}

// The body that is stepped: its springs and its tetrahedra.
struct MidpointStep {
    AdvanceBody& b;
    ImplicitStep step = {};
    TetStep tets = {};
    ImplicitTets volumes = {};
    uint32_t groups = 0;  // of 16 tetrahedra; 0 = has none
    bool held = false;    // constraints may act within the step
};
// Groups that a kernel takes at once.
constexpr uint32_t kGroupsPerChunk = 256;

// Adds what the corners of tetrahedra hold to three fields of the nodes, which start from 0.
void gather_corners(const AdvanceBody& b, TetStep& tets, float* field, size_t rows) {
    std::fill_n(field, 3 * rows, 0.0f);
    tets.force_x = field, tets.force_y = field + rows, tets.force_z = field + 2 * rows;
    parallel_for(b.slices, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { tet_kernels().gather(&tets, begin, end); });
}

// Volume forces and stiffness at the places of the step; notes the least volume.
void bind_volumes(const AdvanceCall& call, const Particles& particles, TissueScratch& scratch, MidpointStep& m, AdvanceResult& result) {
    const AdvanceBody& b = m.b;
    ImplicitStep& step = m.step;
    const AdvanceInputs& in = call.inputs;
    if (!has_tets(in.other.solids, in.bodies, b.body)) return;
    ImplicitScratch& s = scratch.implicit;
    const size_t rows = b.particles.count;
    m.tets = bind_tets(*in.other.solids, in.bodies, particles, b.body, in.other.torn_springs);
    m.tets.offset = step.place;
    m.tets.corner_force = &scratch.corner_force[0].x;
    m.groups = m.tets.tetrahedra / kSliceWidth;
    s.slope.resize(size_t{12} * m.tets.tetrahedra);
    s.volume_force.assign(3 * rows, 0.0f);
    s.volume_block.resize(6 * rows);
    m.volumes = {&m.tets, step.direction, s.slope.data()};
    m.tets.force_x = s.volume_force.data(), m.tets.force_y = m.tets.force_x + rows, m.tets.force_z = m.tets.force_y + rows;
    result.min_volume_ratio = std::min<double>(result.min_volume_ratio, add_tet_forces(m.tets, b.slices));
    const ImplicitKernels& kernels = implicit_kernels();
    parallel_for(m.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_slopes(&m.volumes, begin, end); });
    gather_corners(b, m.tets, s.volume_block.data(), rows);
    parallel_for(m.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_blocks(&m.volumes, begin, end); });
    gather_corners(b, m.tets, s.volume_block.data() + 3 * rows, rows);
    step.volume_force = step.volume_pull = s.volume_force.data();
    step.volume_block = s.volume_block.data();
}

// A body that was stepped by leapfrog until now: a kick of half its last step brings its velocities, half a step behind, to
// the time of its places.
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
        const size_t rows = b.particles.count;
        std::vector<float>& force = scratch.implicit.volume_force;
        force.assign(3 * rows, 0.0f);
        const float* const others[3] = {step.force_x, step.force_y, step.force_z};
        for (size_t i = 0; i < 3 && step.force_x; ++i) std::copy_n(others[i], rows, force.data() + i * rows);
        TetStep tets = bind_tets(*in.other.solids, in.bodies, state.particles, b.body, in.other.torn_springs);
        tets.offset = step.offset;
        tets.corner_force = &scratch.corner_force[0].x;
        tets.force_x = force.data(), tets.force_y = tets.force_x + rows, tets.force_z = tets.force_y + rows;
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

// Conjugate gradients on the velocities; begin has run. Counts iterations and notes the residual. start: residual . (block * residual).
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
        if (m.held) bent += apply_held_rows(island, b, scratch, solver);
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

// Pressure and bending where the step expects its particles half way on. Taken at its start they would make Euler's method,
// which swings up; like this they are as stable as in leapfrog, whatever the springs do beside them: with x' = v, v' = -w^2 x the
// step's matrix has determinant 1 and trace 2 - (w h)^2.
void find_forces_half_way(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, TissueScratch& scratch,
                          AdvanceBody& b, AdvanceResult& result) {
    const Bodies& bodies = call.inputs.bodies;
    if (!has_pressure(bodies, b.body) && !has_bending(bodies, b.body)) return;
    const auto start = std::exchange(b.now, scratch.implicit.place.data());
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
    const bool books = call.params.account_energy;
    if (b.last_dt > 0) catch_up(call, scratch, state, b);
    const double before = books ? energy_before(call, b, scratch, state) : 0;
    // what rows do to single particles makes the midpoint ring for ever at steps beyond the explicit limit; backward
    // Euler damps it out
    if (!b.touched && is_wild(call, state.particles, b, least_volume(call, state.particles, b, 0, scratch), scratch)) {
        const double damped = step_finely(call, island, scratch, state, b, result);
        if (!books) return;
        if (b.damping_work) b.damping_work[0] += damped;
        result.work_numeric += own_work(call, before, damped + work_of_others(b.step, b.particles.count), scratch, state, b);
        return;
    }
    step.theta = b.touched ? 1.0f : 0.5f;
    b.step.kick_dt = b.step.dt;
    // a held body is damped half before and half after, which keeps the second order; the rigid motion that a free
    // body's damping leaves alone is known at the start only
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
        SpringStep half_way = b.step;
        half_way.offset = step.place;
        fit_goals(sum_shape(half_way, b.slices, scratch.shape_sums), state.poses.orientation[b.body], b.step);
    }
    if (!b.touched)
        find_forces_half_way(call, island, state.particles, scratch, b, result);  // with backward Euler they bear longer steps at the start
    bind_volumes(call, state.particles, scratch, m, result);
    const double start = sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.begin(&step, begin, end, lanes); });
    ++result.implicit_steps;
    m.held = bind_held_rows(call, island, b, scratch, solver);
    if (!m.held) solve(island, start, scratch, solver, m, result);
    for (uint32_t pass = 0; m.held && pass < kMostSolves; ++pass) {
        solve(island, start_held_rows(island, b, scratch, solver, step), scratch, solver, m, result);
        if (!judge_held_rows(call, scratch, island, b, pass + 3 < kMostSolves, solver)) break;
    }
    const double pressed = m.held ? settle_held_rows(island, b, solver) : 0;
    damped += sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.finish(&step, begin, end, lanes); });
    if (!books) return;
    if (b.damping_work) b.damping_work[0] += damped;
    if (std::isfinite(pressed)) result.work_contact += pressed;  // else a body about to be restored
    result.work_numeric += own_work(call, before, damped + pressed + work_of_others(b.step, b.particles.count), scratch, state, b);
}

}  // namespace trocar
