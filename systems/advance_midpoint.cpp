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
#include "systems/advance_implicit.hpp"
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

// The tetrahedra of the body that is stepped.
struct Volumes {
    TetStep tets = {};
    ImplicitTets step = {};
    uint32_t groups = 0;  // of 16; 0 = has none
};
// With held rows; in the last two none joins, those that pull let go.
constexpr uint32_t kMostSolves = 6;
// Groups that a kernel takes at once.
constexpr uint32_t kGroupsPerChunk = 256;

// Adds what the corners of tetrahedra hold to three fields of the nodes, which start from 0.
void gather_corners(const AdvanceBody& b, TetStep& tets, float* field, size_t rows) {
    std::fill_n(field, 3 * rows, 0.0f);
    tets.force_x = field, tets.force_y = field + rows, tets.force_z = field + 2 * rows;
    parallel_for(b.slices, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { tet_kernels().gather(&tets, begin, end); });
}

// Volume forces and stiffness at the places of the step; notes the least volume.
void bind_volumes(AdvanceIsland& island, const AdvanceBody& b, ImplicitStep& step, Volumes& v) {
    const AdvanceInputs& in = island.inputs;
    if (!has_tets(in.other.solids, in.bodies, b.body)) return;
    ImplicitScratch& s = island.scratch.implicit;
    const size_t rows = b.particles.count;
    v.tets = bind_tets(*in.other.solids, in.bodies, island.particles, b.body, in.other.torn_springs);
    v.tets.offset = step.place;
    v.tets.corner_force = &island.scratch.corner_force[0].x;
    v.groups = v.tets.tetrahedra / kSliceWidth;
    s.slope.resize(size_t{12} * v.tets.tetrahedra);
    s.volume_force.assign(3 * rows, 0.0f);
    s.volume_block.resize(6 * rows);
    v.step = {&v.tets, step.direction, s.slope.data()};
    v.tets.force_x = s.volume_force.data(), v.tets.force_y = v.tets.force_x + rows, v.tets.force_z = v.tets.force_y + rows;
    island.result.min_volume_ratio = std::min<double>(island.result.min_volume_ratio, add_tet_forces(v.tets, b.slices));
    const ImplicitKernels& kernels = implicit_kernels();
    parallel_for(v.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_slopes(&v.step, begin, end); });
    gather_corners(b, v.tets, s.volume_block.data(), rows);
    parallel_for(v.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_blocks(&v.step, begin, end); });
    gather_corners(b, v.tets, s.volume_block.data() + 3 * rows, rows);
    step.volume_force = step.volume_pull = s.volume_force.data();
    step.volume_block = s.volume_block.data();
}

// A body that was stepped by leapfrog until now: a kick of half its last step brings its velocities, half a step behind, to
// the time of its places.
void catch_up(AdvanceIsland& island, AdvanceBody& b, double* work) {
    const AdvanceInputs& in = island.inputs;
    SpringStep step = b.step;
    step.dt = 0;
    step.remainder_x = nullptr;
    const double kick = 0.5 * b.last_dt, left = b.shape ? 1.0 : std::exp(-0.5 * b.damping * kick);
    step.kick_dt = static_cast<float>(kick * left);
    step.kick_less = static_cast<float>(kick * (left - 1));
    step.keep = static_cast<float>(std::exp(-b.damping * kick));
    if (b.shape) {
        const ShapeTotals totals = sum_shape(step, b.slices, island.scratch.shape_sums);
        fit_goals(totals, island.poses.orientation[b.body], step);
        fit_drag(totals, step);
    }
    if (has_tets(in.other.solids, in.bodies, b.body)) {
        const size_t rows = b.particles.count;
        std::vector<float>& force = island.scratch.implicit.volume_force;
        force.assign(3 * rows, 0.0f);
        const float* const others[3] = {step.force_x, step.force_y, step.force_z};
        for (size_t i = 0; i < 3 && step.force_x; ++i) std::copy_n(others[i], rows, force.data() + i * rows);
        TetStep tets = bind_tets(*in.other.solids, in.bodies, island.particles, b.body, in.other.torn_springs);
        tets.offset = step.offset;
        tets.corner_force = &island.scratch.corner_force[0].x;
        tets.force_x = force.data(), tets.force_y = tets.force_x + rows, tets.force_z = tets.force_y + rows;
        add_tet_forces(tets, b.slices);
        step.force_x = tets.force_x, step.force_y = tets.force_y, step.force_z = tets.force_z;
    }
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
        spring_kernels().step(&step, begin, end, work ? work + begin / kSlicesPerChunk * kSliceWidth : nullptr);
    });
    b.last_dt = 0;
}

// Stiffness of the tetrahedra times the direction.
void pull_volumes(AdvanceIsland& island, const AdvanceBody& b, Volumes& v) {
    if (v.groups == 0) return;
    const ImplicitKernels& kernels = implicit_kernels();
    parallel_for(v.groups, kGroupsPerChunk, [&](uint32_t begin, uint32_t end) { kernels.tet_pull(&v.step, begin, end); });
    gather_corners(b, v.tets, island.scratch.implicit.volume_force.data(), b.particles.count);
}

