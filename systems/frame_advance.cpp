#include <algorithm>

#include "engine/parallel.hpp"
#include "engine/thread_pool.hpp"
#include "systems/advance_fine.hpp"
#include "systems/frame_stages.hpp"
#include "systems/island_memory.hpp"
namespace trocar::stages {
namespace {

void begin_response(void* user) { *static_cast<uint64_t*>(user) -= now_ns(); }
void end_response(void* user) { *static_cast<uint64_t*>(user) += now_ns(); }

bool island_has_tool(const World& w, std::span<const uint32_t> bodies) {
    for (const uint32_t body : bodies)
        if (w.bodies.motion[body] == Motion::kHand) return true;
    return false;
}

// One island's tools, for the hook of every millisecond.
struct IslandTicks {
    FrameState& frame;
    std::span<const uint32_t> bodies;
};

// One millisecond of force rendering for the tools whose bodies are in the island.
void haptic_ticks(void* user, uint32_t ms) {
    const IslandTicks& ticks = *static_cast<IslandTicks*>(user);
    FrameState& f = ticks.frame;
    World& w = f.world;
    const size_t per_tool = w.clock.period + 1;
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        const uint32_t body = w.haptics.tool[t].body;
        if (std::find(ticks.bodies.begin(), ticks.bodies.end(), body) == ticks.bodies.end()) continue;
        const uint64_t start = now_ns();
        const HandTool& tool = w.haptics.tool[t];
        ToolState& state = w.haptics.state[t];
        const HapticParams params = haptic_params(w.clock.contact_rate);
        const DeviceState sample = hand_sample(tool, f.scratch.intended[t * per_tool + ms], params.dt, state.output, state.hand);
        tick_tool(params, w.local_contact[t], static_cast<double>(w.clock.tick + ms) * 1e-3, tool, effects_of(w.haptics, tool), sample,
                  f.scratch.haptic[t], state);
        // the force that was found moves the hand until the next tick
        if (tool.hand.mass > 0)
            predict_tool(tool, params.dt, state, std::span(f.scratch.intended).subspan(t * per_tool + ms + 1, 1),
                         std::span(f.scratch.device).subspan(t * per_tool + ms + 1, 1));
        f.times.tick_ns[t * w.clock.period + ms] = now_ns() - start;
    }
}

// One island through the whole pass; with a tool, the haptic tick runs between its milliseconds.
void advance_one_island(FrameState& f, uint32_t row, AdvanceScratch& scratch) {
    World& w = f.world;
    const uint32_t island = f.scratch.awake[row];
    const auto bodies = std::span(w.islands.body).subspan(w.islands.bodies[island].first, w.islands.bodies[island].count);
    const auto rows = std::span(w.islands.row).subspan(w.islands.rows[island].first, w.islands.rows[island].count);
    AdvanceParams params;
    params.tick = w.clock.tick;
    params.ticks = w.clock.period;
    params.gravity = w.settings.gravity;
    params.contact = w.settings.contact;
    params.account_energy = f.options.account_energy;
    params.observer = {begin_response, end_response, &f.scratch.response_ns[row]};
    IslandTicks ticks{f, bodies};
    const bool ticks_inside = !f.options.external_ticks && !w.haptics.tool.empty() && island_has_tool(w, bodies);
    const uint32_t calls = ticks_inside ? params.ticks : 1;  // the tick needs whole numbers of substeps in its millisecond
    params.substeps = calls * count_substeps(w.bodies, bodies, params.ticks * 1e-3 / calls, w.settings.substep, w.links.stable_dt);
    if (ticks_inside) params.tick_hook = {haptic_ticks, &ticks};
    const AdvanceInputs inputs{w.meshes,         w.springs,        w.bodies,        w.anchors,      w.paths,      w.haptics.tool,
                               f.scratch.device, params.ticks + 1, other_forces(f), f.scratch.stop, w.haptics.jaw};
    params.substeps *=
        finer_steps(inputs, w.particles, bodies, w.rows, rows, params.ticks * 1e-3 / params.substeps, params.ticks * 1e-3, scratch);
    const AdvanceState state{w.particles, w.poses, w.rows, w.haptics.state};
    advance_island(params, inputs, bodies, rows, scratch, state, f.scratch.advance_result[row]);
}

// An island's span in the trace; small ones are left out.
void trace_island(FrameState& f, uint32_t island, uint64_t start) {
    constexpr uint64_t kLeastSpan = 20'000;  // ns
    const uint64_t duration = now_ns() - start;
    if (duration < kLeastSpan) return;
    const World& w = f.world;
    f.options.trace->add({f.island_name[w.islands.body[w.islands.bodies[island].first]], start, duration, thread_index(),
                          static_cast<uint32_t>(w.clock.pass)});
}

// Small islands share a job so that a job is worth its start (about 40 us).
uint32_t island_grain(const World& w) {
    const size_t count = std::max<size_t>(1, w.islands.bodies.size());
    const double us_per_island = static_cast<double>(w.particles.offset.size()) * w.clock.period * 3e-3 / static_cast<double>(count);
    return static_cast<uint32_t>(std::clamp(40.0 / std::max(us_per_island, 0.01), 1.0, 1024.0));
}

void find_awake_islands(const World& w, std::vector<uint32_t>& awake) {
    awake.clear();
    for (uint32_t i = 0; i < w.islands.bodies.size(); ++i) {
        const uint32_t body = w.islands.body[w.islands.bodies[i].first];
        // if it sleeps then all of them; if it is off then it is alone
        if (!is_asleep(w.sleep, body) && !is_off(w.node_state, body)) awake.push_back(i);
    }
}

// Which scratch each awake island is advanced in.
void choose_memory(FrameState& f) {
    const World& w = f.world;
    FrameScratch& s = f.scratch;
    s.island_size.clear();
    for (const uint32_t island : s.awake) {
        uint32_t particles = 0;
        const Range bodies = w.islands.bodies[island];
        for (uint32_t i = bodies.first; i < bodies.end(); ++i) particles += w.bodies.particles[w.islands.body[i]].count;
        s.island_size.push_back(particles);
    }
    pick_large_islands(s.island_size, thread_count(), s.island_order, s.own_memory);
    s.advance.resize(std::max<size_t>(s.advance.size(), thread_count()));
    s.own_advance.resize(
        std::max<size_t>(s.own_advance.size(), std::ranges::count_if(s.own_memory, [](uint32_t own) { return own != kNone; })));
}

// Islands are advanced side by side: contact rows take that part of the wall time that they take of what all islands took.
uint64_t share_of_response(const FrameScratch& s, uint64_t wall_ns) {
    uint64_t response = 0, all = 0;
    for (size_t i = 0; i < s.island_ns.size(); ++i) response += s.response_ns[i], all += s.island_ns[i];
    return all > 0 ? static_cast<uint64_t>(static_cast<double>(wall_ns) * static_cast<double>(response) / static_cast<double>(all)) : 0;
}

}  // namespace

