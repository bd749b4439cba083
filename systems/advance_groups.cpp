#include "systems/advance_groups.hpp"

#include <algorithm>

#include "engine/surfaces.hpp"
#include "systems/advance_constants.hpp"
namespace trocar {
namespace {

bool may_split(const ContactSorting& sorting, const AdvanceIsland& island) {
    const auto is_led = [&](const AdvanceRigid& rigid) {
        return rigid.node != kNone && (rigid.free == kNone || island.free[rigid.free].held || island.free[rigid.free].drive != kNone);
    };
    const auto rides = [](const AdvanceBody& b) { return b.skin_node != nullptr; };
    return sorting.dealt.size() >= kFewestRowsToSplit && island.body.size() + island.free.size() >= 2 * kBodiesPerStrip &&
           std::none_of(island.body.begin(), island.body.end(), rides) && std::none_of(island.rigid.begin(), island.rigid.end(), is_led);
}

// Puts bodies into strips of equal numbers along the axis on which they spread most. Returns the number of strips.
uint32_t find_strips(const AdvanceIsland& island, ContactSorting& sorting) {
    const uint32_t soft = static_cast<uint32_t>(island.body.size()), bodies = soft + static_cast<uint32_t>(island.free.size());
    const auto place = [&](uint32_t i) -> Vec4d {
        if (i >= soft) return island.nodes.node.place[island.rigid[island.free[i - soft].rigid].node];
        return island.body[i].origin + float_vec4(_mm_load_ps(&island.body[i].now->x));
    };
    Vec4d sum = {}, squares = {};
    for (uint32_t i = 0; i < bodies; ++i) {
        const Vec4d p = place(i);
        sum += p, squares += p * p;
    }
    const Vec4d spread = squares - sum * sum / static_cast<double>(bodies);
    const uint32_t axis = spread[0] >= spread[1] && spread[0] >= spread[2] ? 0 : spread[1] >= spread[2] ? 1 : 2;
    sorting.along.clear();
    for (uint32_t i = 0; i < bodies; ++i) {
        const double x = place(i)[axis];
        sorting.along.push_back({std::isfinite(x) ? x : 0.0, i});
    }
    std::sort(sorting.along.begin(), sorting.along.end());
    const uint32_t strips = std::min(bodies / kBodiesPerStrip, kMostStrips);
    sorting.strip.resize(bodies);
    for (uint32_t i = 0; i < bodies; ++i) sorting.strip[sorting.along[i].second] = static_cast<uint32_t>(uint64_t{i} * strips / bodies);
    return strips;
}

void set_groups(const std::array<uint32_t, 5>& phase, ContactSolver& solver) {
    solver.phase = phase;
    if (solver.group.size() < phase[4]) solver.group.resize(phase[4]);
    const uint32_t strips = phase[1];
    for (uint32_t g = 0; g < phase[1]; ++g) solver.group[g].strips = {g, 1};
    for (uint32_t g = phase[1]; g < phase[2]; ++g) solver.group[g].strips = {2 * (g - phase[1]), 2};
    for (uint32_t g = phase[2]; g < phase[3]; ++g) solver.group[g].strips = {2 * (g - phase[2]) + 1, 2};
    for (uint32_t g = phase[3]; g < phase[4]; ++g) solver.group[g].strips = {0, strips};
}

}  // namespace

void group_rows(const AdvanceCall& call, const AdvanceIsland& island, const ContactRows& rows, ContactSorting& sorting,
                ContactSolver& solver) {
    if (!may_split(sorting, island)) {
        set_groups({0, 1, 1, 1, 1}, solver);
        solver.group[0].prepared = {0, static_cast<uint32_t>(sorting.dealt.size())};
        return;
    }
    const uint32_t strips = find_strips(island, sorting), even = strips / 2, odd = (strips - 1) / 2;  // borders
    set_groups({0, strips, strips + even, strips + even + odd, strips + even + odd + 1}, solver);
    const auto strip_of = [&](uint32_t body) {
        const uint32_t slot = island.slot_of_body[body];
        if (is_deformable(call.inputs.bodies, body)) return sorting.strip[slot];
        return island.rigid[slot].free == kNone ? kNone : sorting.strip[island.body.size() + island.rigid[slot].free];
    };
    const auto group_of = [&](uint32_t row) {
        uint32_t a = strip_of(rows.body[row]), b = strip_of(rows.other[row]);
        if (a == kNone) a = b;
        if (b == kNone) b = a;
        if (a == b) return a;
        const uint32_t low = std::min(a, b);
        if (std::max(a, b) > low + 1) return solver.phase[3];
        return solver.phase[low % 2 ? 2 : 1] + low / 2;
    };
    // a counting sort: rows keep their order within a group
    const uint32_t count = static_cast<uint32_t>(sorting.dealt.size());
    sorting.group_of_row.resize(count);
    for (uint32_t g = 0; g < solver.phase[4]; ++g) solver.group[g].prepared = {};
    for (uint32_t i = 0; i < count; ++i) ++solver.group[sorting.group_of_row[i] = group_of(sorting.dealt[i])].prepared.count;
    sorting.next_of_group.assign(solver.phase[4], 0);
    uint32_t first = 0;
    for (uint32_t g = 0; g < solver.phase[4]; ++g) {
        sorting.next_of_group[g] = solver.group[g].prepared.first = first;
        first += solver.group[g].prepared.count;
    }
    sorting.ungrouped.swap(sorting.dealt);
    sorting.dealt.resize(count);
    for (uint32_t i = 0; i < count; ++i) sorting.dealt[sorting.next_of_group[sorting.group_of_row[i]]++] = sorting.ungrouped[i];
}

}  // namespace trocar
