#pragma once
#include <span>
#include <string_view>
#include <vector>

#include "engine/jobs/trace.hpp"
#include "systems/advance/advance.hpp"
namespace trocar {

// Reused memory of the islands of a pass.
struct AdvanceIslandsScratch {
    std::vector<AdvanceScratch> shared;  // per thread, for islands that share
    std::vector<AdvanceScratch> own;     // of islands that do not
    std::vector<uint32_t> awake;         // islands to be advanced
    std::vector<uint32_t> size;          // as awake: particles
    std::vector<uint32_t> order;
    std::vector<uint32_t> own_index;    // as awake: index in own, or kNone
    std::vector<AdvanceResult> result;  // as awake
    std::vector<uint64_t> response_ns;  // as awake: of its contact constraints
    std::vector<uint64_t> island_ns;    // as awake: of the whole island
};

// Called at the start of every millisecond of an island that has a hand, with the island's bodies; may be empty.
struct IslandTickHook {
    void (*run)(void* user, std::span<const uint32_t> bodies, uint32_t ms) = nullptr;
    void* user = nullptr;
};

// Where islands write their spans, by the name of their first body; may be empty.
struct IslandTrace {
    Trace* trace = nullptr;
    std::span<const std::string_view> name;  // per body
    uint32_t pass = 0;
};

// A pass of all islands.
struct AdvanceIslandsParams {
    AdvanceParams island;  // of every island, except its substeps, observer and tick hook
    double substep = 0;    // s, the longest substep
    IslandTickHook ticks;
    IslandTrace trace;
};

// The islands, and which of them are asleep.
struct IslandsToAdvance {
    const Islands& islands;
    const Sleep& sleep;
    const NodeState& node_state;
};

// Selects the islands that get scratch of their own. A thread's scratch grows to the largest island it works
// on, so one heap of a thousand bodies among single ones would cost its memory once per thread. Of the
// `threads` largest islands those more than twice as large as the largest shared one get their own:
// own[island] is its index, 0 for the largest island, kNone for shared ones. `size`: particles per island.
// Small islands are always shared, and all are with one thread. `order` is scratch.
void pick_large_islands(std::span<const uint32_t> size, uint32_t threads, std::vector<uint32_t>& order, std::vector<uint32_t>& own);

// Advances all awake islands through the pass concurrently, each in its own number of substeps; works and
// counters are added in the order of the islands. response_ns: share of the wall time for contact
// constraints.
void advance_islands(const AdvanceIslandsParams& params, const AdvanceInputs& inputs, const IslandsToAdvance& which,
                     AdvanceIslandsScratch& scratch, AdvanceState state, Energy& energy, Report& report, uint64_t& response_ns);

}  // namespace trocar
