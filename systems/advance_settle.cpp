#include <algorithm>
#include <numeric>
#include <utility>

#include "engine/disjoint_sets.hpp"
#include "engine/parallel.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

// Rows are solved until no relative velocity changes by more than this (m/s), or this often.
constexpr double kSettledChange = 3e-6;
constexpr uint32_t kMostSweeps = 128, kMostSweepsSolved = 48;  // the latter with direct solutions in between
// Bodies that move need not agree as well as those that rest: this share may be left of what the first sweep changed, and that
// of what it changed beyond kLeastBounce. (200 boxes that rain among 400 soft balls: as much overlap, in half the time.)
constexpr double kSettledShare = 1e-3, kHitShare = 1e-2;
// Larger components are left to the groups, which are worked on at the same time.
constexpr uint32_t kMostRowsAlone = 2048;
constexpr uint32_t kComponentsPerChunk = 4;
// What is solved at once, so often and with so many sweeps between after the first few times, gets fewer sweeps: what they leave
// the next substep has solved at its start.
constexpr uint32_t kMostSolutions = 16, kSolutionsInARow = 4, kSweepsBetween = 3;

void sweep_row(AdvanceScratch& s, ContactActive& row, SweepChange& change) {
    if (row.turning == kNone) {
        solve_row(s, row);
        return;
    }
    ContactTurning& t = s.turning[row.turning];
    t.normal_before = row.normal_impulse;
    t.friction_before = row.friction_impulse;
    change.velocity = std::max(change.velocity, solve_row(s, row));
    const double normal = row.normal_impulse - t.normal_before;
    change.squared_impulse += normal * normal + norm2(row.friction_impulse - t.friction_before);
}

// Moves the impulses of a row on along the conjugate direction, of which `share` is kept.
void go_on(AdvanceScratch& s, ContactActive& row, double share) {
    if (row.turning == kNone) return;
    ContactTurning& t = s.turning[row.turning];
    const Vec4d friction = row.friction_impulse - t.friction_before;
    const double normal = row.normal_impulse - t.normal_before, normal_on = share * t.normal_way;
    const Vec4d friction_on = share * t.friction_way;
    t.normal_way = normal + normal_on;
    t.friction_way = friction + friction_on;
    if (share == 0) return;
    row.normal_impulse += normal_on;
    row.friction_impulse += friction_on;
    give_impulse(s, row, t, normal_on * row.normal + friction_on);
}

// Free bodies stand on each other: their rows start from the impulses of the substep before and are solved until they
// agree. A tower sways in modes that sweeps alone take thousands for: between sweeps the impulses go on along a
// conjugate direction (Silcowitz, Niebe, Erleben 2010, "A nonsmooth nonlinear conjugate gradient method for interactive
// contact force problems"); a sweep is always the last. What bounces is solved as well as what rests: of a box that falls flat
// the corners that come first would turn it.
template <typename Sweep, typename GoOn>  // Sweep: SweepChange(); GoOn: void(double share)
void settle(const AdvanceIsland& island, uint32_t most_sweeps, const Sweep& sweep, const GoOn& move_on) {
    double squares_before = 0, settled = kSettledChange;
    for (uint32_t pass = 0; pass < most_sweeps; ++pass) {
        const auto [change, squares] = sweep();
        if (pass == 0 && !island.scratch.bounces)
            settled = std::max({settled, kSettledShare * change, kHitShare * (change - kLeastBounce)});
        if ((change < settled && pass + 1 >= island.params.contact.iterations) || pass + 1 == most_sweeps) break;
        const bool grows = pass == 0 || !(squares < squares_before);  // also when nothing changes any more
        move_on(grows ? 0 : squares / squares_before);
        squares_before = squares;
    }
}

void settle_groups(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    const auto sweep = [&] {
        for_each_group(s, [&](RowGroup& group) {
            group.change = {};
            solve_blocks(s, group);
            for (ContactActive& row : group.active) sweep_row(s, row, group.change);
        });
        SweepChange all{solve_drives(s), 0};
        for (uint32_t g = 0; g < s.phase[4]; ++g) {
            all.velocity = std::max(all.velocity, s.group[g].change.velocity);
            all.squared_impulse += s.group[g].change.squared_impulse;
        }
        return all;
    };
    settle(island, kMostSweeps, sweep, [&](double share) {
        for_each_group(s, [&](RowGroup& group) {
            for (ContactActive& row : group.active) go_on(s, row, share);
        });
    });
}

