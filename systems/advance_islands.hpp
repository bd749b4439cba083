#pragma once
#include <span>
#include <string_view>
#include <vector>

#include "engine/trace.hpp"
#include "systems/advance.hpp"
namespace trocar {

// Reused memory of the islands of a pass.
struct AdvanceIslandsScratch {
    std::vector<AdvanceScratch> shared;  // per thread, for the islands that share
    std::vector<AdvanceScratch> own;     // of the islands that do not
    std::vector<uint32_t> awake;         // islands to be advanced
    std::vector<uint32_t> size;          // as awake: particles
    std::vector<uint32_t> order;
    std::vector<uint32_t> own_row;      // as awake: row of own or kNone
    std::vector<AdvanceResult> result;  // as awake
    std::vector<uint64_t> response_ns;  // as awake: of contact rows
    std::vector<uint64_t> island_ns;    // as awake: of the whole island
};

// Called at the start of every millisecond of an island that has a hand, with the island's bodies; may be empty.
struct IslandTickHook {
    void (*run)(void* user, std::span<const uint32_t> bodies, uint32_t ms) = nullptr;
    void* user = nullptr;
};

// Where islands leave spans, by the name of their first body; may be empty.
struct IslandTrace {
    Trace* trace = nullptr;
    std::span<const std::string_view> name;  // per body
    uint32_t pass = 0;
};

// A pass of all islands.
struct AdvanceIslandsParams {
    AdvanceParams island;  // of every one, but for its substeps, its observer and its tick hook
    double substep = 0;    // s, the longest
    IslandTickHook ticks;
    IslandTrace trace;
};

// Which islands there are, and which of them lie still.
struct IslandsToAdvance {
    const Islands& islands;
    const Sleep& sleep;
    const NodeState& node_state;
};

// Which islands are worked on in memory of their own. The threads' scratches all come to hold the largest island that they
// share: with one heap of a thousand bodies among single ones that is a heap for every thread. So of the `threads` largest
// islands those that are more than twice as large as what is left for sharing get a scratch of their own: own[island] is its
// row, 0 for the largest island, kNone for what is shared. `size`: particles of each island. Small ones are shared always,
// and with one thread all are. `order` is reused memory.
void pick_large_islands(std::span<const uint32_t> size, uint32_t threads, std::vector<uint32_t>& order, std::vector<uint32_t>& own);

// Moves all islands that are awake through the pass, side by side, each in its own number of substeps; works and counters are
// added in the order of the islands. response_ns: the part of the wall time that contact rows took.
void advance_islands(const AdvanceIslandsParams& params, const AdvanceInputs& inputs, const IslandsToAdvance& which,
                     AdvanceIslandsScratch& scratch, AdvanceState state, Energy& energy, Report& report, uint64_t& response_ns);

}  // namespace trocar
