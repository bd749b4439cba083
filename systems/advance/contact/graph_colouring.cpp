#include "systems/advance/contact/graph_colouring.hpp"

#include <algorithm>

#include "engine/mesh/surfaces.hpp"
#include "systems/advance/island/constants.hpp"
namespace trocar {
namespace {

bool may_split(const ContactSorting& sorting, const AdvanceIsland& island) {
    const auto is_led = [&](const AdvanceRigid& rigid) {
        return rigid.node != kNone && (rigid.free == kNone || island.free[rigid.free].held || island.free[rigid.free].drive != kNone);
    };
    const auto is_embedded = [](const AdvanceBody& b) { return b.embedding_node != nullptr; };
    return sorting.order.size() >= kFewestConstraintsToSplit && island.body.size() + island.free.size() >= 2 * kBodiesPerSlab &&
           std::none_of(island.body.begin(), island.body.end(), is_embedded) &&
           std::none_of(island.rigid.begin(), island.rigid.end(), is_led);
}

// Distributes bodies evenly to slabs along the axis of largest spread. Returns the number of slabs.
uint32_t find_slabs(const AdvanceIsland& island, ContactSorting& sorting) {
    const uint32_t soft = static_cast<uint32_t>(island.body.size()), bodies = soft + static_cast<uint32_t>(island.free.size());
    const auto position = [&](uint32_t i) -> Vec4d {
        if (i >= soft) return island.nodes.node.position[island.rigid[island.free[i - soft].rigid].node];
        return island.body[i].origin + float_vec4(_mm_load_ps(&island.body[i].now->x));
    };
    Vec4d sum = {}, squares = {};
    for (uint32_t i = 0; i < bodies; ++i) {
        const Vec4d p = position(i);
        sum += p, squares += p * p;
    }
    const Vec4d spread = squares - sum * sum / static_cast<double>(bodies);
    const uint32_t axis = spread[0] >= spread[1] && spread[0] >= spread[2] ? 0 : spread[1] >= spread[2] ? 1 : 2;
    sorting.along.clear();
    for (uint32_t i = 0; i < bodies; ++i) {
        const double x = position(i)[axis];
        sorting.along.push_back({std::isfinite(x) ? x : 0.0, i});
    }
    std::sort(sorting.along.begin(), sorting.along.end());
    const uint32_t slabs = std::min(bodies / kBodiesPerSlab, kMostSlabs);
    sorting.slab.resize(bodies);
    for (uint32_t i = 0; i < bodies; ++i) sorting.slab[sorting.along[i].second] = static_cast<uint32_t>(uint64_t{i} * slabs / bodies);
    return slabs;
}

void set_groups(const std::array<uint32_t, 5>& colour, ContactSolver& solver) {
    solver.colour = colour;
    if (solver.group.size() < colour[4]) solver.group.resize(colour[4]);
    const uint32_t slabs = colour[1];
    for (uint32_t g = 0; g < colour[1]; ++g) solver.group[g].slabs = {g, 1};
    for (uint32_t g = colour[1]; g < colour[2]; ++g) solver.group[g].slabs = {2 * (g - colour[1]), 2};
    for (uint32_t g = colour[2]; g < colour[3]; ++g) solver.group[g].slabs = {2 * (g - colour[2]) + 1, 2};
    for (uint32_t g = colour[3]; g < colour[4]; ++g) solver.group[g].slabs = {0, slabs};
}

}  // namespace

void colour_constraints(const AdvanceCall& call, const AdvanceIsland& island, const ContactConstraints& constraints,
                        ContactSorting& sorting, ContactSolver& solver) {
    if (!may_split(sorting, island)) {
        set_groups({0, 1, 1, 1, 1}, solver);
        solver.group[0].prepared = {0, static_cast<uint32_t>(sorting.order.size())};
        return;
    }
    const uint32_t slabs = find_slabs(island, sorting), even = slabs / 2, odd = (slabs - 1) / 2;  // borders
    set_groups({0, slabs, slabs + even, slabs + even + odd, slabs + even + odd + 1}, solver);
    const auto slab_of = [&](uint32_t body) {
        const uint32_t slot = island.slot_of_body[body];
        if (is_deformable(call.inputs.bodies, body)) return sorting.slab[slot];
        return island.rigid[slot].free == kNone ? kNone : sorting.slab[island.body.size() + island.rigid[slot].free];
    };
    const auto group_of = [&](uint32_t constraint) {
        uint32_t a = slab_of(constraints.body[constraint]), b = slab_of(constraints.other[constraint]);
        if (a == kNone) a = b;
        if (b == kNone) b = a;
        if (a == b) return a;
        const uint32_t low = std::min(a, b);
        if (std::max(a, b) > low + 1) return solver.colour[3];
        return solver.colour[low % 2 ? 2 : 1] + low / 2;
    };
    // a counting sort: constraints keep their order within a group
    const uint32_t count = static_cast<uint32_t>(sorting.order.size());
    sorting.group_of_constraint.resize(count);
    for (uint32_t g = 0; g < solver.colour[4]; ++g) solver.group[g].prepared = {};
    for (uint32_t i = 0; i < count; ++i) ++solver.group[sorting.group_of_constraint[i] = group_of(sorting.order[i])].prepared.count;
    sorting.next_of_group.assign(solver.colour[4], 0);
    uint32_t first = 0;
    for (uint32_t g = 0; g < solver.colour[4]; ++g) {
        sorting.next_of_group[g] = solver.group[g].prepared.first = first;
        first += solver.group[g].prepared.count;
    }
    sorting.ungrouped.swap(sorting.order);
    sorting.order.resize(count);
    for (uint32_t i = 0; i < count; ++i) sorting.order[sorting.next_of_group[sorting.group_of_constraint[i]]++] = sorting.ungrouped[i];
}

}  // namespace trocar