// Of few bodies what carries is solved at once before sweeps, as long as that helps.
void settle_component(AdvanceIsland& island, std::span<ContactActive* const> rows, DirectSolve& direct) {
    AdvanceScratch& s = island.scratch;
    // where something bounces, what rests on it does not hold it
    const bool direct_too = !s.bounces && prepare_direct(s, rows, direct);
    uint32_t solutions_left = direct_too ? kMostSolutions : 0, sweeps_since = 0, sweeps_between = 0;
    bool solved = false, has_way = true;
    double before = 0;
    const auto solve = [&] {
        solved = false;
        if (solutions_left == 0 || sweeps_since++ < sweeps_between) return false;
        before = potential(s, rows, direct);
        solved = solve_directly(s, rows, direct);
        solutions_left = solved ? solutions_left - 1 : 0;
        if (solutions_left < kMostSolutions - kSolutionsInARow) sweeps_between = kSweepsBetween;
        sweeps_since = 0;
        has_way = false;
        return solved;
    };
    const auto sweep_once = [&] {
        SweepChange change;
        for (ContactActive* row : rows) sweep_row(s, *row, change);
        return change;
    };
    const auto sweep = [&] {
        const SweepChange change = sweep_once();
        if (!solved || potential(s, rows, direct) <= before) return change;
        undo_solution(s, rows, direct);
        sweeps_between = kSweepsBetween;
        return sweep_once();
    };
    solve();
    settle(island, direct_too ? kMostSweepsSolved : kMostSweeps, sweep, [&](double share) {
        if (solve()) return;
        for (ContactActive* row : rows) go_on(s, *row, has_way ? share : 0);
        has_way = true;
    });
}

template <typename Visit>  // Visit: void(ContactActive&)
void visit_active(AdvanceScratch& s, const Visit& visit) {
    for (RowGroup& group : std::span(s.group).first(s.phase[4]))
        for (ContactActive& row : group.active)
            if (row.nodes > 0) visit(row);
}

// Sorts the active rows by what shares nodes with what: towers side by side, which an island holds together because they might
// touch. Each keeps its order. False where they are better solved all together.
bool find_components(AdvanceScratch& s) {
    const auto has_blocks = [](const RowGroup& g) { return !g.active_block.empty(); };
    const auto is_driven = [](const AdvanceFree& f) { return f.drive != kNone; };
    if (std::ranges::any_of(std::span(s.group).first(s.phase[4]), has_blocks) || std::ranges::any_of(s.free, is_driven)) return false;
    std::vector<uint32_t>& component_of = s.component_of;
    component_of.resize(s.node.size());
    std::iota(component_of.begin(), component_of.end(), 0u);
    visit_active(s, [&](const ContactActive& row) {
        for (uint32_t k = 1; k < row.nodes; ++k) join_sets(component_of, row.node[0], row.node[k]);
    });
    for (uint32_t n = 0; n < component_of.size(); ++n) component_of[n] = find_set(component_of, n);
    s.component.assign(component_of.size(), {});
    visit_active(s, [&](const ContactActive& row) { ++s.component[component_of[row.node[0]]].count; });
    uint32_t first = 0, most = 0;
    for (Range& rows : s.component) {
        most = std::max(most, rows.count);
        rows.first = std::exchange(first, first + rows.count);
        rows.count = 0;
    }
    if (most > kMostRowsAlone && s.phase[4] > 1) return false;
    s.settling.resize(first);
    visit_active(s, [&](ContactActive& row) {
        Range& rows = s.component[component_of[row.node[0]]];
        s.settling[rows.first + rows.count++] = &row;
    });
    std::erase_if(s.component, [](const Range& rows) { return rows.count == 0; });
    return true;
}

}  // namespace

void settle_rows(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    if (!find_components(s)) return settle_groups(island);
    const uint32_t components = static_cast<uint32_t>(s.component.size());
    if (const uint32_t chunks = chunk_count(components, kComponentsPerChunk); s.direct.size() < chunks) s.direct.resize(chunks);
    parallel_for(components, kComponentsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const Range rows = s.component[i];
            settle_component(island, std::span(s.settling).subspan(rows.first, rows.count), s.direct[begin / kComponentsPerChunk]);
        }
    });
}

}  // namespace trocar