// Conjugate gradients on the velocities; begin has run. Books iterations and residual.
void solve(AdvanceIsland& island, const AdvanceBody& b, ImplicitStep& step, Volumes& volumes, double start, bool held) {
    const ImplicitKernels& kernels = implicit_kernels();
    ImplicitScratch& s = island.scratch.implicit;
    const GoalMotion goals = b.shape ? GoalMotion(s, b.step) : GoalMotion({}, b.step);
    double rest = start;
    uint32_t iteration = 0;
    const double enough = b.stepping.tolerance * b.stepping.tolerance * start;
    for (; iteration < b.stepping.iterations && rest > enough; ++iteration) {
        goals.follow(s, b.step, step);
        pull_volumes(island, b, volumes);
        double bent = sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.apply(&step, begin, end, lanes); });
        if (held) bent += apply_held_rows(island, b);
        if (!(bent > 0)) break;
        const float a = static_cast<float>(rest / bent);
        const double next =
            sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.move(&step, a, begin, end, lanes); });
        const float turn = static_cast<float>(next / rest);
        rest = next;
        for_slices(b.slices, [&](uint32_t begin, uint32_t end) { kernels.turn(&step, turn, begin, end); });
    }
    island.result.implicit_iterations += iteration;
    if (start > 0) island.result.worst_implicit_residual = std::max(island.result.worst_implicit_residual, std::sqrt(rest / start));
}

// Pressure and bending where the step expects its particles half way on. Taken at its start they would make Euler's method,
// which swings up; like this they are as stable as in leapfrog, whatever the springs do beside them: with x' = v, v' = -w^2 x the
// step's matrix has determinant 1 and trace 2 - (w h)^2.
void find_forces_half_way(AdvanceIsland& island, AdvanceBody& b) {
    const Bodies& bodies = island.inputs.bodies;
    if (!has_pressure(bodies, b.body) && !has_bending(bodies, b.body)) return;
    const auto start = std::exchange(b.now, island.scratch.implicit.place.data());
    find_forces(island, b);
    b.now = start;
}

}  // namespace

void step_midpoint(AdvanceIsland& island, AdvanceBody& b, double* work) {
    const ImplicitKernels& kernels = implicit_kernels();
    AdvanceScratch& scratch = island.scratch;
    ImplicitScratch& s = scratch.implicit;
    ImplicitStep step = bind_implicit(s, b);
    const bool books = island.params.account_energy;
    if (b.last_dt > 0) catch_up(island, b, work);
    const double before = books ? energy_before(island, b) : 0;
    // what rows do to single particles makes the midpoint ring for ever at steps beyond the explicit limit; backward
    // Euler damps it out
    if (!b.touched && is_wild(island, b, least_volume(island, b, 0))) {
        const double damped = step_finely(island, b);
        if (!books) return;
        if (work) work[0] += damped;
        return book_own_work(island, b, before, damped + work_of_others(b.step, b.particles.count));
    }
    step.theta = b.touched ? 1.0f : 0.5f;
    b.step.kick_dt = b.step.dt;
    // a held body is damped half before and half after, which keeps the second order; the rigid motion that a free
    // body's damping leaves alone is known at the start only
    const double share = b.shape ? 1 : 0.5;
    step.keep_before = static_cast<float>(std::exp(-b.damping * share * island.dt));
    step.keep_after = static_cast<float>(std::exp(-b.damping * (1 - share) * island.dt));
    b.step.keep = static_cast<float>(std::exp(-b.damping * island.dt));
    if (b.shape) {
        b.step.back = 0;
        fit_drag(sum_shape(b.step, b.slices, scratch.shape_sums), b.step);
    }
    double damped = sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.predict(&step, begin, end, lanes); });
    if (b.shape) {
        SpringStep half_way = b.step;
        half_way.offset = step.place;
        fit_goals(sum_shape(half_way, b.slices, scratch.shape_sums), island.poses.orientation[b.body], b.step);
    }
    if (!b.touched) find_forces_half_way(island, b);  // with backward Euler they bear longer steps at the start
    Volumes volumes;
    bind_volumes(island, b, step, volumes);
    const double start = sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.begin(&step, begin, end, lanes); });
    ++island.result.implicit_steps;
    const bool held = bind_held_rows(island, b);
    if (!held) solve(island, b, step, volumes, start, false);
    for (uint32_t pass = 0; held && pass < kMostSolves; ++pass) {
        solve(island, b, step, volumes, start_held_rows(island, b, step), true);
        if (!judge_held_rows(island, b, pass + 3 < kMostSolves)) break;
    }
    const double pressed = held ? settle_held_rows(island, b) : 0;
    damped += sum_over(b, s.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.finish(&step, begin, end, lanes); });
    if (!books) return;
    if (work) work[0] += damped;
    if (std::isfinite(pressed)) island.result.work_contact += pressed;  // else a body about to be restored
    book_own_work(island, b, before, damped + pressed + work_of_others(b.step, b.particles.count));
}

}  // namespace trocar
