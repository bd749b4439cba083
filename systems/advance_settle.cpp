#include "systems/advance_settle.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "engine/disjoint_sets.hpp"
#include "engine/parallel.hpp"
#include "systems/advance_blocks.hpp"
#include "systems/advance_constants.hpp"
#include "systems/advance_contact.hpp"
#include "systems/advance_direct.hpp"
#include "systems/advance_drive.hpp"
#include "systems/advance_free.hpp"
namespace trocar {
namespace {

constexpr uint32_t kComponentsPerChunk = 4;
void sweep_row(AdvanceIsland& island, PreparedConstraint& row, SweepChange& change) {
    if (!row.turns()) {
        solve_row(island, row);
        return;
    }
    auto& t = row.angular;
    t.normal_before = row.normal_impulse;
    t.friction_before = row.friction_impulse;
    change.velocity = std::max(change.velocity, solve_row(island, row));
    const double normal = row.normal_impulse - t.normal_before;
    change.squared_impulse += normal * normal + norm2(row.friction_impulse - t.friction_before);
}

// Moves a constraint's impulses along the conjugate direction: the change by the last sweep and `share` of the direction before.
void go_on(double share, AdvanceIsland& island, PreparedConstraint& row) {
    if (!row.turns()) return;
    auto& t = row.angular;
    const Vec4d friction = row.friction_impulse - t.friction_before;
    const double normal = row.normal_impulse - t.normal_before, normal_on = share * t.normal_way;
    const Vec4d friction_on = share * t.friction_way;
    t.normal_way = normal + normal_on;
    t.friction_way = friction + friction_on;
    if (share == 0) return;
    row.normal_impulse += normal_on;
    row.friction_impulse += friction_on;
    give_impulse(row, normal_on * row.normal + friction_on, island);
}

// Sweeps until the constraints of free bodies agree; they have been warm started. Sweeps of projected Gauss-Seidel alone need thousands
// of iterations for the slow sway of a tower: between sweeps the impulses move on along a conjugate direction (Silcowitz, Niebe,
// Erleben 2010, "A nonsmooth nonlinear conjugate gradient method for interactive contact force problems"). A sweep is always the last.
// Where something bounces, the tolerance stays that of bodies at rest: if a box that falls flat were solved less exactly, the corners
// solved first would set it spinning.
template <typename Sweep, typename GoOn>  // Sweep: SweepChange(); GoOn: void(double share)
void settle(const AdvanceCall& call, const ContactSolver& solver, uint32_t most_sweeps, const Sweep& sweep, const GoOn& move_on) {
    double squares_before = 0, settled = kSettledChange;
    for (uint32_t pass = 0; pass < most_sweeps; ++pass) {
        const auto [change, squares] = sweep();
        if (pass == 0 && !solver.bounces) settled = std::max({settled, kSettledShare * change, kHitShare * (change - kLeastBounce)});
        if ((change < settled && pass + 1 >= call.params.contact.iterations) || pass + 1 == most_sweeps) break;
        const bool grows = pass == 0 || !(squares < squares_before);  // also when nothing changes any more
        move_on(grows ? 0 : squares / squares_before);
        squares_before = squares;
    }
}

void settle_groups(const AdvanceCall& call, ContactSolver& solver, AdvanceIsland& island) {
    const auto sweep = [&] {
        for_each_group(solver, [&](RowGroup& group) {
            group.change = {};
            solve_blocks(group, solver, island.nodes);
            for (const uint32_t i : group.active) sweep_row(island, solver.prepared[i], group.change);
        });
        SweepChange all{solve_drives(island), 0};
        for (uint32_t g = 0; g < solver.phase[4]; ++g) {
            all.velocity = std::max(all.velocity, solver.group[g].change.velocity);
            all.squared_impulse += solver.group[g].change.squared_impulse;
        }
        return all;
    };
    settle(call, solver, kMostSweeps, sweep, [&](double share) {
        for_each_group(solver, [&](RowGroup& group) {
            for (const uint32_t i : group.active) go_on(share, island, solver.prepared[i]);
        });
    });
}

// Solves one component to convergence. If it is small, the constraints that carry load are solved directly before a sweep, as long as
// the sweep that follows does not raise the potential.
void settle_component(const AdvanceCall& call, const ContactSolver& solver, ContactComponents& components, AdvanceIsland& island,
                      std::span<PreparedConstraint* const> rows, DirectSolve& direct) {
    // not while something bounces: a direct solution would hold bodies together that are about to part
    const bool direct_too = !solver.bounces && prepare_direct(island, components, rows, direct);
    uint32_t solutions_left = direct_too ? kMostSolutions : 0, sweeps_since = 0, sweeps_between = 0;
    bool solved = false, has_way = true;
    double before = 0;
    const auto solve = [&] {
        solved = false;
        if (solutions_left == 0 || sweeps_since++ < sweeps_between) return false;
        before = potential(island, direct, rows);
        solved = solve_directly(components, island, rows, direct);
        solutions_left = solved ? solutions_left - 1 : 0;
        if (solutions_left < kMostSolutions - kSolutionsInARow) sweeps_between = kSweepsBetween;
        sweeps_since = 0;
        has_way = false;
        return solved;
    };
    const auto sweep_once = [&] {
        SweepChange change;
        for (PreparedConstraint* row : rows) sweep_row(island, *row, change);
        return change;
    };
    const auto sweep = [&] {
        const SweepChange change = sweep_once();
        if (!solved || potential(island, direct, rows) <= before) return change;
        undo_solution(direct, island, rows);
        sweeps_between = kSweepsBetween;
        return sweep_once();
    };
    solve();
    settle(call, solver, direct_too ? kMostSweepsSolved : kMostSweeps, sweep, [&](double share) {
        if (solve()) return;
        for (PreparedConstraint* row : rows) go_on(has_way ? share : 0, island, *row);
        has_way = true;
    });
}

template <typename Visit>  // Visit: void(PreparedConstraint&)
void visit_active(ContactSolver& solver, const Visit& visit) {
    for (RowGroup& group : std::span(solver.group).first(solver.phase[4]))
        for (const uint32_t i : group.active)
            if (solver.prepared[i].nodes > 0) visit(solver.prepared[i]);
}

// Sorts the active constraints into components that share no node, as towers side by side in one island; they keep their order in each.
// False if all are to be swept together: with blocks, with driven bodies, or if there are several groups and one component has more
// than kMostRowsAlone.
bool find_components(const AdvanceIsland& island, ContactComponents& components, ContactSolver& solver) {
    const auto has_blocks = [](const RowGroup& g) { return !g.active_block.empty(); };
    const auto is_driven = [](const AdvanceFree& f) { return f.drive != kNone; };
    if (std::ranges::any_of(std::span(solver.group).first(solver.phase[4]), has_blocks) || std::ranges::any_of(island.free, is_driven))
        return false;
    std::vector<uint32_t>& component_of = components.component_of;
    component_of.resize(island.nodes.node.size());
    std::iota(component_of.begin(), component_of.end(), 0u);
    visit_active(solver, [&](const PreparedConstraint& row) {
        for (uint32_t k = 1; k < row.nodes; ++k) join_sets(component_of, row.node[0], row.node[k]);
    });
    for (uint32_t n = 0; n < component_of.size(); ++n) component_of[n] = find_set(component_of, n);
    components.component.assign(component_of.size(), {});
    visit_active(solver, [&](const PreparedConstraint& row) { ++components.component[component_of[row.node[0]]].count; });
    uint32_t first = 0, most = 0;
    for (Range& rows : components.component) {
        most = std::max(most, rows.count);
        rows.first = std::exchange(first, first + rows.count);
        rows.count = 0;
    }
    if (most > kMostRowsAlone && solver.phase[4] > 1) return false;
    components.settling.resize(first);
    visit_active(solver, [&](PreparedConstraint& row) {
        Range& rows = components.component[component_of[row.node[0]]];
        components.settling[rows.first + rows.count++] = &row;
    });
    std::erase_if(components.component, [](const Range& rows) { return rows.count == 0; });
    return true;
}

}  // namespace

void settle_rows(const AdvanceCall& call, ContactComponents& components, ContactSolver& solver, AdvanceIsland& island) {
    make_room(components.settling, solver.prepared.size());
    make_room(components.component, island.nodes.node.size());
    make_room(components.component_of, island.nodes.node.size());
    if (!find_components(island, components, solver)) return settle_groups(call, solver, island);
    const uint32_t count = static_cast<uint32_t>(components.component.size());
    if (const uint32_t chunks = chunk_count(count, kComponentsPerChunk); components.direct.size() < chunks)
        components.direct.resize(chunks);
    parallel_for(count, kComponentsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const Range rows = components.component[i];
            settle_component(call, solver, components, island, std::span(components.settling).subspan(rows.first, rows.count),
                             components.direct[begin / kComponentsPerChunk]);
        }
    });
}

}  // namespace trocar
