#include "systems/advance/islands.hpp"

#include <algorithm>
#include <numeric>

#include "engine/contact/sleeping_bodies.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/advance/tissue/fine_steps.hpp"
namespace trocar {
namespace {

// Data shared by the islands of a pass.
struct IslandsPass {
    const AdvanceIslandsParams& params;
    const AdvanceInputs& inputs;
    const IslandsToAdvance& which;
    AdvanceIslandsScratch& scratch;
    AdvanceState state;
};

// Bodies of one island, for the hook of every millisecond.
struct IslandTicks {
    const IslandTickHook& hook;
    std::span<const uint32_t> bodies;
};
void run_ticks(void* user, uint32_t ms) {
    const IslandTicks& ticks = *static_cast<IslandTicks*>(user);
    ticks.hook.run(ticks.hook.user, ticks.bodies, ms);
}

void begin_response(void* user) { *static_cast<uint64_t*>(user) -= now_ns(); }
void end_response(void* user) { *static_cast<uint64_t*>(user) += now_ns(); }

bool has_hand(const Bodies& bodies, std::span<const uint32_t> island) {
    return std::ranges::any_of(island, [&](uint32_t body) { return bodies.motion[body] == Motion::kHand; });
}

// Advances one island through the whole pass; with a hand, the hook runs at each of its milliseconds.
void advance_one(const IslandsPass& pass, uint32_t index, AdvanceScratch& scratch) {
    const Islands& islands = pass.which.islands;
    const Bodies& all = pass.inputs.bodies;
    const uint32_t island = pass.scratch.awake[index];
    const auto bodies = std::span(islands.body).subspan(islands.bodies[island].first, islands.bodies[island].count);
    const auto constraints = std::span(islands.constraint).subspan(islands.constraints[island].first, islands.constraints[island].count);
    AdvanceParams params = pass.params.island;
    params.observer = {begin_response, end_response, &pass.scratch.response_ns[index]};
    IslandTicks ticks{pass.params.ticks, bodies};
    const bool ticks_inside = pass.params.ticks.run && has_hand(all, bodies);
    const uint32_t calls = ticks_inside ? params.ticks : 1;  // a tick needs a whole number of substeps per millisecond
    const std::span<const double> linked = pass.inputs.other.links ? pass.inputs.other.links->stable_dt : std::span<const double>{};
    AdvanceInputs inputs = pass.inputs;
    inputs.leapfrog = needs_leapfrog(inputs, pass.state.particles, pass.state.constraints, bodies, constraints);
    params.substeps = calls * count_substeps(all, bodies, params.ticks * 1e-3 / calls, pass.params.substep, linked, inputs.leapfrog);
    if (const ThreadState* threads = pass.inputs.other.thread_state) {
        const uint32_t sewn = calls * count_substeps(all, bodies, params.ticks * 1e-3 / calls, pass.params.substep, threads->stable_dt,
                                                     inputs.leapfrog);
        params.substeps = std::max(params.substeps, sewn);
    }
    if (ticks_inside) params.tick_hook = {run_ticks, &ticks};
    params.substeps *=
        finer_steps(inputs, pass.state.particles, bodies, params.ticks * 1e-3 / params.substeps, params.ticks * 1e-3, scratch);
    advance_island(params, inputs, bodies, constraints, scratch, pass.state, pass.scratch.result[index]);
}

// An island's span in the trace; short ones are omitted.
void trace_island(const IslandsPass& pass, uint32_t island, uint64_t start, uint64_t duration) {
    constexpr uint64_t kLeastSpan = 20'000;  // ns
    const auto& [trace, name, number] = pass.params.trace;
    if (!trace || duration < kLeastSpan) return;
    const Islands& islands = pass.which.islands;
    trace->add({name[islands.body[islands.bodies[island].first]], start, duration, thread_index(), number});
}

// Small islands share a job to amortise its start (about 40 us).
uint32_t island_grain(const IslandsPass& pass) {
    const size_t count = std::max<size_t>(1, pass.which.islands.bodies.size());
    const double us_per_island =
        static_cast<double>(pass.state.particles.offset.size()) * pass.params.island.ticks * 3e-3 / static_cast<double>(count);
    return static_cast<uint32_t>(std::clamp(40.0 / std::max(us_per_island, 0.01), 1.0, 1024.0));
}

void find_awake_islands(const IslandsToAdvance& in, std::vector<uint32_t>& awake) {
    awake.clear();
    for (uint32_t i = 0; i < in.islands.bodies.size(); ++i) {
        const uint32_t body = in.islands.body[in.islands.bodies[i].first];
        // an island sleeps as a whole; a disabled body is alone
        if (!is_asleep(in.sleep, body) && !is_off(in.node_state, body)) awake.push_back(i);
    }
}

// Assigns a scratch to each awake island.
void choose_memory(const Bodies& bodies, const Islands& islands, AdvanceIslandsScratch& s) {
    s.size.clear();
    for (const uint32_t island : s.awake) {
        uint32_t particles = 0;
        const Range range = islands.bodies[island];
        for (uint32_t i = range.first; i < range.end(); ++i) particles += bodies.particles[islands.body[i]].count;
        s.size.push_back(particles);
    }
    pick_large_islands(s.size, thread_count(), s.order, s.own_index);
    s.shared.resize(std::max<size_t>(s.shared.size(), thread_count()));
    s.own.resize(std::max<size_t>(s.own.size(), std::ranges::count_if(s.own_index, [](uint32_t own) { return own != kNone; })));
}

// Islands run concurrently: contact response gets the share of the wall time that it has of their total.
uint64_t share_of_response(const AdvanceIslandsScratch& s, uint64_t wall_ns) {
    uint64_t response = 0, all = 0;
    for (size_t i = 0; i < s.island_ns.size(); ++i) response += s.response_ns[i], all += s.island_ns[i];
    return all > 0 ? static_cast<uint64_t>(static_cast<double>(wall_ns) * static_cast<double>(response) / static_cast<double>(all)) : 0;
}

}  // namespace

void pick_large_islands(std::span<const uint32_t> size, uint32_t threads, std::vector<uint32_t>& order, std::vector<uint32_t>& own) {
    constexpr uint32_t kSmall = 2048;  // particles: a scratch of 2 MB
    const uint32_t count = uint32_t(size.size());
    own.assign(count, kNone);
    if (threads < 2) return;
    order.resize(count);
    std::iota(order.begin(), order.end(), 0u);
    const uint32_t looked_at = std::min(count, threads + 1);
    std::partial_sort(order.begin(), order.begin() + looked_at, order.end(),
                      [&](uint32_t a, uint32_t b) { return size[a] != size[b] ? size[a] > size[b] : a < b; });
    const uint32_t left = std::max(kSmall, count > threads ? size[order[threads]] : 0);
    for (uint32_t k = 0; k < looked_at && size[order[k]] > 2 * left; ++k) own[order[k]] = k;
}

void advance_islands(const AdvanceIslandsParams& params, const AdvanceInputs& inputs, const IslandsToAdvance& which,
                     AdvanceIslandsScratch& scratch, AdvanceState state, Energy& energy, Report& report, uint64_t& response_ns) {
    const IslandsPass pass{params, inputs, which, scratch, state};
    find_awake_islands(which, scratch.awake);
    choose_memory(inputs.bodies, which.islands, scratch);
    const uint32_t count = static_cast<uint32_t>(scratch.awake.size());
    scratch.result.assign(count, {});
    scratch.response_ns.assign(count, 0);
    scratch.island_ns.assign(count, 0);
    const uint64_t pass_start = now_ns();
    parallel_for(count, island_grain(pass), [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const uint64_t start = now_ns();
            const uint32_t own = scratch.own_index[i];
            advance_one(pass, i, own == kNone ? scratch.shared[thread_index()] : scratch.own[own]);
            scratch.island_ns[i] = now_ns() - start;
            trace_island(pass, scratch.awake[i], start, scratch.island_ns[i]);
        }
    });
    response_ns += share_of_response(scratch, now_ns() - pass_start);
    share_room(scratch.shared);
    report.deepest_residual = 0;
    for (const AdvanceResult& result : scratch.result) add_advance_result(result, energy, report);
}

}  // namespace trocar
