#pragma once
#include <cstdint>
#include <vector>
namespace trocar {

// One outermost parallel loop, as it ran on one thread.
struct LoopTime {
    uint64_t begin_ns = 0;      // now_ns
    uint64_t duration_ns = 0;   // likewise
    uint64_t processor_ns = 0;  // of the thread, so that load on the machine does not count
    uint64_t longest_ns = 0;    // processor time of its longest chunk: a lower bound for any number of threads
};

// From this call on, loops of more than one chunk that the calling thread runs alone are added to `times`;
// null ends it. For benches: which work could run in parallel.
void watch_loops(std::vector<LoopTime>* times);

}  // namespace trocar
