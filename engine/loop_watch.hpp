#pragma once
#include <cstdint>
#include <vector>
namespace trocar {

// One parallel loop, not inside another, as it ran on one thread.
struct LoopTime {
    uint64_t begin_ns = 0;      // now_ns
    uint64_t duration_ns = 0;   // likewise
    uint64_t processor_ns = 0;  // of the thread: a busy machine does not count
    uint64_t longest_ns = 0;    // processor time of the longest of its chunks: no number of threads makes the loop shorter
};

// From now on loops of more than one chunk that the calling thread runs alone are added to `times`; null ends it. For
// benches: what could run side by side, and what could not.
void watch_loops(std::vector<LoopTime>* times);

}  // namespace trocar
