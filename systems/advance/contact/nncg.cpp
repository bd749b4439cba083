#include "systems/advance/contact/nncg.hpp"

#include <algorithm>
#include <atomic>
#include <numeric>
#include <utility>

#include "engine/base/disjoint_sets.hpp"
#include "engine/jobs/parallel.hpp"
#include "systems/advance/contact/contact_impulses.hpp"
#include "systems/advance/contact/direct_solve.hpp"
#include "systems/advance/contact/rigid_sweeps.hpp"
#include "systems/advance/contact/wide_constraints.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/advance/rigid/driven_bodies.hpp"
#include "systems/advance/rigid/free_bodies.hpp"
namespace trocar {
namespace {

constexpr uint32_t kComponentsPerChunk = 4;
// Components of more than kManyConstraints are swept kSweepsMoving times before they are solved directly, smaller ones are not: a ball that
// slides in a trough would gain a hundredth of its speed. If a point of contact is faster than kLeastBounce, those of up to kMostMoving are
// swept so often and then only until no relative velocity changes by kMovingChange, m/s: the next substep goes on from there. By trial on
// piles of boxes (stress_pile, convex hulls; worst overlap of all passes by triangles): 100 of them for 1 s, seeds 1 to 3, 0.65, 0.56, 0.57
// mm in half the time of convergence with direct solutions, 1,000 for 0.6 s 0.90 mm. With 0.02 m/s 100 overlap as little and 1,000 by 2.3
// mm. Without regard to the change 8, 12, 16, 24 sweeps leave 2.7, 2.2, 0.86, 0.67 mm among 100.
constexpr uint32_t kSweepsMoving = 24, kManyConstraints = 48, kMostMoving = 512;
constexpr double kMovingChange = 0.005;

void sweep_constraint(AdvanceIsland& island, PreparedConstraint& constraint, SweepChange& change) {
    if (!constraint.turns()) {
        solve_constraint(island, constraint);
        return;
    }
    auto& t = constraint.angular;
    t.normal_before = constraint.normal_impulse;
    t.friction_before = constraint.friction_impulse;
    change.velocity = std::max(change.velocity, solve_constraint(island, constraint));
    const double normal = constraint.normal_impulse - t.normal_before;
    change.squared_impulse += normal * normal + norm2(constraint.friction_impulse - t.friction_before);
}

// Moves a constraint's impulses along the conjugate direction: the change by the last sweep and `share` of the direction before.
void nncg_step(double share, AdvanceIsland& island, PreparedConstraint& constraint) {
    if (!constraint.turns()) return;
    auto& t = constraint.angular;
    const Vec4d friction = constraint.friction_impulse - t.friction_before;
    const double normal = constraint.normal_impulse - t.normal_before, normal_on = share * t.normal_direction;
    const Vec4d friction_on = share * t.friction_direction;
    t.normal_direction = normal + normal_on;
    t.friction_direction = friction + friction_on;
    if (share == 0) return;
    constraint.normal_impulse += normal_on;
    constraint.friction_impulse += friction_on;
    give_impulse(constraint, normal_on * constraint.normal + friction_on, island);
}

// Sweeps until the constraints of free bodies have converged; they have been warm started. Projected
// Gauss-Seidel alone needs thousands of iterations for the slow sway of a tower: between sweeps the impulses
// move along a conjugate direction (Silcowitz, Niebe, Erleben 2010, "A nonsmooth nonlinear conjugate gradient
// method for interactive contact force problems"). A sweep is always last. If something bounces, the
// tolerance stays that of bodies at rest: solved less accurately, a box that falls flat would be set spinning
// by the corners solved first.
// Sweeps that a substep may take, of `most`: bounds the work of a pass.
uint32_t affordable_sweeps(const AdvanceCall& call, const ContactSolver& solver, uint32_t most) {
    uint64_t active = 1;
    for (const ConstraintGroup& group : std::span(solver.group).first(solver.colour[4])) active += group.active.size() + group.active_lanes;
    return uint32_t(std::clamp<uint64_t>(kMostWork * call.params.ticks / (active * call.params.substeps), kFewestSweeps, most));
}

struct Sweeps {
    uint32_t most = 0;
    bool moving = false;  // may end at kMovingChange
};
// Returns whether it ended with the most sweeps.
template <typename Sweep, typename NncgStep>  // Sweep: SweepChange(); NncgStep: void(double share)
bool iterate_to_convergence(const AdvanceCall& call, const ContactSolver& solver, Sweeps sweeps, const Sweep& sweep,
                            const NncgStep& move_on) {
    double squares_before = 0, converged = kConvergedChange;
    for (uint32_t iteration = 0; iteration < sweeps.most; ++iteration) {
        const auto [change, squares] = sweep();
        if (iteration == 0 && !solver.bounces)
            converged = std::max({converged, kConvergedShare * change, kHitShare * (change - kLeastBounce)});
        if (change < converged && iteration + 1 >= call.params.contact.iterations) return false;
        if (sweeps.moving && change < kMovingChange && iteration + 1 >= kSweepsMoving) return false;
        if (iteration + 1 == sweeps.most) return true;
        const bool grows = iteration == 0 || !(squares < squares_before);  // also without any further change
        move_on(grows ? 0 : squares / squares_before);
        squares_before = squares;
    }
    return true;
}

// Whether a point of contact of a free body is fast.
bool any_moves(std::span<PreparedConstraint* const> constraints, std::span<const SweptBody> bodies) {
    return std::ranges::any_of(constraints, [&](const PreparedConstraint* c) {
        for (int side = 0; side < 2; ++side) {
            const uint32_t free = c->angular.free[side];
            if (free == kNone) continue;
            const Vec4d velocity = bodies[free].velocity + cross(bodies[free].spin, c->angular.arm[side]);
            if (norm2(velocity) > kLeastBounce * kLeastBounce) return true;
        }
        return false;
    });
}

// As converge_groups, over compact copies: a list for each group.
bool converge_group_lists(const AdvanceCall& call, uint32_t sweeps, RigidSweeps& swept, ContactSolver& solver, AdvanceIsland& island) {
    const std::span<SweptBody> bodies(swept.body);
    const auto list_of = [&](const ConstraintGroup& group) -> std::vector<SweptConstraint>& {
        return swept.list[size_t(&group - solver.group.data())];
    };
    if (swept.list.size() < solver.colour[4]) swept.list.resize(solver.colour[4]);
    for_each_group(solver, [&](ConstraintGroup& group) {
        std::vector<SweptConstraint>& list = list_of(group);
        make_room(list, group.prepared.count);
        list.clear();
        for (const uint32_t i : group.active) list.push_back(compact(island, bodies, solver.prepared[i]));
    });
    const auto sweep_all = [&] {
        for_each_group(solver, [&](ConstraintGroup& group) { group.change = sweep(list_of(group), bodies); });
        SweepChange all;
        for (uint32_t g = 0; g < solver.colour[4]; ++g) {
            all.velocity = std::max(all.velocity, solver.group[g].change.velocity);
            all.squared_impulse += solver.group[g].change.squared_impulse;
        }
        return all;
    };
    const bool stopped = iterate_to_convergence(call, solver, {sweeps}, sweep_all, [&](double share) {
        for_each_group(solver, [&](ConstraintGroup& group) { move_on(share, list_of(group), bodies); });
    });
    for_each_group(solver, [&](ConstraintGroup& group) { store_impulses(list_of(group)); });
    for (uint32_t g = 0; g < solver.colour[4]; ++g) store_bodies(swept.list[g], bodies, island);
    return stopped;
}

// Returns whether the bound on work ended it; as converge_component.
bool converge_groups(const AdvanceCall& call, RigidSweeps& swept, ContactSolver& solver, AdvanceIsland& island) {
    const uint32_t sweeps = affordable_sweeps(call, solver, kMostSweeps);
    if (swept.all) return converge_group_lists(call, sweeps, swept, solver, island) && sweeps < kMostSweeps;
    const auto sweep = [&] {
        for_each_group(solver, [&](ConstraintGroup& group) {
            group.change = {};
            solve_wide_constraints(group, solver, island.nodes);
            for (const uint32_t i : group.active) sweep_constraint(island, solver.prepared[i], group.change);
        });
        SweepChange all{solve_drives(island), 0};
        for (uint32_t g = 0; g < solver.colour[4]; ++g) {
            all.velocity = std::max(all.velocity, solver.group[g].change.velocity);
            all.squared_impulse += solver.group[g].change.squared_impulse;
        }
        return all;
    };
    const bool stopped = iterate_to_convergence(call, solver, {sweeps}, sweep, [&](double share) {
        for_each_group(solver, [&](ConstraintGroup& group) {
            for (const uint32_t i : group.active) nncg_step(share, island, solver.prepared[i]);
        });
    });
    return stopped && sweeps < kMostSweeps;
}

// Sweeps over compact copies of a component's constraints.
bool converge_list(const AdvanceCall& call, const ContactSolver& solver, Sweeps sweeps, std::span<PreparedConstraint* const> constraints,
                   std::span<SweptBody> bodies, std::vector<SweptConstraint>& list, AdvanceIsland& island) {
    make_room(list, constraints.size());
    list.clear();
    for (PreparedConstraint* constraint : constraints) list.push_back(compact(island, bodies, *constraint));
    const bool stopped = iterate_to_convergence(
        call, solver, sweeps, [&] { return sweep(list, bodies); }, [&](double share) { move_on(share, list, bodies); });
    store_impulses(list);
    store_bodies(list, bodies, island);
    return stopped;
}

// Solves one component to convergence. If it is small, its loaded constraints are solved directly before a
// sweep, as long as the sweep that follows does not raise the potential.
bool converge_component(const AdvanceCall& call, const ContactSolver& solver, ContactComponents& components, AdvanceIsland& island,
                        std::span<PreparedConstraint* const> constraints, DirectSolve& direct, std::vector<SweptConstraint>& list) {
    // what moves in a pile need not be exact; what sways needs direct solutions
    if (components.sweeps.all && !solver.bounces && constraints.size() > kManyConstraints) {
        const bool moving = constraints.size() <= kMostMoving && any_moves(constraints, components.sweeps.body);
        const uint32_t affordable = affordable_sweeps(call, solver, kMostSweeps);
        const Sweeps first{moving ? affordable : std::min(kSweepsMoving, affordable), moving};
        const bool stopped = converge_list(call, solver, first, constraints, components.sweeps.body, list, island);
        if (!stopped || moving) return stopped && affordable < kMostSweeps;
    }
    // not while something bounces: a direct solution would hold bodies together that are about to separate
    const bool direct_too = !solver.bounces && prepare_direct(island, components, constraints, direct);
    const uint32_t most_sweeps = direct_too ? kMostSweepsSolved : kMostSweeps, sweeps = affordable_sweeps(call, solver, most_sweeps);
    if (!direct_too && components.sweeps.all)
        return converge_list(call, solver, {sweeps}, constraints, components.sweeps.body, list, island) && sweeps < most_sweeps;
    uint32_t solutions_left =
                 direct_too ? (sweeps < most_sweeps ? std::min(kMostSolutions, sweeps / kSweepsPerSolution) : kMostSolutions) : 0,
             sweeps_since = 0, sweeps_between = 0;
    bool solved = false, has_direction = true;
    double before = 0;
    const auto solve = [&] {
        solved = false;
        if (solutions_left == 0 || sweeps_since++ < sweeps_between) return false;
        before = potential(island, direct, constraints);
        solved = solve_directly(components, island, constraints, direct);
        solutions_left = solved ? solutions_left - 1 : 0;
        if (solutions_left < kMostSolutions - kSolutionsInSequence) sweeps_between = kSweepsBetween;
        sweeps_since = 0;
        has_direction = false;
        return solved;
    };
    const auto sweep_once = [&] {
        SweepChange change;
        for (PreparedConstraint* constraint : constraints) sweep_constraint(island, *constraint, change);
        return change;
    };
    const auto sweep = [&] {
        const SweepChange change = sweep_once();
        if (!solved || potential(island, direct, constraints) <= before) return change;
        undo_solution(direct, island, constraints);
        sweeps_between = kSweepsBetween;
        return sweep_once();
    };
    solve();
    const bool stopped = iterate_to_convergence(call, solver, {sweeps}, sweep, [&](double share) {
        if (solve()) return;
        for (PreparedConstraint* constraint : constraints) nncg_step(has_direction ? share : 0, island, *constraint);
        has_direction = true;
    });
    return stopped && sweeps < most_sweeps;
}

template <typename Visit>  // Visit: void(PreparedConstraint&)
void visit_active(ContactSolver& solver, const Visit& visit) {
    for (ConstraintGroup& group : std::span(solver.group).first(solver.colour[4]))
        for (const uint32_t i : group.active)
            if (solver.prepared[i].nodes > 0) visit(solver.prepared[i]);
}

// Sorts the active constraints into components that share no node, such as towers side by side in one island,
// in stable order. False if all are to be swept together: with wide constraints, with driven bodies, or if
// there are several groups and one component has more than kMostConstraintsAlone.
bool find_components(const AdvanceIsland& island, ContactComponents& components, ContactSolver& solver) {
    const auto has_wide = [](const ConstraintGroup& g) { return !g.active_wide.empty(); };
    const auto is_driven = [](const AdvanceFree& f) { return f.drive != kNone; };
    if (std::ranges::any_of(std::span(solver.group).first(solver.colour[4]), has_wide) || std::ranges::any_of(island.free, is_driven))
        return false;
    std::vector<uint32_t>& component_of = components.component_of;
    component_of.resize(island.nodes.node.size());
    std::iota(component_of.begin(), component_of.end(), 0u);
    visit_active(solver, [&](const PreparedConstraint& constraint) {
        for (uint32_t k = 1; k < constraint.nodes; ++k) join_sets(component_of, constraint.node[0], constraint.node[k]);
    });
    for (uint32_t n = 0; n < component_of.size(); ++n) component_of[n] = find_set(component_of, n);
    components.component.assign(component_of.size(), {});
    visit_active(solver, [&](const PreparedConstraint& constraint) { ++components.component[component_of[constraint.node[0]]].count; });
    uint32_t first = 0, most = 0;
    for (Range& range : components.component) {
        most = std::max(most, range.count);
        range.first = std::exchange(first, first + range.count);
        range.count = 0;
    }
    if (most > kMostConstraintsAlone && solver.colour[4] > 1) return false;
    components.sorted_active.resize(first);
    visit_active(solver, [&](PreparedConstraint& constraint) {
        Range& range = components.component[component_of[constraint.node[0]]];
        components.sorted_active[range.first + range.count++] = &constraint;
    });
    std::erase_if(components.component, [](const Range& range) { return range.count == 0; });
    return true;
}

// Whether compact copies can be swept: of all active constraints or of none.
void find_swept(const AdvanceIsland& island, const ContactSolver& solver, RigidSweeps& swept) {
    swept.all = std::ranges::none_of(island.free, [](const AdvanceFree& f) { return f.drive != kNone || f.held; }) &&
                std::ranges::all_of(std::span(solver.group).first(solver.colour[4]), [&](const ConstraintGroup& group) {
                    return group.active_wide.empty() &&
                           std::ranges::all_of(group.active, [&](uint32_t i) { return is_swept(island, solver.prepared[i]); });
                });
    if (swept.all) load_bodies(island, swept.body);
}

}  // namespace

void solve_to_convergence(const AdvanceCall& call, ContactComponents& components, ContactSolver& solver, AdvanceIsland& island,
                          AdvanceResult& result) {
    make_room(components.sorted_active, solver.prepared.size());
    make_room(components.component, island.nodes.node.size());
    make_room(components.component_of, island.nodes.node.size());
    find_swept(island, solver, components.sweeps);
    if (!find_components(island, components, solver)) {
        result.unsolved_substeps += converge_groups(call, components.sweeps, solver, island);
        return;
    }
    const uint32_t count = static_cast<uint32_t>(components.component.size());
    if (const uint32_t chunks = chunk_count(count, kComponentsPerChunk); components.direct.size() < chunks)
        components.direct.resize(chunks);
    if (const uint32_t chunks = chunk_count(count, kComponentsPerChunk); components.sweeps.list.size() < chunks)
        components.sweeps.list.resize(chunks);
    std::atomic<bool> stopped = false;
    parallel_for(count, kComponentsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const Range range = components.component[i];
            if (converge_component(call, solver, components, island, std::span(components.sorted_active).subspan(range.first, range.count),
                                   components.direct[begin / kComponentsPerChunk], components.sweeps.list[begin / kComponentsPerChunk]))
                stopped.store(true, std::memory_order_relaxed);
        }
    });
    result.unsolved_substeps += stopped.load();
}

}  // namespace trocar