void advance(FrameState& f) {
    World& w = f.world;
    find_awake_islands(w, f.scratch.awake);
    if (!w.links.group.empty()) find_holding_groups(w.links, static_cast<uint32_t>(w.bodies.mesh.size()), f.scratch.holding);
    choose_memory(f);
    const uint32_t count = static_cast<uint32_t>(f.scratch.awake.size());
    f.scratch.advance_result.assign(count, {});
    f.scratch.response_ns.assign(count, 0);
    f.scratch.island_ns.assign(count, 0);
    f.times.tick_ns.assign(w.haptics.tool.size() * w.clock.period, 0);
    const uint64_t advance_start = now_ns();
    parallel_for(count, island_grain(w), [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const uint64_t start = now_ns();
            const uint32_t own = f.scratch.own_memory[i];
            advance_one_island(f, i, own == kNone ? f.scratch.advance[thread_index()] : f.scratch.own_advance[own]);
            f.scratch.island_ns[i] = now_ns() - start;
            if (f.options.trace) trace_island(f, f.scratch.awake[i], start);
        }
    });
    f.times.response_ns = share_of_response(f.scratch, now_ns() - advance_start);
    remember_contacts(w.rows, w.contact_memory);
    share_room(f.scratch.advance);
    note_link_forces(period_seconds(w), w.links);
    note_pull_on_tools(period_seconds(w), w.links, w.haptics.tool, w.haptics.jaw, w.haptics.state);
    for (ToolState& state : w.haptics.state) state.grip_torque = state.grip_moment / period_seconds(w);
    w.report.deepest_residual = 0;
    for (const AdvanceResult& result : f.scratch.advance_result) add_advance_result(result, w.energy, w.report);
    if (w.haptics.tool.empty() || f.options.external_ticks) return;
    sum_tool_counters(w.haptics);
}

}  // namespace trocar::stages
